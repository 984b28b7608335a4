"""What the simulation reads of a scene: motion of heads that move and bend, colliders, force fields, gravity, units."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Matrix

FRAMES = 6


@pytest.fixture
def groom():
    """60 wavy strands on the ball, attached; a range of 6 frames from 3 on."""
    head = scenes.sphere_head()
    bpy.context.scene.hairloom.head = head
    obj = scenes.groom(scenes.wavy_strands(60))
    bpy.ops.hairloom.attach_to_head()
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 3, 3 + FRAMES - 1
    bpy.context.scene.frame_set(3)
    return obj


def head() -> bpy.types.Object:
    return bpy.context.scene.hairloom.head


def read(obj, colliders=(), **options):
    options = {"friction": 0.3, "air_speed": 1.0} | options
    return scenes.module("bridge.simulation").read_scene(bpy.context, obj, head(), list(colliders), **options)


def turn(obj, degrees: float) -> None:
    """Turn about z by so many degrees a frame, and move up a centimetre a frame."""
    for number in range(FRAMES):
        obj.rotation_euler = (0.0, 0.0, math.radians(degrees * number))
        obj.location.z = 0.01 * number
        for path in ("rotation_euler", "location"):
            obj.keyframe_insert(path, frame=3 + number)


def bend(deform) -> None:
    """A shape key of the head, 0 at the first frame and 1 at the last; `deform` takes (V, 3) points to others."""
    head().shape_key_add(name="Basis")
    key = head().shape_key_add(name="Bent")
    points = np.array([v.co for v in head().data.vertices])
    key.data.foreach_set("co", deform(points).astype(np.float32).ravel())
    key.value = 0.0
    key.keyframe_insert("value", frame=3)
    key.value = 1.0
    key.keyframe_insert("value", frame=3 + FRAMES - 1)
    key.value = 0.0


def on_bone(rigid_share: float = 1.0) -> None:
    """Skin the head to a bone that nods by 30 degrees; `rigid_share`: weight of the lower half of the ball."""
    armature = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.collection.objects.link(armature)
    scenes.activate(armature)
    bpy.ops.object.mode_set(mode="EDIT")
    bone = armature.data.edit_bones.new("Neck")
    bone.head, bone.tail = (0, 0, -0.1), (0, 0, 0.1)
    bpy.ops.object.mode_set(mode="OBJECT")
    group = head().vertex_groups.new(name="Neck")
    for vertex in head().data.vertices:
        group.add([vertex.index], 1.0 if vertex.co.z > -0.05 else rigid_share, "REPLACE")
    modifier = head().modifiers.new("Rig", "ARMATURE")
    modifier.object = armature
    pose = armature.pose.bones["Neck"]
    pose.rotation_mode = "XYZ"
    for frame, angle in ((3, 0.0), (3 + FRAMES - 1, math.radians(30.0))):
        pose.rotation_euler = (angle, 0.0, 0.0)
        pose.keyframe_insert("rotation_euler", frame=frame)
    bpy.context.scene.frame_set(3)


def test_strands_are_in_the_world_at_the_first_frame(groom):
    turn(head(), 10.0)
    bpy.context.scene.frame_set(6)
    found = read(groom)
    bpy.context.scene.frame_set(3)
    assert np.abs(found.strands.points - scenes.module("bridge.curves").read_strands(groom).points).max() < 1e-7


def test_the_frame_is_kept(groom):
    bpy.context.scene.frame_set(5, subframe=0.25)
    read(groom)
    assert (bpy.context.scene.frame_current, bpy.context.scene.frame_subframe) == (5, 0.25)


def test_the_frame_is_kept_when_something_is_refused(groom):
    bpy.context.scene.frame_set(5)
    empty = bpy.data.objects.new("Empty", bpy.data.meshes.new("Empty"))
    bpy.context.collection.objects.link(empty)
    with pytest.raises(scenes.module("backend.errors").InputError, match="'Empty' has no faces at frame 3"):
        read(groom, [empty])
    assert bpy.context.scene.frame_current == 5


def test_motion_is_that_of_the_head(groom):
    turn(head(), 10.0)
    found = read(groom).scene
    assert (found.n_frames, found.frame_start, found.fps) == (FRAMES, 3, 24.0)
    expected = Matrix.Translation((0, 0, 0.05)) @ Matrix.Rotation(math.radians(50.0), 4, "Z")
    assert np.abs(found.motion[-1] - np.array(expected)).max() < 1e-6
    assert len(found.root_motion) == 0
    # the head does not bend: one shape, which moves
    assert found.colliders[0].vertices.ndim == 2
    assert np.abs(found.colliders[0].matrices - found.motion).max() < 1e-7


def test_the_cache_s_space_is_the_groom_s(groom):
    turn(head(), 10.0)
    groom.scale = (2.0, 2.0, 2.0)
    found = read(groom)
    bpy.context.scene.frame_set(8)
    assert np.abs(found.object_motion[-1] - np.array(groom.matrix_world)).max() < 1e-7


def test_without_a_head_the_roots_move_with_the_groom(groom):
    bpy.context.scene.hairloom.head = None
    groom.data.surface = groom.parent = None
    turn(groom, 10.0)
    reading = scenes.module("bridge.simulation").read_scene(bpy.context, groom, None, [], friction=0.3, air_speed=1.0)
    assert abs(reading.scene.motion[-1][2, 3] - 0.05) < 1e-6
    assert reading.scene.colliders == ()


def test_a_scalp_on_one_bone_moves_rigidly(groom):
    """The object of the head stands still, and its lower half is not on the bone."""
    on_bone(rigid_share=0.0)
    found = read(groom).scene
    assert len(found.root_motion) == 0
    assert found.colliders[0].vertices.ndim == 3
    pivot = np.array([0.0, 0.0, -0.1])
    moved = found.motion[-1] @ np.linalg.inv(found.motion[0])
    assert np.abs(moved[:3, :3] @ pivot + moved[:3, 3] - pivot).max() < 1e-5
    assert abs(np.degrees(np.arccos((np.trace(moved[:3, :3]) - 1) / 2)) - 30.0) < 1e-2


def test_roots_ride_on_a_scalp_that_bends(groom):
    bend(lambda points: points * [1.0, 1.0, 1.3])
    reading = read(groom)
    found, roots = reading.scene, reading.strands.roots.astype(np.float64)
    assert found.root_motion.shape == (FRAMES, 60, 3, 4)
    # a root on the ball goes where the ball's point goes; the faces are flat, and roots 0.1 mm off them
    last = found.root_motion[-1]
    moved = np.einsum("sij,sj->si", last[:, :, :3], roots) + last[:, :, 3]
    assert np.abs(moved - roots * [1.0, 1.0, 1.3]).max() < 3e-4
    identity = np.abs(found.root_motion[0] - np.eye(3, 4)).max()
    assert identity < 1e-6
    assert np.abs(np.linalg.det(last[:, :, :3]) - 1).max() < 1e-9


def test_roots_turn_with_the_skin(groom):
    """A shear in z along x by 0.5 turns the skin at the top about y; normals go where the skin's normals go."""
    bend(lambda points: points + np.outer(points[:, 0], [0.0, 0.0, 0.5]))
    reading = read(groom)
    found, roots = reading.scene, reading.strands.roots.astype(np.float64)
    normals = roots / np.linalg.norm(roots, axis=1)[:, None]
    shear = np.array([[1.0, 0, 0], [0, 1, 0], [0.5, 0, 1]])
    skin = normals @ np.linalg.inv(shear)
    skin /= np.linalg.norm(skin, axis=1)[:, None]
    turned = np.einsum("sij,sj->si", found.root_motion[-1][:, :, :3], normals)
    # the ball's normals are not its faces', which differ by up to 4 degrees
    assert (turned * skin).sum(axis=1).min() > math.cos(math.radians(8.0))
    assert (turned * normals).sum(axis=1).min() < math.cos(math.radians(20.0))


