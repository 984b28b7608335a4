"""The comb in Blender's window: drags, undo and redo, Esc, symmetry, radius by F, every mode; run by run.py."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "blender")]

import bpy  # noqa: E402
import driver  # noqa: E402
import numpy as np  # noqa: E402
import scenes  # noqa: E402
import stage  # noqa: E402
from combing import check_strands, hair, lengths, moved, offsets, on_screen, positions, settings, undo_to, world  # noqa: E402
from mathutils import Euler, Matrix, Vector  # noqa: E402

LIMIT_SECONDS = 1500
TOOL = "hairloom.comb_tool"


def active_tool(mode: str) -> str:
    return bpy.context.workspace.tools.from_space_view3d_mode(mode).idname


def path(user: driver.User, across: float = 0.0, length: float = 160.0, steps: int = 16) -> list[tuple[float, float]]:
    """A drag downwards and outwards over the hair, `across` pixels beside its middle."""
    middle = np.median(on_screen(user, world()), axis=0) + np.array([across, 60.0])
    way = np.linspace(0.0, 1.0, steps)[:, None] * np.array([length * (1 if across >= 0 else -1), -0.25 * length])
    return [(float(x), float(y)) for x, y in middle + way]


def prepare(user: driver.User) -> driver.Steps:
    yield from stage.set_the_scene(user)
    with user.override():
        assert bpy.ops.hairloom.cluster_wisps() == {"FINISHED"}
        bpy.ops.ed.undo_push(message="Cluster")
    yield 0.5


def the_button_activates_the_tool(user: driver.User) -> driver.Steps:
    assert active_tool("OBJECT") != TOOL
    yield from user.press("bpy.ops.wm.tool_set_by_id(")
    assert active_tool("OBJECT") == TOOL
    yield from user.into_view()


def a_drag_combs_and_undo_and_redo_are_exact(user: driver.User) -> driver.Steps:
    before = positions()
    yield from user.picture("comb_before")
    yield from user.drag(path(user))
    after = positions()
    assert (moved(before, after) > 1e-3).sum() > 100, "the drag combed nothing"
    check_strands(before, after)
    yield from user.picture("comb_after")
    yield from undo_to(user, before)
    yield from undo_to(user, after, redo=True)
    yield from undo_to(user, before)


def escape_puts_the_hair_back(user: driver.User) -> driver.Steps:
    before = positions()
    yield from user.drag(path(user), release=False)
    assert moved(before, positions()).max() > 1e-3, "nothing moved before Esc"
    yield from user.picture("comb_running")
    yield from user.key("ESC")
    yield from user.wait(lambda: positions().tobytes() == before.tobytes(), 60, "Esc puts every point back")
    user.event("LEFTMOUSE", "RELEASE")
    yield 0.2
    yield from user.drag(path(user), release=False)
    user.event("RIGHTMOUSE", "PRESS")
    yield 0.2
    user.event("RIGHTMOUSE", "RELEASE")
    user.event("LEFTMOUSE", "RELEASE")
    yield from user.wait(lambda: positions().tobytes() == before.tobytes(), 60, "so does the right mouse button")


def a_click_makes_no_undo_step(user: driver.User) -> driver.Steps:
    before = positions()
    yield from user.drag(path(user))
    combed = positions()
    yield from user.click(*path(user)[0])
    yield 1.0
    assert positions().tobytes() == combed.tobytes()
    yield from undo_to(user, before)


def live_and_replayed_are_the_same_bytes(user: driver.User) -> driver.Steps:
    """On an object that is turned and scaled, where world space is not its own."""
    for matrix in (Matrix(), Matrix.LocRotScale(Vector((0.01, 0.02, 0)), Euler((0, 0, 0.2)), Vector((1.05, 1, 0.95)))):
        hair().matrix_world = matrix
        yield 0.3
        with user.override():
            bpy.ops.ed.undo_push(message="Place")
        before = positions()
        yield from user.drag(path(user, across=-40))
        live = positions().tobytes()
        assert live != before.tobytes()
        stroke = bpy.context.window_manager.operators[-1].stroke
        assert len(stroke) > 500, "the stroke is not among the operator's properties"
        yield from undo_to(user, before)
        with user.override():
            assert bpy.ops.hairloom.comb("EXEC_DEFAULT", True, stroke=stroke) == {"FINISHED"}
        assert positions().tobytes() == live, "the replay differs from the live stroke"
        yield from undo_to(user, before)
    hair().matrix_world = Matrix()
    with user.override():
        bpy.ops.ed.undo_push(message="Place")
    yield 0.3


def make_symmetric() -> int:
    """Replace the left half of the hair by the right one seen in a mirror; returns the points of each half."""
    curves, strands = scenes.module("bridge.curves"), scenes.module("backend.geometry.strands")
    whole = curves.read_strands(hair())
    right = strands.select_strands(whole, whole.roots[:, 0] > 0.002)
    labels = {
        name: of_strand + of_strand.max() + 1 for name, of_strand in right.strand_attributes.items() if "wisp" in name
    }
    left = type(right)(
        right.points * np.float32([-1, 1, 1]),
        right.offsets,
        right.point_attributes,
        {**right.strand_attributes, **labels},
    )
    curves.replace_strands(hair(), strands.join_strands([right, left]))
    return len(right.points)


def mirroring_combs_both_sides(user: driver.User) -> driver.Steps:
    n_whole = len(hair().data.points)
    with user.override():
        n_points = make_symmetric()
        hair().data.use_mirror_x = True
        bpy.ops.view3d.view_axis(type="FRONT")
        bpy.ops.ed.undo_push(message="Symmetric")
    yield 1.5
    before = positions()
    yield from user.drag(path(user, across=60))
    after = positions()
    right, left = after[:n_points], after[n_points:] * np.float32([-1, 1, 1])
    way = moved(before, after)[:n_points]
    assert (way > 1e-3).sum() > 100
    differences = np.linalg.norm(right - left, axis=1)[way > 1e-3]
    print(
        f"mirrored: {differences.size:,} points differ by {1000 * np.median(differences):.3f} mm (median)", flush=True
    )
    # each side's wisps get in the way of its own only, but rounding decides on which hair is gripped at the brush's rim
    assert np.percentile(differences, 90) < 0.002
    yield from user.picture("comb_mirrored")
    yield from undo_to(user, before)
    hair().data.use_mirror_x = False
    yield from user.drag(path(user, across=60))
    way = moved(before, positions())
    # hair may have grown across the middle: what counts is where it lies; neighbouring wisps go along a little
    right, left = way[before[:, 0] > 0.01], way[before[:, 0] < -0.01]
    counts, ways = [int((side > 1e-3).sum()) for side in (right, left)], [float(side.sum()) for side in (right, left)]
    words = (
        f"without mirroring {counts[0]} and {counts[1]} points moved right and left, {ways[0]:.2f} and {ways[1]:.2f} m"
    )
    print(words, flush=True)
    assert counts[0] > 100 and ways[0] > 3 * ways[1], words
    yield from undo_to(user, before)
    yield from user.key("Z", ctrl=True)
    yield from user.wait(lambda: len(hair().data.points) == n_whole, 60, "the whole groom is back")


def f_sets_the_radius_and_shift_f_the_strength(user: driver.User) -> driver.Steps:
    for name, shift in (("radius", False), ("strength", True)):
        setattr(settings(), name, {"radius": 50.0, "strength": 0.5}[name])
        before = getattr(settings(), name)
        yield from user.into_view()
        user.event("F", "PRESS", shift=shift)
        yield 0.2
        user.event("F", "RELEASE", shift=shift)
        x, y = user.place
        for step in range(1, 6):
            user.move(x + 8 * step, y)
            yield 0.1
        if name == "radius":
            yield from user.picture("comb_radius")
        user.event("LEFTMOUSE", "PRESS")
        yield 0.1
        user.event("LEFTMOUSE", "RELEASE")
        yield 0.3
        after = getattr(settings(), name)
        print(f"{name}: {before} -> {after}", flush=True)
        assert after > before, f"F does not change the {name}"
    settings().radius, settings().strength = 50.0, 1.0


def out_of_the_head(points: np.ndarray) -> np.ndarray:
    """Distance from the middle of the roots: larger is farther out."""
    roots = points[offsets()[:-1]]
    return np.linalg.norm(points - roots.mean(axis=0), axis=1)


def bends(points: np.ndarray) -> float:
    """Mean length of the second differences along strands: how curly the hair is."""
    starts = offsets()
    second = np.linalg.norm(points[2:] - 2 * points[1:-1] + points[:-2], axis=1)
    inside = np.ones(len(points), bool)
    inside[starts[:-1]] = inside[starts[1:] - 1] = False
    return float(second[inside[1:-1]].mean())


def every_mode_does_its_work(user: driver.User) -> driver.Steps:
    with user.override():
        bpy.ops.view3d.view_axis(type="LEFT")
    yield 1.5
    before = positions()
    done: dict[tuple[str, bool], np.ndarray] = {}
    for mode in ("comb", "lift", "twist", "smooth", "length"):
        for invert in (False, True) if mode in {"lift", "twist", "length"} else (False,):
            settings().mode = mode
            yield from user.drag(path(user, length=110), ctrl=invert)
            after = positions()
            assert (moved(before, after) > 5e-4).sum() > 500, f"{mode} moved next to nothing"
            check_strands(before, after, resized=mode == "length")
            done[mode, invert] = after
            yield from user.picture(f"comb_mode_{mode}{'_inverted' if invert else ''}")
            yield from undo_to(user, before)
    settings().mode = "comb"
    touched = moved(before, done["lift", False]) > 1e-4
    out = {
        key: float((out_of_the_head(points) - out_of_the_head(before))[touched].mean()) for key, points in done.items()
    }
    assert out["lift", False] > 0 > out["lift", True], out
    starts = offsets()
    grown = {invert: lengths(done["length", invert], starts).sum() for invert in (False, True)}
    assert grown[False] > lengths(before, starts).sum() > grown[True]
    assert (done["twist", False] != done["twist", True]).any()


def shift_smooths(user: driver.User) -> driver.Steps:
    before = positions()
    yield from user.drag(path(user), shift=True)
    stroke = scenes.module("backend.editing.strokes").stroke_from_json(bpy.context.window_manager.operators[-1].stroke)
    assert stroke.params.mode == "smooth"
    assert settings().mode == "comb"
    check_strands(before, positions())
    yield from undo_to(user, before)


def it_works_in_sculpt_mode(user: driver.User) -> driver.Steps:
    with user.override():
        bpy.ops.object.mode_set(mode="SCULPT_CURVES")
        bpy.ops.ed.undo_push(message="Sculpt Mode")
    yield 1.0
    with user.override():
        bpy.ops.wm.tool_set_by_id(name=TOOL)
    yield 0.5
    assert active_tool("SCULPT_CURVES") == TOOL
    before = positions()
    yield from user.drag(path(user))
    after = positions()
    assert (moved(before, after) > 1e-3).sum() > 100, "the drag combed nothing in Sculpt Mode"
    assert bpy.context.window_manager.operators[-1].bl_idname == "HAIRLOOM_OT_comb"
    yield from user.picture("comb_sculpt_mode")
    yield from undo_to(user, before)
    with user.override():
        bpy.ops.object.mode_set(mode="OBJECT")
    yield 0.5


def test(user: driver.User) -> driver.Steps:
    for part in (
        prepare, the_button_activates_the_tool, a_drag_combs_and_undo_and_redo_are_exact, escape_puts_the_hair_back,
        a_click_makes_no_undo_step, live_and_replayed_are_the_same_bytes, mirroring_combs_both_sides,
        f_sets_the_radius_and_shift_f_the_strength, every_mode_does_its_work, shift_smooths, it_works_in_sculpt_mode,
    ):  # fmt: skip
        yield from part(user)
        print(f"passed: {part.__name__.replace('_', ' ')}", flush=True)


bpy.context.preferences.view.show_splash = False
driver.run(test, LIMIT_SECONDS)
