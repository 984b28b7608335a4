"""The comb's session: what a stroke must never do, what each mode does, masks, mirrors, replay."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from hairloom.editing.binding import bind_strands, neighbour_graph, wisp_labels
from hairloom.editing.brush import mirrored, project
from hairloom.editing.comb import CombSession, comb
from hairloom.editing.grips import nearest_on
from hairloom.editing.strokes import CombParams, Stroke, View, stroke_from_json, stroke_to_json
from hairloom.errors import Cancelled, InputError
from hairloom.geometry.collider import comb_collider
from hairloom.geometry.head import HeadSurface, sphere_head
from hairloom.geometry.strands import from_dense
from hairloom.types import StrandSet
from scipy.spatial.transform import Rotation

N_POINTS = 20
RADIUS = 0.1
FRAME = np.eye(4)


def looking(along: tuple[float, float, float] = (0.0, 1.0, 0.0), *, perspective: bool = True) -> View:
    """A view of 600 x 600 pixels from half a metre away at the head, z up; about 1.2 pixels a millimetre."""
    forward = np.array(along) / np.linalg.norm(along)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = [right, np.cross(right, forward), -forward]
    view[:3, 3] = view[:3, :3] @ (0.5 * forward)
    near, far = 0.01, 10.0
    if perspective:
        lens = np.diag([2.0, 2.0, -(far + near) / (far - near), 0.0])
        lens[2, 3], lens[3, 2] = -2 * far * near / (far - near), -1.0
    else:
        lens = np.diag([4.0, 4.0, -2.0 / (far - near), 1.0])
        lens[2, 3] = -(far + near) / (far - near)
    return View(lens @ view, 600.0, 600.0)


def curly_groom(count: int = 300, seed: int = 0) -> tuple[StrandSet, tuple[np.ndarray, ...]]:
    """Curls that hang from the side of a spherical head, in wisps; and the wisps of two levels."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-np.pi, np.pi, count)
    polar = rng.uniform(0.2, 1.2, count)
    out = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    t = np.linspace(0.0, 1.0, N_POINTS)[None, :, None]
    flow = out[:, None] * (1.0 + 0.35 * t) * RADIUS + np.array([0.0, 0.0, -0.12]) * t**2
    phase = 2 * np.pi * 2.0 * t[:, :, 0] + rng.uniform(0, 6, count)[:, None]
    side = np.cross(out, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    grown = np.minimum(t * 3, 1.0)
    curls = 0.006 * grown * (np.cos(phase)[..., None] * out[:, None] + np.sin(phase)[..., None] * side[:, None])
    points = (flow + curls - curls[:, :1]).astype(np.float32)
    fine = (np.round(azimuth / 0.3) * 100 + np.round(polar / 0.25)).astype(np.int32)
    coarse = (np.round(azimuth / 0.7) * 100 + np.round(polar / 0.6)).astype(np.int32)
    return from_dense(points), (fine - fine.min(), coarse - coarse.min())


def stroke(
    params: CombParams = CombParams(radius=60.0), start: tuple[float, float] = (300.0, 230.0), *,
    view: View | None = None, drag: tuple[float, float] = (50.0, 0.0), frame: np.ndarray = FRAME,
    selection: np.ndarray | None = None,
) -> Stroke:  # fmt: skip
    path = np.linspace(start, np.add(start, drag), 12)
    samples = np.column_stack([path, np.ones(len(path))])
    return Stroke(params, view or looking(), frame, samples, selection)


def moved_strands(before: StrandSet, after: StrandSet) -> np.ndarray:
    away = np.linalg.norm(after.points - before.points, axis=1)
    return np.maximum.reduceat(away, before.offsets[:-1])


def segments(strands: StrandSet) -> np.ndarray:
    return np.linalg.norm(np.diff(strands.points.reshape(-1, N_POINTS, 3).astype(np.float64), axis=1), axis=2)


@pytest.mark.parametrize("mode", ["comb", "lift", "twist", "smooth"])
@pytest.mark.parametrize("level", [-1, 1, 0])
def test_roots_and_lengths_stay(mode: str, level: int) -> None:
    hair, labels = curly_groom()
    combed = comb(hair, labels, [stroke(CombParams(mode=mode, level=level, radius=60.0))])
    assert moved_strands(hair, combed).max() > 1e-3
    np.testing.assert_array_equal(combed.roots, hair.roots)
    # float32 points of about 0.1 m, segments of about 8 mm
    np.testing.assert_allclose(segments(combed), segments(hair), rtol=2e-5)


def test_hair_out_of_reach_keeps_its_bits() -> None:
    hair, labels = curly_groom()
    combed = comb(hair, labels, [stroke(CombParams(radius=60.0, drag=0.0))])
    behind = hair.roots[:, 1] > 0.03  # the view looks along +y
    np.testing.assert_array_equal(
        combed.points.reshape(-1, N_POINTS, 3)[behind], hair.points.reshape(-1, N_POINTS, 3)[behind]
    )


def test_a_stroke_that_touches_nothing_changes_nothing() -> None:
    hair, labels = curly_groom()
    combed = comb(hair, labels, [stroke(start=(10.0, 10.0), drag=(20.0, 0.0))])
    np.testing.assert_array_equal(combed.points, hair.points)


def test_without_strength_nothing_moves() -> None:
    hair, labels = curly_groom()
    session = CombSession(hair, labels)
    session.begin(CombParams(radius=60.0), looking(), FRAME)
    assert not session.move(300, 230, 1.0)
    assert not session.move(350, 230, 0.0)
    np.testing.assert_array_equal(session.points, hair.points)


@pytest.mark.parametrize("perspective", [True, False])
def test_held_hair_follows_the_brush(perspective: bool) -> None:
    """Where a strand passed the brush, it passes it still, a tenth of the radius aside at most, but for a few."""
    hair, labels = curly_groom(1500)
    view, radius = looking(perspective=perspective), 60.0
    made = stroke(CombParams(radius=radius, hardness=1.0, level=0), view=view, drag=(30.0, 10.0))
    combed = comb(hair, labels, [made])
    projection = project(view)
    before, after = (
        projection.pixels(strands.points.astype(np.float64))[0].reshape(-1, N_POINTS, 2) for strands in (hair, combed)
    )
    start = made.samples[0, :2]
    touched = np.flatnonzero(
        (np.linalg.norm(before - start, axis=2).min(axis=1) < 0.9 * radius) & (moved_strands(hair, combed) > 1e-3)
    )
    contacts = nearest_on(before[touched], np.tile(start, (len(touched), 1)))[0]
    goals = contacts + made.samples[-1, :2] - start
    away = np.linalg.norm(nearest_on(after[touched], goals)[0] - goals, axis=1)
    assert len(touched) > 30
    assert (away < 0.1 * radius).mean() > 0.85


def test_curls_are_kept() -> None:
    """A strand's turning is what it was, to a tenth in the mean; point by point most of it."""
    hair, labels = curly_groom()
    combed = comb(hair, labels, [stroke()])
    strong = moved_strands(hair, combed) > 0.02
    assert strong.sum() > 10

    def turning(strands: StrandSet) -> np.ndarray:
        edges = np.diff(strands.points.reshape(-1, N_POINTS, 3)[strong].astype(np.float64), axis=1)
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        return np.arccos(np.clip((edges[:, 1:] * edges[:, :-1]).sum(axis=2), -1.0, 1.0))

    before, after = turning(hair), turning(combed)
    assert abs(after.mean() / before.mean() - 1.0) < 0.1
    assert np.median(np.abs(after - before)) < 0.3 * before.mean()


def test_hair_stays_out_of_the_head() -> None:
    hair, labels = curly_groom()
    head = sphere_head(radius=RADIUS - 0.001)
    collider = comb_collider([head], hair.roots)
    surface = HeadSurface(head)
    strokes = [
        stroke(start=(230.0, 200.0), drag=(150.0, 80.0)),
        stroke(CombParams(mode="lift", invert=True, radius=80.0), drag=(0.0, 80.0)),
        stroke(CombParams(mode="length", radius=80.0), drag=(0.0, 60.0)),
    ]
    combed = comb(hair, labels, strokes, collider)
    changed = moved_strands(hair, combed) > 1e-6
    depth = surface.signed_distance(combed.points).reshape(-1, N_POINTS)[changed]
    was_outside = surface.signed_distance(hair.points).reshape(-1, N_POINTS)[changed].min(axis=1) >= 0
    assert was_outside.sum() > 10
    assert depth[was_outside].min() > -5e-4


def test_lifting_goes_outward_and_inverted_inward() -> None:
    hair, labels = curly_groom()
    heights = []
    for invert in (False, True):
        params = CombParams(mode="lift", radius=60.0, invert=invert)
        combed = comb(hair, labels, [stroke(params, drag=(0.0, 40.0))])
        strong = moved_strands(hair, combed) > 2e-3
        away = np.linalg.norm(combed.points, axis=1) - np.linalg.norm(hair.points, axis=1)
        heights.append(away.reshape(-1, N_POINTS)[strong].mean())
    assert heights[0] > 1e-3
    assert heights[1] < -1e-3


def test_length_trims_and_grows_and_a_helix_goes_on_as_a_helix() -> None:
    t = np.linspace(0.0, 1.0, 60)[None, :, None]
    angle = 2 * np.pi * 4 * t[:, :, 0]
    curl = 0.005 * np.stack([np.cos(angle) - 1.0, np.sin(angle), 0 * angle], axis=2)
    helix = np.array([0.0, -RADIUS, 0.0]) + curl + t * np.array([0.0, 0.0, -0.1])
    hair = from_dense(np.repeat(helix, 8, axis=0).astype(np.float32))
    grown, cut = (
        comb(hair, (), [stroke(CombParams(mode="length", radius=100.0, hardness=1.0, invert=invert), (300.0, 260.0))])
        for invert in (False, True)
    )

    def length(strands: StrandSet) -> float:
        return float(np.linalg.norm(np.diff(strands.points[:60].astype(np.float64), axis=0), axis=1).sum())

    way = np.linalg.norm(project(looking()).moves(hair.roots[:1].astype(np.float64), np.array([50.0, 0.0])))
    assert length(grown) == pytest.approx(length(hair) + way, rel=0.02)
    assert length(cut) == pytest.approx(length(hair) - way, rel=0.02)
    radii = np.linalg.norm(grown.points[:60, :2] - [-0.005, -RADIUS], axis=1)
    # the main direction is measured over two turns, whose ends tilt it a little
    assert np.abs(radii - 0.005).max() < 2.5e-3
    assert (np.diff(grown.points[:60, 2]) < 0).all()


def test_twisting_winds_strands_about_their_wisp() -> None:
    hair, labels = curly_groom()
    params = CombParams(mode="twist", radius=60.0)
    there = comb(hair, labels, [stroke(params)])
    other = comb(hair, labels, [stroke(replace(params, invert=True))])
    strong = moved_strands(hair, there) > 2e-3
    assert strong.sum() > 10
    assert moved_strands(there, other)[strong].mean() > 2e-3


def test_the_front_and_the_volume() -> None:
    hair, labels = curly_groom()
    front = comb(hair, labels, [stroke(CombParams(radius=60.0, drag=0.0))])
    through = comb(hair, labels, [stroke(CombParams(radius=60.0, drag=0.0, through=True))])
    behind = hair.roots[:, 1] > 0.05
    assert moved_strands(hair, front)[behind].max() == 0.0
    assert moved_strands(hair, through)[behind].max() > 1e-3


def test_selection_masks() -> None:
    hair, labels = curly_groom()
    selection = (np.arange(hair.n_strands) % 2).astype(np.float32)
    combed = comb(hair, labels, [stroke(selection=selection)])
    moved = moved_strands(hair, combed)
    assert moved[::2].max() == 0.0
    assert moved[1::2].max() > 0.01


def test_only_the_first_wisps() -> None:
    hair, labels = curly_groom()
    long_way = stroke(drag=(150.0, 30.0))
    binding = bind_strands(hair, labels[-1], 20)
    everything = binding.labels[moved_strands(hair, comb(hair, labels, [long_way])) > 0]
    only = replace(long_way, params=replace(long_way.params, only_first=True))
    kept = binding.labels[moved_strands(hair, comb(hair, labels, [only])) > 0]
    assert 0 < len(np.unique(kept)) < len(np.unique(everything))
    # a stroke that comes from beside the hair keeps to what it meets first
    from_beside = replace(only, samples=np.concatenate([[[5.0, 5.0, 1.0]], only.samples]))
    met = binding.labels[moved_strands(hair, comb(hair, labels, [from_beside])) > 0]
    assert 0 < len(np.unique(met)) < len(np.unique(everything))


def test_profile_spares_what_it_leaves_out() -> None:
    hair, labels = curly_groom()
    whole = moved_strands(hair, comb(hair, labels, [stroke()]))
    params = CombParams(radius=60.0, profile=(0.0, 0.0, 0.0))
    assert moved_strands(hair, comb(hair, labels, [stroke(params)])).max() == 0.0
    assert whole.max() > 0.01


def test_mirrored_strokes_mirror() -> None:
    """On a groom that is its own mirror image, a mirrored stroke keeps it so, in a turned and moved object too."""
    half, labels = curly_groom(150)
    flip = np.array([-1.0, 1.0, 1.0], np.float32)
    left = half.points[half.points[:, 0].reshape(-1) == half.points[:, 0]].reshape(-1, N_POINTS, 3)
    on_left = left[:, :, 0].max(axis=1) < -0.01
    both = np.concatenate([left[on_left], left[on_left] * flip])
    doubled = tuple(np.concatenate([level[on_left], level[on_left] + 10_000]) for level in labels)
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_euler("z", 25, degrees=True).as_matrix()
    frame[:3, 3] = [0.02, 0.01, 0.0]
    world = both @ frame[:3, :3].T.astype(np.float32) + frame[:3, 3].astype(np.float32)
    hair = from_dense(world)
    params = CombParams(radius=60.0, mirror=(True, False, False), through=True, drag=0.0)
    combed = comb(hair, doubled, [stroke(params, (250.0, 230.0), frame=frame)])
    assert moved_strands(hair, combed).max() > 5e-3
    local = (combed.points - frame[:3, 3]) @ frame[:3, :3]
    one, other = local.reshape(2, -1, N_POINTS, 3)
    # the two halves are mirror images to float32 only, which decides where a contact is at a corner of a strand
    np.testing.assert_allclose(one * flip, other, atol=3e-4)


def test_mirrors_combine() -> None:
    views = mirrored(looking(), FRAME, (True, True, False))
    point = np.array([[0.03, -0.02, 0.05]])
    images = [point * [x, y, 1] for y in (1, -1) for x in (1, -1)]
    for view, image in zip(views, images):
        np.testing.assert_allclose(view.pixels(point)[0], project(looking()).pixels(image)[0], atol=1e-9)


def test_replay_gives_the_same_bytes() -> None:
    hair, labels = curly_groom()
    session = CombSession(hair, labels)
    params = CombParams(radius=60.0, pressure_radius=True)
    recorded = []
    for start in (200.0, 320.0):
        session.begin(params, looking(), FRAME)
        for i in range(10):
            session.move(start + 7.3 * i, 240.0 - 2.1 * i, 0.5 + 0.05 * i)
        recorded.append(session.end())
    replayed = comb(hair, labels, [stroke_from_json(stroke_to_json(made)) for made in recorded])
    assert replayed.points.tobytes() == session.points.tobytes()


def test_any_number_of_threads_gives_the_same_bytes() -> None:
    hair, labels = curly_groom()
    results = []
    threads = numba.get_num_threads()
    for count in (1, threads):
        numba.set_num_threads(count)
        results.append(comb(hair, labels, [stroke()]).points.tobytes())
    assert results[0] == results[1]


def test_cancel_puts_everything_back() -> None:
    hair, labels = curly_groom()
    session = CombSession(hair, labels)
    session.begin(CombParams(radius=60.0), looking(), FRAME)
    session.move(300, 230)
    assert session.move(330, 230)
    session.cancel()
    np.testing.assert_array_equal(session.points, hair.points)
    with pytest.raises(InputError, match="no stroke"):
        session.move(340, 230)


def test_progress_can_cancel() -> None:
    hair, labels = curly_groom(50)

    def stop(fraction: float, message: str, /) -> None:
        if fraction > 0:
            raise Cancelled("stop")

    with pytest.raises(Cancelled):
        comb(hair, labels, [stroke(), stroke()], progress=stop)


def test_wisps_are_read_from_attributes() -> None:
    hair, labels = curly_groom(40)
    named = StrandSet(hair.points, hair.offsets, {}, {"hairloom_wisp": labels[0], "hairloom_wisp_2": labels[1]})
    found = wisp_labels(named)
    assert len(found) == 2
    np.testing.assert_array_equal(found[1], labels[1])
    assert wisp_labels(hair) == ()


def test_binding_averages_wisps_and_places_points() -> None:
    hair, labels = curly_groom(60)
    binding = bind_strands(hair, labels[0], N_POINTS)
    wisp = int(binding.labels[7])
    members = np.flatnonzero(binding.labels == wisp)
    samples = bind_strands(hair, None, N_POINTS).centers
    np.testing.assert_allclose(binding.centers[wisp], samples[members].mean(axis=0), atol=1e-7)
    np.testing.assert_allclose(binding.places.reshape(-1, N_POINTS)[:, [0, -1]], [[0, N_POINTS - 1]] * 60, atol=1e-5)


def test_neighbours_of_roots_on_a_sphere() -> None:
    hair, _ = curly_groom(200)
    graph = neighbour_graph(hair.roots)
    near = np.repeat(hair.roots, np.diff(graph.offsets), axis=0) - hair.roots[graph.neighbours]
    assert np.median(np.linalg.norm(near, axis=1)) < 0.03
    flat = neighbour_graph(np.random.default_rng(0).random((30, 3)).astype(np.float32) * [1, 1, 0])
    assert np.diff(flat.offsets).min() >= 2


def test_bad_input() -> None:
    hair, labels = curly_groom(40)
    with pytest.raises(InputError, match="no strands to comb"):
        CombSession(StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32)), ())
    with pytest.raises(InputError, match="wisps for 39 strands"):
        CombSession(hair, [labels[0][:-1]])
    session = CombSession(hair, labels)
    with pytest.raises(InputError, match="level is 3 but the groom has 2"):
        session.begin(CombParams(level=3), looking(), FRAME)
    with pytest.raises(InputError, match="selection has 3 values"):
        session.begin(CombParams(), looking(), FRAME, np.ones(3, np.float32))
    with pytest.raises(InputError, match="cannot be inverted"):
        session.begin(CombParams(), looking(), np.zeros((4, 4)))
    session.begin(CombParams(), looking(), FRAME)
    with pytest.raises(InputError, match="brush went to nan"):
        session.move(float("nan"), 0.0)
    with pytest.raises(InputError, match="no samples"):
        session.end()