def test_a_collider_that_bends_has_a_shape_for_each_frame(groom):
    bend(lambda points: points * 1.2)
    found = read(groom).scene.colliders[0]
    assert found.vertices.shape[0] == FRAMES
    size = np.linalg.norm(found.vertices, axis=2).mean(axis=1)
    assert abs(size[-1] / size[0] - 1.2) < 1e-4


def test_the_scale_of_an_object_is_in_its_shape(groom):
    box = cube("Box")
    box.scale, box.location = (0.1, 0.2, -0.3), (0.5, 0.0, 0.0)
    bpy.context.view_layer.update()
    found = read(groom, [box]).scene.colliders[1]
    assert np.abs(np.ptp(found.vertices, axis=0) - [0.2, 0.4, 0.6]).max() < 1e-6
    assert np.abs(found.matrices[:, :3, :3] @ found.matrices[:, :3, :3].transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    # a mirrored box still has its faces outwards
    corners = found.vertices[found.triangles].astype(np.float64)
    assert np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() > 0


def cube(name: str) -> bpy.types.Object:
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.name = name
    return bpy.context.object


def test_a_collider_of_changing_topology_is_refused(groom):
    box = cube("Box")
    modifier = box.modifiers.new("Array", "ARRAY")
    for frame, count in ((3, 1), (6, 2)):
        modifier.count = count
        modifier.keyframe_insert("count", frame=frame)
    error = scenes.module("backend.errors").InputError
    with pytest.raises(error, match="'Box' has other points or faces at frame") as caught:
        read(groom, [box])
    assert "\n" not in str(caught.value)


def test_the_head_may_be_no_collider(groom):
    assert read(groom, collide_head=False).scene.colliders == ()


# --- air and gravity ---------------------------------------------------------------------------------------------


def field(kind: str, name: str, **settings) -> bpy.types.Object:
    bpy.ops.object.effector_add(type=kind, location=(0.0, -1.0, 0.5), rotation=(math.radians(90.0), 0.0, 0.0))
    obj = bpy.context.object
    obj.name = name
    for setting, value in settings.items():
        setattr(obj.field, setting, value)
    return obj


def test_force_fields_become_air(groom):
    wind = field("WIND", "Breeze", strength=3.0, noise=0.6, seed=7)
    field("VORTEX", "Whirl", strength=2.0, falloff_power=1.5, use_max_distance=True, distance_max=2.0)
    field("TURBULENCE", "Rough", strength=1.0, size=0.25)
    wind.field.keyframe_insert("strength", frame=3)
    wind.field.strength = 8.0
    wind.field.keyframe_insert("strength", frame=8)
    scenes.activate(groom)
    found = {one.kind: one for one in read(groom, air_speed=0.5).scene.fields}
    assert sorted(found) == ["turbulence", "vortex", "wind"]
    wind = found["wind"]
    assert (wind.strength[0], wind.strength[-1], wind.seed) == (1.5, 4.0, 7)
    assert abs(wind.noise[0] - 0.2) < 1e-6
    assert (np.diff(wind.strength) > 0).all()
    # it was turned by 90 degrees about x: it blows along -y
    assert np.abs(wind.matrices[0][:3, 2] - [0.0, -1.0, 0.0]).max() < 1e-6
    assert np.abs(wind.matrices[0][:3, 3] - [0.0, -1.0, 0.5]).max() < 1e-6
    assert (found["vortex"].falloff_power, found["vortex"].distance_max) == (1.5, 2.0)
    assert found["turbulence"].size == 0.25


def test_fields_that_do_not_act_are_named(groom):
    field("MAGNET", "Pole")
    field("WIND", "Off").hide_viewport = True
    scenes.activate(groom)
    reading = read(groom)
    assert reading.scene.fields == ()
    assert any("'Pole' is a field of kind Magnetic" in remark for remark in reading.remarks)
    assert any("'Off' is disabled" in remark for remark in reading.remarks)


def test_gravity_is_the_scene_s(groom):
    assert np.allclose(read(groom).scene.gravity, [0.0, 0.0, -9.81])
    bpy.context.scene.gravity = (1.0, 0.0, -5.0)
    assert np.allclose(read(groom).scene.gravity, [1.0, 0.0, -5.0])
    bpy.context.scene.use_gravity = False
    assert (read(groom).scene.gravity == 0.0).all()


def test_a_scene_in_centimetres_is_the_same_in_metres(groom):
    field("WIND", "Breeze", use_max_distance=True, distance_max=2.0)
    scenes.activate(groom)
    turn(head(), 10.0)
    plain = read(groom)
    units = bpy.context.scene.unit_settings
    units.scale_length = 0.01
    small = read(groom)
    assert np.allclose(small.strands.points, 0.01 * plain.strands.points)
    assert np.allclose(small.scene.motion[-1][:3, 3], 0.01 * plain.scene.motion[-1][:3, 3])
    assert np.allclose(small.scene.motion[-1][:3, :3], plain.scene.motion[-1][:3, :3])
    assert np.allclose(small.scene.colliders[0].vertices, 0.01 * plain.scene.colliders[0].vertices)
    assert abs(small.scene.fields[0].distance_max - 0.02) < 1e-9
    # from metres back to the object: a strand's first point at rest
    back = np.linalg.inv(small.object_motion[0]) @ [*small.strands.points[0], 1.0]
    assert np.abs(back[:3] - scenes.positions(groom)[0]).max() < 1e-6


def test_a_modifier_that_moves_hair_a_second_time_is_named(groom):
    tree = bpy.data.node_groups.new("Deform", "GeometryNodeTree")
    tree.nodes.new("GeometryNodeDeformCurvesOnSurface")
    groom.modifiers.new("Surface Deform", "NODES").node_group = tree
    assert any("'Surface Deform' moves the hair" in remark for remark in read(groom).remarks)
