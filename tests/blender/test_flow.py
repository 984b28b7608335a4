"""Extract Flow, Apply Flow and live flows: edits of the flow by any tool, and what survives."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Matrix

N_POINTS = 16
# float32 positions within half a metre of the origin
ROUNDING = 1e-7


def wisp_groom(name: str = "Hair", seed: int = 0) -> bpy.types.Object:
    """300 wavy strands with two levels of wisps by azimuth, 24 and 6, set without clustering."""
    points = scenes.wavy_strands(n_points=N_POINTS, seed=seed)
    hair = scenes.groom(points, name)
    azimuth = np.arctan2(points[:, 0, 1], points[:, 0, 0]) / (2 * np.pi) % 1.0
    labels = [(azimuth * 24).astype(np.int32), (azimuth * 6).astype(np.int32)]
    scenes.module("bridge.wisps").write_labels(hair, labels)
    return hair


def extract(hair: bpy.types.Object, **options: int) -> bpy.types.Object:
    scenes.activate(hair)
    assert bpy.ops.hairloom.extract_flow(**options) == {"FINISHED"}
    return bpy.context.object


def apply(obj: bpy.types.Object, **options: bool) -> None:
    scenes.activate(obj)
    assert bpy.ops.hairloom.apply_flow(**options) == {"FINISHED"}


def strands(obj: bpy.types.Object) -> np.ndarray:
    """(S, N, 3) world space."""
    world = np.array(obj.matrix_world)
    points = scenes.positions(obj).astype(np.float64) @ world[:3, :3].T + world[:3, 3]
    return points.reshape(len(obj.data.curves), -1, 3)


def set_positions(obj: bpy.types.Object, points: np.ndarray) -> None:
    obj.data.position_data.foreach_set("vector", np.ascontiguousarray(points, np.float32).ravel())
    obj.data.update_tag()


def bend(flow: bpy.types.Object, only: list[int] | None = None) -> None:
    """Turn each flow strand about z through its root, more and more towards the tip."""
    points = scenes.positions(flow).reshape(len(flow.data.curves), -1, 3)
    angle = np.linspace(0, 1.0, points.shape[1])
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = (
        np.cos(angle),
        -np.sin(angle),
        np.sin(angle),
        np.cos(angle),
    )
    turn[:, 2, 2] = 1.0
    bent = points[:, :1] + np.einsum("nij,knj->kni", turn, points - points[:, :1])
    chosen = np.arange(len(points)) if only is None else np.array(only)
    points[chosen] = bent[chosen]
    set_positions(flow, points)


def lengths(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(points, axis=1), axis=2)


def check_moved(before: np.ndarray, after: np.ndarray, chosen: np.ndarray | None = None) -> None:
    """The chosen strands moved, with their roots and lengths as before; the others did not move at all."""
    chosen = np.ones(len(before), bool) if chosen is None else chosen
    far = np.abs(after - before).max(axis=(1, 2))
    assert far[chosen].min(initial=np.inf) > 1e-3
    assert far[~chosen].max(initial=0.0) <= ROUNDING
    np.testing.assert_allclose(after[:, 0], before[:, 0], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(lengths(after), lengths(before), rtol=2e-4, atol=4e-7)


def largest_wisps(hair: bpy.types.Object) -> np.ndarray:
    return scenes.values(hair, "hairloom_wisp_2")


@pytest.fixture
def hair():
    return wisp_groom()


# --- extract_flow


def test_the_flow_has_a_strand_for_each_of_the_largest_wisps(hair):
    before = strands(hair)
    flow = extract(hair)
    assert flow.name == "Hair Flow"
    assert strands(flow).shape == (6, 32, 3)
    assert (strands(hair) == before).all()
    for wisp, strand in enumerate(strands(flow)):
        np.testing.assert_allclose(
            strand[0], before[largest_wisps(hair) == wisp, 0].mean(axis=0), rtol=0, atol=ROUNDING
        )
    assert hair.hairloom_flow.source == flow
    assert not flow.visible_camera


def test_another_level_and_count_can_be_chosen(hair):
    assert strands(extract(hair, level=1, n_points=20)).shape == (24, 20, 3)


def test_the_flow_hangs_on_the_head_where_the_groom_does():
    head = scenes.sphere_head()
    head.rotation_euler = (0.3, 0.2, 1.0)
    hair = wisp_groom()
    bpy.context.scene.hairloom.head = head
    bpy.ops.hairloom.attach_to_head()
    flow = extract(hair)
    bpy.context.view_layer.update()
    assert flow.parent == head and flow.data.surface == head
    np.testing.assert_allclose(np.array(flow.matrix_world), np.eye(4), atol=1e-6)


def test_extracting_and_applying_are_one_undo_step_each(hair):
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.extract_flow("EXEC_DEFAULT", True)) == 1
    hair = bpy.data.objects["Hair"]
    bend(extract(hair))
    scenes.activate(hair)
    assert scenes.undo_steps(lambda: bpy.ops.hairloom.apply_flow("EXEC_DEFAULT", True)) == 1


def test_a_groom_without_wisps_says_what_to_do():
    scenes.groom()
    with pytest.raises(RuntimeError, match="The groom has no wisps yet; run Cluster Wisps first"):
        bpy.ops.hairloom.extract_flow()


def test_a_level_that_is_not_there_is_refused(hair):
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match="has 2 levels of wisps, not 4"):
        bpy.ops.hairloom.extract_flow(level=4)
    assert scenes.scene_state() == before


# --- apply_flow


def test_an_unchanged_flow_leaves_the_hair_where_it_is(hair):
    before = strands(hair)
    extract(hair)
    for _ in range(3):
        apply(hair)
    np.testing.assert_allclose(strands(hair), before, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("active", ["groom", "flow"])
def test_the_hair_goes_where_its_flow_went(hair, active):
    before = strands(hair)
    flow = extract(hair)
    bend(flow, [2, 4])
    apply(hair if active == "groom" else flow)
    check_moved(before, strands(hair), np.isin(largest_wisps(hair), [2, 4]))
    # from the same details, as often as one likes: applied again nothing moves, and the flow put back brings it back
    once = strands(hair)
    apply(hair)
    np.testing.assert_allclose(strands(hair), once, rtol=0, atol=ROUNDING)


def test_moving_the_flow_object_moves_the_hair_rigidly(hair):
    before = strands(hair)
    flow = extract(hair)
    flow.matrix_world = Matrix.Translation((0.2, -0.1, 0.3)) @ Matrix.Rotation(1.3, 4, (0.3, -0.5, 1.0))
    bpy.context.view_layer.update()
    apply(hair)
    world = np.array(flow.matrix_world)
    np.testing.assert_allclose(strands(hair), before @ world[:3, :3].T + world[:3, 3], rtol=0, atol=1e-6)


def test_a_turned_groom_object_is_written_in_its_own_space(hair):
    hair.matrix_world = Matrix.Rotation(0.8, 4, (1.0, 0.2, 0.1)) @ Matrix.Scale(2.0, 4)
    bpy.context.view_layer.update()
    before = strands(hair)
    flow = extract(hair)
    apply(hair)
    np.testing.assert_allclose(strands(hair), before, rtol=0, atol=3e-7)
    bend(flow)
    apply(hair)
    check_moved(before, strands(hair))


def test_hair_and_flow_that_moved_with_their_parent_stay_on_it():
    head = scenes.sphere_head()
    hair = wisp_groom()
    bpy.context.scene.hairloom.head = head
    bpy.ops.hairloom.attach_to_head()
    local = scenes.positions(hair)
    extract(hair)
    head.matrix_world = Matrix.Translation((0.1, 0.2, 0.0)) @ Matrix.Rotation(0.7, 4, "Y")
    bpy.context.view_layer.update()
    apply(hair)
    np.testing.assert_allclose(scenes.positions(hair), local, rtol=0, atol=1e-6)


def test_modifiers_of_the_flow_count(hair):
    before = strands(hair)
    flow = extract(hair)
    tree = bpy.data.node_groups.new("Shift", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end, shift = (tree.nodes.new(n) for n in ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeSetPosition"))
    shift.inputs["Offset"].default_value = (0.0, 0.03, 0.01)
    tree.links.new(start.outputs[0], shift.inputs["Geometry"])
    tree.links.new(shift.outputs["Geometry"], end.inputs[0])
    flow.modifiers.new("Shift", "NODES").node_group = tree
    apply(hair)
    np.testing.assert_allclose(strands(hair), before + np.array([0.0, 0.03, 0.01]), rtol=0, atol=3e-7)


def test_hair_of_a_deleted_flow_strand_stays_and_is_reported(hair, capfd):
    before = strands(hair)
    flow = extract(hair)
    flow.data.remove_curves(indices=[3])
    bend(flow)
    apply(hair)
    check_moved(before, strands(hair), largest_wisps(hair) != 3)
    stayed = int((largest_wisps(hair) == 3).sum())
    assert f"{stayed} stayed, their flow strands are gone" in capfd.readouterr().out


def test_another_grooms_flow_is_refused(hair):
    other = wisp_groom("Other", seed=1)
    flow = extract(other)
    extract(hair)
    hair.hairloom_flow.source = flow
    scenes.activate(hair)
    before = scenes.scene_state()
    with pytest.raises(
        RuntimeError, match=r"none of the 6 flow strands belongs to this hair; .*run Extract Flow again"
    ):
        bpy.ops.hairloom.apply_flow()
    assert scenes.scene_state() == before


def test_without_a_flow_apply_says_what_to_do(hair):
    with pytest.raises(RuntimeError, match="The groom has no flow yet; run Extract Flow first"):
        bpy.ops.hairloom.apply_flow()
    flow = extract(hair)
    bpy.data.objects.remove(flow)
    scenes.activate(hair)
    with pytest.raises(RuntimeError, match="The groom's flow is gone; choose another"):
        bpy.ops.hairloom.apply_flow()


def test_a_groom_that_was_edited_since_is_not_overwritten(hair):
    original = strands(hair)
    bend(extract(hair), [1])
    edited = original.copy()
    edited[:7, -3:] += 0.004
    set_positions(hair, edited)
    scenes.activate(hair)
    before = scenes.scene_state()
    with pytest.raises(RuntimeError, match=r"7 strands of 'Hair' were edited since .*run Extract Flow again to keep"):
        bpy.ops.hairloom.apply_flow()
    assert scenes.scene_state() == before
    apply(hair, discard_edits=True)
    check_moved(original, strands(hair), largest_wisps(hair) == 1)
    # extracted again, the edits are part of the hair
    set_positions(hair, edited)
    extract(hair)
    apply(hair)
    np.testing.assert_allclose(strands(hair), edited, rtol=0, atol=ROUNDING)


def test_hair_grows_with_its_flow_when_asked(hair):
    before = strands(hair)
    flow = extract(hair)
    points = strands(flow)
    set_positions(flow, points[:, :1] + 1.4 * (points - points[:, :1]))
    apply(hair)
    np.testing.assert_allclose(lengths(strands(hair)), lengths(before), rtol=2e-4, atol=4e-7)
    hair.hairloom_flow.follow_length = True
    apply(hair)
    np.testing.assert_allclose(lengths(strands(hair)), 1.4 * lengths(before), rtol=3e-4, atol=4e-7)


# --- what survives


def test_details_and_link_survive_saving(hair, tmp_path):
    before = strands(hair)
    extract(hair)
    scenes.reload(tmp_path)
    hair, flow = bpy.data.objects["Hair"], bpy.data.objects["Hair Flow"]
    assert hair.hairloom_flow.source == flow
    bend(flow)
    apply(hair)
    check_moved(before, strands(hair))


def test_a_duplicate_of_groom_and_flow_follows_its_own_flow(hair):
    before = strands(hair)
    flow = extract(hair)
    for obj in (hair, flow):
        obj.select_set(True)
    bpy.ops.object.duplicate()
    copy, flow_copy = bpy.data.objects["Hair.001"], bpy.data.objects["Hair Flow.001"]
    assert copy.hairloom_flow.source == flow_copy
    bend(flow_copy)
    apply(copy)
    apply(hair)
    check_moved(before, strands(copy))
    check_moved(before, strands(hair), np.zeros(len(before), bool))


def test_joined_grooms_follow_joined_flows_and_each_flow_alone(hair):
    other = wisp_groom("Other", seed=1)
    other.location.x = 0.5
    bpy.context.view_layer.update()
    before = np.concatenate([strands(hair), strands(other)])
    flow, other_flow = extract(hair), extract(other)
    scenes.activate(hair)
    other.select_set(True)
    bpy.ops.object.join()
    bend(other_flow)
    apply(hair)
    check_moved(before, strands(hair), np.zeros(len(before), bool))
    hair.hairloom_flow.source = other_flow
    apply(hair)
    check_moved(before, strands(hair), np.arange(len(before)) >= 300)
    scenes.activate(flow)
    other_flow.select_set(True)
    bpy.ops.object.join()
    bend(flow)
    hair.hairloom_flow.source = flow
    apply(hair)
    check_moved(before, strands(hair))


def test_strands_joined_from_a_groom_without_flow_stay(hair):
    before = strands(hair)
    flow = extract(hair)
    plain = scenes.groom(scenes.wavy_strands(n_points=N_POINTS, seed=2), "Plain")
    before = np.concatenate([before, strands(plain)])
    scenes.activate(hair)
    plain.select_set(True)
    bpy.ops.object.join()
    bend(flow)
    apply(hair)
    check_moved(before, strands(hair), np.arange(len(before)) < 300)


# --- live


def problems() -> list[str]:
    return list(scenes.module("live_flow").live.problems.values())


def test_live_hair_follows_every_update_of_the_flow(hair):
    before = strands(hair)
    flow = extract(hair)
    hair.hairloom_flow.is_live = True
    for only in ([0], [5]):
        bend(flow, only)
        bpy.context.view_layer.update()
    check_moved(before, strands(hair), np.isin(largest_wisps(hair), [0, 5]))
    assert problems() == []
    by_hand = strands(hair)
    apply(hair)
    np.testing.assert_allclose(strands(hair), by_hand, rtol=0, atol=ROUNDING)


def test_switching_live_on_brings_the_hair_at_once_and_off_leaves_it(hair):
    before = strands(hair)
    flow = extract(hair)
    bend(flow, [1])
    bpy.context.view_layer.update()
    check_moved(before, strands(hair), np.zeros(300, bool))
    hair.hairloom_flow.is_live = True
    check_moved(before, strands(hair), largest_wisps(hair) == 1)
    hair.hairloom_flow.is_live = False
    bend(flow, [2])
    bpy.context.view_layer.update()
    check_moved(before, strands(hair), largest_wisps(hair) == 1)


def test_live_works_while_the_flow_is_in_sculpt_mode(hair):
    before = strands(hair)
    flow = extract(hair)
    hair.hairloom_flow.is_live = True
    bpy.ops.object.mode_set(mode="SCULPT_CURVES")
    bend(flow)
    bpy.context.view_layer.update()
    check_moved(before, strands(hair))


def test_live_does_not_overwrite_edits_of_the_hair_and_says_so(hair):
    flow = extract(hair)
    hair.hairloom_flow.is_live = True
    bend(flow, [0])
    bpy.context.view_layer.update()
    edited = strands(hair)
    edited[:5, -1] += 0.01
    set_positions(hair, edited)
    bend(flow, [1])
    bpy.context.view_layer.update()
    np.testing.assert_allclose(strands(hair), edited, rtol=0, atol=ROUNDING)
    assert len(problems()) == 1 and "5 strands of 'Hair' were edited since" in problems()[0]
    scenes.activate(hair)
    bpy.ops.hairloom.extract_flow()
    assert problems() == []


def test_undo_of_the_flows_edit_takes_live_hair_back(hair):
    extract(hair)
    hair.hairloom_flow.is_live = True
    before = strands(hair)
    bpy.ops.ed.undo_push(message="before")
    bend(bpy.data.objects["Hair Flow"])
    bpy.context.view_layer.update()
    bpy.ops.ed.undo_push(message="bent")
    bent = strands(bpy.data.objects["Hair"])
    bpy.ops.ed.undo()
    bpy.context.view_layer.update()
    np.testing.assert_allclose(strands(bpy.data.objects["Hair"]), before, rtol=0, atol=ROUNDING)
    bpy.ops.ed.redo()
    bpy.context.view_layer.update()
    np.testing.assert_allclose(strands(bpy.data.objects["Hair"]), bent, rtol=0, atol=ROUNDING)
    assert problems() == []


def test_live_hair_follows_an_animated_flow(hair):
    before = strands(hair)
    flow = extract(hair)
    hair.hairloom_flow.is_live = True
    for frame, x in ((1, 0.0), (11, 0.2)):
        flow.location.x = x
        flow.keyframe_insert("location", frame=frame)
    for frame, x in ((11, 0.2), (1, 0.0)):
        bpy.context.scene.frame_set(frame)
        np.testing.assert_allclose(strands(hair), before + np.array([x, 0.0, 0.0]), rtol=0, atol=3e-7)


def test_a_parent_that_moves_both_writes_nothing(monkeypatch):
    head = scenes.sphere_head()
    hair = wisp_groom()
    bpy.context.scene.hairloom.head = head
    bpy.ops.hairloom.attach_to_head()
    extract(hair)
    hair.hairloom_flow.is_live = True
    bridge = scenes.module("bridge.flow")
    monkeypatch.setattr(bridge, "_write_points", lambda *_: pytest.fail("wrote"))
    head.location.x = 1.0
    bpy.context.view_layer.update()
    assert problems() == []


# --- panel


def test_the_panel_leads_from_step_to_step(hair):
    panels = scenes.module("ui.flow_panel")
    drawn: list[str] = []

    class Layout(SimpleNamespace):
        def column(self, **_):
            return self

        def label(self, text="", icon=""):
            drawn.append(text)

        def operator(self, name, **_):
            drawn.append(name)

        def prop(self, link, name, **_):
            drawn.append(name)

    def draw() -> str:
        drawn.clear()
        panel = panels.HAIRLOOM_PT_flow
        stand_in = SimpleNamespace(layout=Layout(), _draw_link=lambda *a: panel._draw_link(stand_in, *a))
        panel.draw(stand_in, bpy.context)
        return " ".join(drawn)

    assert draw() == "hairloom.extract_flow"
    flow = extract(hair)
    assert draw().startswith("Hair source is_live follow_length hairloom.apply_flow Edit these strands")
    scenes.activate(hair)
    assert draw() == "hairloom.extract_flow source is_live follow_length hairloom.apply_flow"
    bpy.data.objects.remove(flow)
    assert "The groom's flow is gone" in draw()
    scenes.groom(name="Plain")
    assert "run Cluster Wisps first" in draw()
