import numpy as np
import pytest
from hairloom.fourview.clipping import clip_shape, cut_mesh
from hairloom.fourview.views import View
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.types import Mesh
from radial_hair import HEAD, boundary_edges, dome, view, views


def thick_dome(inner=0.08, outer=0.14, centre=(0.0, 0.0, 0.0)):
    """A closed shell: a ball with a cavity, around the head's centre."""
    ball = sphere_head(1.0, n_rings=48)
    vertices = np.concatenate([ball.vertices * outer, ball.vertices * inner]) + np.asarray(centre, np.float32)
    triangles = np.concatenate([ball.triangles, ball.triangles[:, ::-1] + len(ball.vertices)])
    return Mesh(vertices.astype(np.float32), triangles.astype(np.int32))


def area(mesh):
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()


def square(count=10):
    axis = np.linspace(0.0, 1.0, count + 1)
    vertices = np.stack([*np.meshgrid(axis, axis, indexing="ij"), np.zeros((count + 1,) * 2)], axis=-1).reshape(-1, 3)
    at = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.0, 4.0])
def test_a_mesh_is_cut_exactly_along_a_straight_line(turn):
    vertices, triangles = square()
    value = (vertices[:, 0] - 0.5) * np.cos(turn) + (vertices[:, 1] - 0.5) * np.sin(turn) + 1e-3
    cut = Mesh(*cut_mesh(vertices, triangles, value))
    # the half of the square above the line, and 1e-3 more over a length of 1 to 1.41
    assert area(cut) == pytest.approx(0.5, abs=3e-3)
    kept = (cut.vertices[:, 0] - 0.5) * np.cos(turn) + (cut.vertices[:, 1] - 0.5) * np.sin(turn) + 1e-3
    assert kept.min() > -0.025 * 0.1 * 1.5  # cuts keep 2 % of an edge away from its ends
    corners = cut.vertices[cut.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()


def test_cut_triangles_share_their_new_vertices():
    vertices, triangles = square()
    cut = Mesh(*cut_mesh(vertices, triangles, 0.47 - vertices[:, 0] + 0.1 * vertices[:, 1]))
    edges = np.sort(
        np.concatenate([cut.triangles[:, [0, 1]], cut.triangles[:, [1, 2]], cut.triangles[:, [2, 0]]]), axis=1
    )
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert counts.max() == 2
    # a disc: V - E + F = 1
    assert len(cut.vertices) - len(counts) + len(cut.triangles) == 1


def test_all_or_nothing():
    vertices, triangles = square()
    whole = cut_mesh(vertices, triangles, np.ones(len(vertices)))
    assert len(whole[0]) == len(vertices) and len(whole[1]) == len(triangles)
    assert len(cut_mesh(vertices, triangles, -np.ones(len(vertices)))[1]) == 0


def test_the_outer_surface_is_kept_and_the_inner_removed():
    shell = thick_dome()
    everywhere = [View(v.name, v.image, np.ones_like(v.mask), v.camera) for v in views(dome(0.14))]
    opened = clip_shape(shell, everywhere, HEAD)
    assert np.linalg.norm(opened.vertices, axis=1).min() > 0.135
    assert area(opened) == pytest.approx(4.0 * np.pi * 0.14**2, rel=0.01)


def test_what_a_view_sees_outside_its_mask_is_clipped_at_the_border():
    shell = thick_dome()
    front = view("front", shell)
    rows = np.arange(front.mask.shape[0])[:, None]
    border = 0.03 + (120.0 - 130.0) * 0.5 / 240  # metres of height at row 130
    upper = View("front", front.image, front.mask & (rows < 130), front.camera)
    opened = clip_shape(shell, [upper], HEAD)
    before = opened.vertices[opened.vertices[:, 1] < -0.05]
    behind = opened.vertices[opened.vertices[:, 1] > 0.05]
    assert before[:, 2].min() == pytest.approx(border, abs=2.5 * 0.5 / 240)  # the slack of 1.5 pixels, and the grain
    assert behind[:, 2].min() < -0.12  # hidden from this view


def test_the_side_that_is_in_the_head_is_cut_off():
    shell = thick_dome(0.05, 0.12, (0.0, 0.06, 0.0))  # comes out of the head behind, lies in it in front
    everywhere = [View(v.name, v.image, np.ones_like(v.mask), v.camera) for v in views(dome(0.14))]
    opened = clip_shape(shell, everywhere, HEAD)
    assert np.linalg.norm(opened.vertices, axis=1).min() > 0.097


def test_the_seen_side_of_hair_beside_the_neck_is_kept_when_wanted():
    curtain = dome(1.0)
    slab = curtain.vertices * np.array([0.12, 0.01, 0.2], np.float32) + np.array([0.0, 0.15, -0.25], np.float32)
    cap = dome(0.12)
    shell = Mesh(cap.vertices + np.array([0.0, 0.0, 0.03], np.float32), cap.triangles)
    both = Mesh(
        np.concatenate([shell.vertices, slab]),
        np.concatenate([shell.triangles, curtain.triangles + np.int32(len(shell.vertices))]),
    )
    sample = views(both)
    with_seen, without = clip_shape(both, sample, HEAD), clip_shape(both, sample, HEAD, keep_seen=False)
    # the curtain hangs behind; its side towards the head is what the front sees
    facing = [((mesh.vertices[:, 1] < 0.147) & (mesh.vertices[:, 2] < -0.17)).sum() for mesh in (with_seen, without)]
    assert facing[0] > 50 and facing[1] < 0.75 * facing[0]


def test_small_pieces_are_left_out():
    shell, ball = thick_dome(), sphere_head(0.004, (0.0, -0.2, 0.1), n_rings=6)
    both = Mesh(
        np.concatenate([shell.vertices, ball.vertices]),
        np.concatenate([shell.triangles, ball.triangles + np.int32(len(shell.vertices))]),
    )
    opened = clip_shape(both, views(both), HEAD)
    assert np.linalg.norm(opened.vertices, axis=1).max() < 0.15
    assert boundary_edges(both.triangles) == 0


def test_nothing_left_is_an_empty_mesh():
    shell = thick_dome(0.05, 0.08)  # all in the head
    assert len(clip_shape(shell, views(dome(0.14)), HEAD).triangles) == 0
