"""Pictures of strands on a head with Cycles: for the demo, the figures of the documentation and the asset previews.

Runs in any Python that has `bpy` (4.5 to 5.2), also beside an open file: everything is built in a scene of its own that
is removed afterwards. Needs no package but numpy and bpy; labels are drawn with Blender's own font.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy  # isort: skip  # pip's bpy makes the modules below importable
import blf
import imbuf
import numpy as np
from hairloom.errors import require
from hairloom.types import Floats, Head, StrandSet
from mathutils import Matrix, Vector

# Where the camera stands, seen from the head, and what is up in the picture. World space, z up, the face towards -y.
VIEWS: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "front": ((0.0, -1.0, 0.08), (0, 0, 1)),
    "three_quarter": ((0.72, -1.0, 0.22), (0, 0, 1)),
    "side": ((1.0, 0.0, 0.08), (0, 0, 1)),
    "back": ((0.0, 1.0, 0.12), (0, 0, 1)),
    "back_quarter": ((0.8, 0.9, 0.3), (0, 0, 1)),
    "top": ((0.0, -0.25, 1.0), (0, -1, 0)),
    "root_frame": ((0.25, 0.12, 1.0), (0, 1, 0)),  # strands in their root frames: the scalp normal (y) points up
}
DEFAULT_RADIUS = 8e-5  # metres, of a strand that carries no radius
COLOUR_ATTRIBUTE = "hairloom_colour"
SCALP_SHADE = "hairloom_scalp"
SKIN = (0.36, 0.33, 0.31, 1.0)  # linear RGBA
SHADED_SKIN = (0.085, 0.065, 0.055, 1.0)


@dataclass(frozen=True, slots=True)
class RenderParams:
    """How `render_strands` renders. The defaults take 7 to 17 s of two cores for our starter grooms.

    view : a name of VIEWS, or the direction from the head to the camera (3 numbers, z up).
    size : width and height in pixels.
    melanin : 0 white .. 1 black, of strands that have no colour of their own.
    radius_scale : factor on the strands' radii; a groom of fewer strands than a real head covers better when thicker.
    hide_head : leaves the head out, but it still takes part in the framing.
    """

    view: str | tuple[float, float, float] = "three_quarter"
    size: tuple[int, int] = (512, 512)
    samples: int = 16
    melanin: float = 0.55
    redness: float = 0.55
    radius_scale: float = 1.0
    denoise: bool = True
    hide_head: bool = False
    margin: float = 0.06

    def __post_init__(self) -> None:
        require(not isinstance(self.view, str) or self.view in VIEWS, f"no view '{self.view}'; take one of {[*VIEWS]}")
        require(min(self.size) >= 16, f"a picture of {self.size} pixels is too small; take 16 or more")
        require(self.samples >= 1, f"{self.samples} samples a pixel; take 1 or more")


def render_strands(
    strands: StrandSet | Sequence[tuple[StrandSet, Floats]],
    head: Head | None,
    path: Path | str,
    params: RenderParams = RenderParams(),
    *,
    colours: Floats | None = None,
    frame_on: Floats | None = None,
) -> Path:
    """Render strands on a head into a PNG.

    Parameters
    ----------
    strands : world space, metres; or several sets, each with its one colour (3,), linear RGB; or none, [].
    head : drawn in plain grey; None for none.
    colours : (S, 3) linear RGB in [0, 1], a colour per strand (for showing wisps); only with a single StrandSet.
    frame_on : (M, 3), the points that the picture has to hold; by default the head's and the strands'. Give the same
        points to several calls to get pictures of the same scale.
    """
    coloured = _with_colours(strands, colours)
    with _temporary_scene(params) as scene:
        everything = [hair.points for hair, _ in coloured]
        if head is not None:
            everything.append(head.vertices)
            if not params.hide_head:
                _add_head(scene, head)
        for hair, strand_colours in coloured:
            if hair.n_strands:  # Cycles crashes on a Curves object without curves
                _add_strands(scene, hair, strand_colours, params)
        points = np.concatenate(everything) if frame_on is None else np.asarray(frame_on)
        _add_camera_and_lights(scene, points, params)
        return _render(scene, Path(path))


def side_by_side(
    images: Sequence[Path | str], labels: Sequence[str], path: Path | str, *, columns: int | None = None, gap: int = 8
) -> Path:
    """Put pictures of one size next to each other (row by row when `columns` is given), each with its label below."""
    require(len(images) == len(labels) and images, f"{len(images)} pictures and {len(labels)} labels; give as many")
    pictures = [_read_png(image) for image in images]
    height, width = pictures[0].shape[:2]
    require(all(p.shape[:2] == (height, width) for p in pictures), "the pictures differ in size; render them alike")
    columns = columns or len(pictures)
    rows = -(-len(pictures) // columns)
    strip = max(24, height // 16)
    cell = np.array([height + strip + gap, width + gap])
    page = np.ones((*(np.array([rows, columns]) * cell - gap), 4), dtype=np.float32)
    for index, (picture, label) in enumerate(zip(pictures, labels)):
        top, left = cell * divmod(index, columns)
        page[top : top + height, left : left + width] = picture
        page[top + height : top + height + strip, left : left + width] = _draw_label(label, width, strip)
    return _write_png(page, Path(path))


def wisp_colours(labels: Floats, *, seed: int = 0) -> Floats:
    """(S, 3) float32 linear RGB: one clear colour for each label of `labels` (S,), consecutive labels far apart."""
    names, index = np.unique(np.asarray(labels), return_inverse=True)
    rng = np.random.default_rng(seed)
    hue = (np.arange(len(names)) * 0.61803398875 + rng.random()) % 1.0
    value = rng.uniform(0.55, 0.95, len(names))
    wheel = np.clip(np.abs((hue[:, None] * 6.0 + np.array([0.0, 4.0, 2.0])) % 6.0 - 3.0) - 1.0, 0.0, 1.0)
    rgb = value[:, None] * (1.0 - 0.75 * (1.0 - wheel))
    return np.asarray(rgb[index] ** 2.2, dtype=np.float32)


def _with_colours(
    strands: StrandSet | Sequence[tuple[StrandSet, Floats]], colours: Floats | None
) -> list[tuple[StrandSet, Floats | None]]:
    if isinstance(strands, StrandSet):
        wanted = (strands.n_strands, 3)
        require(colours is None or np.shape(colours) == wanted, f"colours must have shape {wanted}")
        return [(strands, colours)]
    require(colours is None, "a list of strand sets brings its own colours; leave `colours` out")
    return [(hair, np.tile(np.asarray(colour, dtype=np.float32), (hair.n_strands, 1))) for hair, colour in strands]


@contextmanager
def _temporary_scene(params: RenderParams) -> Iterator[Any]:
    """An empty scene; it and all data made inside the block are removed at its end."""
    kinds = ("scenes", "objects", "meshes", "hair_curves", "materials", "cameras", "lights", "worlds", "images")
    before = {kind: {item.session_uid for item in getattr(bpy.data, kind)} for kind in kinds}
    scene = bpy.data.scenes.new("Hairloom picture")
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = params.size
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = params.samples
    cycles.use_adaptive_sampling = True
    cycles.adaptive_threshold = 0.05
    cycles.use_denoising = params.denoise
    cycles.max_bounces = cycles.transmission_bounces = 4
    cycles.glossy_bounces = 2
    cycles.diffuse_bounces = 1
    scene.cycles_curves.shape = "RIBBONS"
    scene.world = bpy.data.worlds.new("Hairloom picture")
    _plain_nodes(scene.world)["Background"].inputs["Color"].default_value = (0.42, 0.43, 0.45, 1.0)
    try:
        yield scene
    finally:
        for kind in kinds:
            collection = getattr(bpy.data, kind)
            for item in [item for item in collection if item.session_uid not in before[kind]]:
                collection.remove(item)


def _plain_nodes(owner: Any) -> Any:
    if bpy.app.version < (5, 0, 0):
        owner.use_nodes = True  # always on, and deprecated, from 5.0
    return owner.node_tree.nodes


def _add_head(scene: Any, head: Head) -> None:
    mesh = bpy.data.meshes.new("head")
    mesh.from_pydata(head.vertices.tolist(), [], head.triangles.tolist())
    mesh.shade_smooth()
    shade_scalp(mesh, head)
    mesh.materials.append(head_material("head"))
    scene.collection.objects.link(bpy.data.objects.new("head", mesh))


def shade_scalp(mesh: Any, head: Head) -> None:
    """Write `hairloom_scalp`, 1 on the scalp fading to 0 at its border: `head_material` is darker there.

    Few thick strands stand for many thin ones, so skin shines through where a real head has hair.
    """
    corners = head.triangles.ravel()
    shared = np.bincount(corners, minlength=len(head.vertices))
    shade = head.scalp.astype(np.float64)
    for _ in range(3):
        on_vertices = np.bincount(corners, np.repeat(shade, 3), len(shared)) / np.maximum(shared, 1)
        shade = np.minimum(on_vertices[head.triangles].mean(axis=1), head.scalp)
    mesh.attributes.new(SCALP_SHADE, "FLOAT", "POINT").data.foreach_set("value", on_vertices.astype(np.float32))


def head_material(name: str) -> Any:
    """A new plain skin-grey material, dark where `shade_scalp` says."""
    material = bpy.data.materials.new(name)
    nodes = _plain_nodes(material)
    links = material.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.75
    shader.inputs["Specular IOR Level"].default_value = 0.2
    scalp = nodes.new("ShaderNodeAttribute")
    scalp.attribute_name = SCALP_SHADE
    scalp.location = (-500.0, 200.0)
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.location = (-300.0, 200.0)
    ramp.color_ramp.elements[0].color = SKIN
    ramp.color_ramp.elements[1].color = SHADED_SKIN
    links.new(scalp.outputs["Fac"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    return material


def _add_strands(scene: Any, strands: StrandSet, colours: Floats | None, params: RenderParams) -> None:
    curves = bpy.data.hair_curves.new("hair")
    curves.add_curves(strands.point_counts.tolist())
    curves.position_data.foreach_set("vector", np.ascontiguousarray(strands.points, dtype=np.float32).ravel())
    radius = strands.point_attributes.get("radius", np.full(len(strands.points), DEFAULT_RADIUS))
    curves.attributes.new("radius", "FLOAT", "POINT").data.foreach_set(
        "value", np.asarray(radius * params.radius_scale, dtype=np.float32)
    )
    if colours is not None:
        rgba = np.ones((strands.n_strands, 4), dtype=np.float32)
        rgba[:, :3] = colours
        curves.attributes.new(COLOUR_ATTRIBUTE, "FLOAT_COLOR", "CURVE").data.foreach_set("color", rgba.ravel())
    curves.materials.append(hair_material("hair", params.melanin, params.redness, by_colour=colours is not None))
    curves.update_tag()
    scene.collection.objects.link(bpy.data.objects.new("hair", curves))


def hair_material(name: str, melanin: float, redness: float, *, by_colour: bool = False) -> Any:
    """A new material: Principled Hair by melanin, or a matt one by the strand attribute `hairloom_colour`."""
    material = bpy.data.materials.new(name)
    nodes = _plain_nodes(material)
    nodes.clear()
    links = material.node_tree.links
    output = nodes.new("ShaderNodeOutputMaterial")
    output.location = (300.0, 0.0)
    if by_colour:  # matt, so that the colours stay apart
        shader = nodes.new("ShaderNodeBsdfDiffuse")
        colour = nodes.new("ShaderNodeAttribute")
        colour.attribute_name = COLOUR_ATTRIBUTE
        colour.location = (-250.0, 0.0)
        links.new(colour.outputs["Color"], shader.inputs["Color"])
    else:
        shader = nodes.new("ShaderNodeBsdfHairPrincipled")
        shader.model = "CHIANG"
        shader.parametrization = "MELANIN"
        for name, value in (
            ("Melanin", melanin),
            ("Melanin Redness", redness),
            ("Random Color", 0.25),
            ("Roughness", 0.32),
            ("Radial Roughness", 0.4),
            ("Random Roughness", 0.2),
        ):
            shader.inputs[name].default_value = value
    links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def _camera_axes(view: str | tuple[float, float, float]) -> Floats:
    """(3, 3): rows right, up and towards the camera, unit vectors in world space."""
    direction, up = VIEWS[view] if isinstance(view, str) else (view, (0.0, 0.0, 1.0))
    back = np.asarray(direction, dtype=np.float64)
    back = back / np.linalg.norm(back)
    right = np.cross(np.asarray(up, dtype=np.float64), back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def _add_camera_and_lights(scene: Any, points: Floats, params: RenderParams) -> None:
    """An 85 mm camera that just holds the points, and a key, a fill and a rim light that go with it."""
    axes = _camera_axes(params.view)
    # a few stray flyaways shall not make the picture small
    local = np.asarray(points, dtype=np.float64) @ axes.T
    low, high = np.percentile(local, [0.3, 99.7], axis=0)
    centre = (low + high) / 2.0
    local = np.clip(local, low, high) - centre
    camera = bpy.data.cameras.new("camera")
    camera.lens, camera.sensor_width, camera.clip_start = 85.0, 36.0, 1e-3
    width, height = params.size
    tangent = np.array([width, height]) / max(width, height) * (18.0 / 85.0) * (1.0 - 2.0 * params.margin)
    distance = float((np.abs(local[:, :2]) / tangent + local[:, 2:]).max())
    extent = float((high - low).max())

    def place(name: str, data: Any, offset: Sequence[float]) -> Any:
        item = bpy.data.objects.new(name, data)
        at = Vector((centre + np.asarray(offset)) @ axes)
        towards = at - Vector(centre @ axes)
        turn = towards.to_track_quat("Z", "Y") if name != "camera" else Matrix(axes.T.tolist()).to_quaternion()
        item.matrix_world = Matrix.LocRotScale(at, turn, None)
        scene.collection.objects.link(item)
        return item

    scene.camera = place("camera", camera, (0.0, 0.0, distance))
    for name, offset, size, strength in (
        ("key", (-1.3, 1.4, 1.7), 0.9, 42.0),
        ("fill", (1.8, 0.2, 1.4), 1.6, 16.0),
        ("rim", (0.9, 1.5, -1.9), 0.9, 42.0),
    ):
        light = bpy.data.lights.new(name, "AREA")
        light.size = size * extent
        light.energy = strength * extent**2
        place(name, light, np.asarray(offset) * extent)


def _render(scene: Any, path: Path) -> Path:
    path = path.resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.filepath = str(path)
    with quiet():
        bpy.ops.render.render(write_still=True, scene=scene.name)
    return path


@contextmanager
def quiet() -> Iterator[None]:
    """Keeps Blender's hundred lines of render log, written past sys.stdout, off the terminal."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def _read_png(path: Path | str) -> Floats:
    """(H, W, 4) float32, top row first, as stored."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    pixels = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1]


def _write_png(pixels: Floats, path: Path) -> Path:
    path = path.resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    image = bpy.data.images.new("page", pixels.shape[1], pixels.shape[0], alpha=False)
    image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1], dtype=np.float32).ravel())
    image.filepath_raw = str(path)
    image.file_format = "PNG"
    image.save()
    bpy.data.images.remove(image)
    return path


def _draw_label(text: str, width: int, height: int) -> Floats:
    """(H, W, 4) float32: dark text in the middle of a white strip."""
    buffer = imbuf.new((width, height))
    font = 0
    blf.size(font, height * 0.62)
    text_width, _ = blf.dimensions(font, text)
    if text_width > width:
        blf.size(font, height * 0.62 * width / text_width)
        text_width, _ = blf.dimensions(font, text)
    blf.position(font, max(0.0, (width - text_width) / 2.0), height * 0.3, 0.0)
    blf.color(font, 1.0, 1.0, 1.0, 1.0)
    with blf.bind_imbuf(font, buffer):
        blf.draw_buffer(font, text)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "label.png"
        imbuf.write(buffer, filepath=str(path))
        ink = _read_png(path)[..., :3].max(axis=-1, keepdims=True)
    return np.concatenate([np.repeat(1.0 - 0.85 * ink, 3, axis=-1), np.ones_like(ink)], axis=-1)
