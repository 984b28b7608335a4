"""Small heads and grooms built for the tests, and how the tests reach the add-on's modules."""

from __future__ import annotations

import importlib
from types import ModuleType

import bpy
import numpy as np

MODULE = "bl_ext.user_default.hairloom"
RADIUS = 0.1  # of the spherical head, metres


def module(name: str) -> ModuleType:
    """A module of the add-on or, as 'backend.…', of its backend."""
    return importlib.import_module(f"{MODULE}.{name}")


def sphere_head(name: str = "Ball", *, scalp: bool = True, uv: bool = True) -> bpy.types.Object:
    """A ball of quads around the origin, its upper half marked as 'Scalp'."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=RADIUS, calc_uvs=uv)
    head = bpy.context.object
    head.name = name
    if scalp:
        group = head.vertex_groups.new(name="Scalp")
        group.add([v.index for v in head.data.vertices if v.co.z > 0.02], 1.0, "REPLACE")
    return head


def wavy_strands(n_strands: int = 300, n_points: int = 16, seed: int = 0) -> np.ndarray:
    """(S, N, 3) float32: strands that leave the ball's top outwards, fall to the side and wave; roots on the ball."""
    rng = np.random.default_rng(seed)
    height = rng.uniform(0.35, 0.98, n_strands)
    azimuth = rng.uniform(0, 2 * np.pi, n_strands)
    flat = np.sqrt(1 - height**2)
    outward = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), height], axis=1)
    along = np.linspace(0, 1, n_points)[None, :, None]
    side = np.cross(outward, [0.0, 0.0, 1.0])
    wave = 0.006 * np.sin(9 * along + 2 * azimuth[:, None, None]) * along
    points = RADIUS * outward[:, None] * (1 + 0.6 * along) + side[:, None] * wave
    points[..., 2:] -= 0.05 * along**2
    return points.astype(np.float32)


def groom(points: np.ndarray | None = None, name: str = "Hair") -> bpy.types.Object:
    """A Curves object of (S, N, 3) strands, made without the add-on; active and selected."""
    points = wavy_strands() if points is None else points
    curves = bpy.data.hair_curves.new(name)
    curves.add_curves([points.shape[1]] * len(points))
    curves.position_data.foreach_set("vector", np.ascontiguousarray(points, np.float32).ravel())
    obj = bpy.data.objects.new(name, curves)
    bpy.context.collection.objects.link(obj)
    activate(obj)
    return obj


def activate(obj: bpy.types.Object) -> None:
    for other in bpy.context.selected_objects:
        other.select_set(False)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj


def groom_on_head() -> tuple[bpy.types.Object, bpy.types.Object]:
    """The wavy groom, active, and the ball it grows on, chosen as the head; small settings that suit 300 strands."""
    head = sphere_head()
    bpy.context.scene.hairloom.head = head
    small_settings()
    return groom(), head


def small_settings() -> None:
    synthesis = bpy.context.scene.hairloom.synthesis
    synthesis.n_samples = 16
    synthesis.map_spacing = 0.06
    synthesis.hierarchy.wisps.n_wisps = 80
    synthesis.texture.window_sizes = (8, 4, 0)
    synthesis.texture.n_scales = 2


def positions(obj: bpy.types.Object) -> np.ndarray:
    """(P, 3) float32 in the object's own space."""
    values = np.empty(3 * len(obj.data.points), np.float32)
    obj.data.position_data.foreach_get("vector", values)
    return values.reshape(-1, 3)


def values(obj: bpy.types.Object, name: str, dtype: type = np.int32, width: int = 1, key: str = "value") -> np.ndarray:
    data = obj.data.attributes[name].data
    found = np.empty(len(data) * width, dtype)
    data.foreach_get(key, found)
    return found if width == 1 else found.reshape(-1, width)


def scene_state() -> dict[str, object]:
    """What must not change when something is refused: objects, data and their contents."""
    state: dict[str, object] = {
        "objects": sorted(o.name for o in bpy.data.objects),
        "curves": sorted(c.name for c in bpy.data.hair_curves),
        "meshes": sorted(m.name for m in bpy.data.meshes),
        "head": name_of(bpy.context.scene.hairloom.head),
    }
    for obj in bpy.data.objects:
        if obj.type == "CURVES":
            state[obj.name] = (
                positions(obj).tobytes(),
                sorted(a.name for a in obj.data.attributes),
                name_of(obj.parent),
            )
        elif obj.type == "MESH":
            state[obj.name] = (sorted(g.name for g in obj.vertex_groups), [u.name for u in obj.data.uv_layers])
    return state


def name_of(item: object) -> str | None:
    """References do not outlive an undo; names do."""
    return None if item is None else item.name


def undo_steps(run: object) -> int:
    """Run a zero-argument callable that calls one operator; how many undo steps lead back to what was before."""
    bpy.ops.ed.undo_push(message="before")
    before = scene_state()
    run()
    after = scene_state()
    assert after != before, "the operator changed nothing"
    for steps in (1, 2, 3):
        bpy.ops.ed.undo()
        if scene_state() == before:
            return steps
    raise AssertionError("three undos do not lead back")


def reload(tmp_path: object) -> None:
    """Save the file and open it again; every reference to data is void afterwards."""
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
