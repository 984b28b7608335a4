"""Make Hairloom's plain head, backend/data/head.npz: `python blend_templates/make_head.py [OUT.npz]`.

A mannequin's head and neck as one implicit surface of ours: ellipsoids and capsules blended smoothly, meshed by surface
nets, evened out along the surface, unwrapped, with a hairline. Nothing is random, and left mirrors right exactly.
The head stands on the origin (middle of the neck's base), looks along -y, z up, metres, 0.31 m tall.
"""

from __future__ import annotations

import sys
from pathlib import Path

import igl
import numpy as np
from hairloom.types import Head
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import spsolve

Array = NDArray[np.float64]

OUTPUT = Path(__file__).parent.parent / "backend" / "data" / "head.npz"
CELL = 0.0055  # metres; about 8,000 vertices
NECK_BASE = -0.215  # height of the cut below the middle of the skull, which is the origin while sculpting

# Height of the hairline, metres from the middle of the skull, by azimuth in degrees from the face to the nape (180):
# forehead, temple, sideburn, over and behind the ear, nape.
HAIRLINE = np.array(
    [
        (0, 0.056), (18, 0.057), (32, 0.047), (45, 0.038), (54, 0.026), (62, 0.002), (70, -0.022), (76, -0.024),
        (83, 0.002), (95, 0.012), (108, 0.004), (118, -0.022), (128, -0.052), (142, -0.074),
        (160, -0.083), (180, -0.085),
    ]
)  # fmt: skip
AXIS = np.array([0.0, 0.012])  # x, y of the vertical line that azimuths are measured around


def smooth_union(a: Array, b: Array, blend: float) -> Array:
    """Distance of the union, rounded over `blend` metres where the two meet."""
    share = np.maximum(blend - np.abs(a - b), 0.0) / blend
    return np.minimum(a, b) - share**3 * blend / 6.0


def smooth_difference(a: Array, b: Array, blend: float) -> Array:
    """Distance of a without b, rounded likewise."""
    return -smooth_union(-a, b, blend)


def ellipsoid(p: Array, centre: tuple[float, float, float], radii: tuple[float, float, float]) -> Array:
    """First-order distance from an ellipsoid."""
    q = (p - np.array(centre)) / np.array(radii)
    length = np.linalg.norm(q, axis=-1)
    gradient = np.linalg.norm(q / np.array(radii), axis=-1)
    return length * (length - 1.0) / np.maximum(gradient, 1e-9)


def capsule(p: Array, start: tuple[float, ...], end: tuple[float, ...], radius: float, end_radius: float) -> Array:
    """Distance from a line with a radius that changes along it."""
    a, b = np.array(start), np.array(end)
    along = np.clip(((p - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(p - a - along[..., None] * (b - a), axis=-1) - (radius + along * (end_radius - radius))


def skull_and_face(p: Array) -> Array:
    """Skull, forehead, cheeks, jaw and chin; p has |x| in place of x."""
    f = ellipsoid(p, (0, 0.016, 0.006), (0.0745, 0.0955, 0.0845))
    f = smooth_union(f, ellipsoid(p, (0, 0.048, -0.012), (0.066, 0.062, 0.066)), 0.03)
    f = smooth_union(f, ellipsoid(p, (0, -0.030, 0.006), (0.061, 0.056, 0.064)), 0.03)
    f = smooth_union(f, ellipsoid(p, (0, -0.030, -0.056), (0.057, 0.055, 0.064)), 0.03)
    f = smooth_union(f, ellipsoid(p, (0.042, -0.049, -0.049), (0.018, 0.022, 0.018)), 0.03)
    f = smooth_union(f, capsule(p, (0.050, 0.002, -0.080), (0.015, -0.066, -0.119), 0.012, 0.014), 0.03)
    f = smooth_union(f, ellipsoid(p, (0, -0.050, -0.098), (0.038, 0.037, 0.036)), 0.025)
    return smooth_union(f, ellipsoid(p, (0, -0.074, -0.121), (0.021, 0.017, 0.015)), 0.022)


def features(p: Array, f: Array) -> Array:
    """Brows, eyes, nose and mouth on the face."""
    f = smooth_union(f, capsule(p, (0.016, -0.0800, -0.0090), (0.044, -0.0665, -0.0080), 0.0055, 0.005), 0.022)
    f = smooth_difference(f, ellipsoid(p, (0.032, -0.094, -0.029), (0.018, 0.014, 0.0105)), 0.018)
    f = smooth_union(f, ellipsoid(p, (0.031, -0.0665, -0.030), (0.0145, 0.0135, 0.0125)), 0.006)
    f = smooth_union(f, capsule(p, (0, -0.079, -0.018), (0, -0.103, -0.063), 0.0065, 0.0085), 0.012)
    f = smooth_union(f, ellipsoid(p, (0, -0.1035, -0.065), (0.0095, 0.0095, 0.009)), 0.01)
    f = smooth_union(f, ellipsoid(p, (0.0105, -0.094, -0.067), (0.008, 0.0105, 0.0085)), 0.012)
    f = smooth_union(f, ellipsoid(p, (0, -0.0800, -0.0880), (0.0250, 0.0140, 0.0075)), 0.008)
    f = smooth_union(f, ellipsoid(p, (0, -0.0795, -0.0993), (0.0220, 0.0140, 0.0078)), 0.008)
    return smooth_difference(f, capsule(p, (0, -0.0975, -0.0936), (0.023, -0.0855, -0.0938), 0.0024, 0.0018), 0.006)


def ear(p: Array) -> Array:
    """A plain ear: a leaning disc with a hollow."""
    angle = np.radians(14.0)
    local = p - np.array([0.0775, 0.0165, -0.034])
    turned = local.copy()
    turned[..., 1] = np.cos(angle) * local[..., 1] - np.sin(angle) * local[..., 2]
    turned[..., 2] = np.sin(angle) * local[..., 1] + np.cos(angle) * local[..., 2]
    turned[..., 0] = local[..., 0] - 0.35 * np.maximum(turned[..., 1], 0.0)
    f = ellipsoid(turned, (0.0, 0.0, 0.0), (0.0088, 0.0180, 0.0305))
    return smooth_difference(f, ellipsoid(turned, (0.0105, -0.003, 0.002), (0.0085, 0.0105, 0.0185)), 0.005)


def field(points: Array) -> Array:
    """The head, negative inside."""
    p = points.copy()
    p[..., 0] = np.abs(p[..., 0])
    f = features(p, skull_and_face(p))
    neck = capsule(p / np.array([1.0, 1.06, 1.0]), (0, 0.018, -0.085), (0, 0.032, -0.27), 0.0485, 0.0560)
    f = smooth_union(f, neck, 0.035)
    f = smooth_union(f, capsule(p, (0.044, 0.020, -0.075), (0.022, -0.006, -0.225), 0.011, 0.014), 0.04)
    f = smooth_union(f, ear(p), 0.009)
    return -smooth_union(-f, points[..., 2] - NECK_BASE, 0.014)


def gradient(points: Array) -> Array:
    """Unit gradient of the field by central differences."""
    h = 2e-4
    steps = np.stack([field(points + h * axis) - field(points - h * axis) for axis in np.eye(3)], axis=-1)
    return steps / np.maximum(np.linalg.norm(steps, axis=-1, keepdims=True), 1e-12)


def surface_net(cell: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and quads of the surface; a layer of cells straddles x = 0, so that vertices lie on it."""
    half = int(np.ceil(0.105 / cell))
    axes = (
        (np.arange(2 * half) - half + 0.5) * cell,
        np.arange(-0.13, 0.13, cell),
        np.arange(NECK_BASE - 2.3 * cell, 0.11, cell),
    )
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = field(grid) < 0
    cells = tuple(n - 1 for n in inside.shape)
    corner = [
        inside[i : i + cells[0], j : j + cells[1], k : k + cells[2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)
    ]
    mixed = np.any(corner, axis=0) & ~np.all(corner, axis=0)
    index = np.full(cells, -1)
    index[mixed] = np.arange(mixed.sum())
    where = np.argwhere(mixed)
    vertices = np.stack([axes[a][where[:, a]] + 0.5 * cell for a in range(3)], axis=1)
    quads = []
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        low = np.take(inside, range(inside.shape[a] - 1), axis=a)
        high = np.take(inside, range(1, inside.shape[a]), axis=a)
        for crossing, turn in ((low & ~high, 1), (~low & high, -1)):
            at = np.argwhere(crossing)
            at = at[(at[:, b] > 0) & (at[:, c] > 0) & (at[:, b] < cells[b]) & (at[:, c] < cells[c])]
            around = []
            for db, dc in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
                step = np.zeros(3, int)
                step[b], step[c] = db, dc
                around.append(index[tuple((at + step).T)])
            quads.append(np.stack(around[::turn], axis=1))
    return vertices, np.vstack(quads)


def mirror_partners(vertices: Array, cell: float) -> NDArray[np.int64]:
    """The vertex on the other side of x = 0 for each vertex of the net."""
    key = {tuple(k): i for i, k in enumerate(np.rint(vertices / (0.5 * cell)).astype(int).tolist())}
    flipped = np.rint(vertices * [-1, 1, 1] / (0.5 * cell)).astype(int)
    return np.array([key[tuple(k)] for k in flipped.tolist()])


def split_quads(vertices: Array, quads: NDArray[np.int64], partner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles along the shorter diagonals; the left side's are the mirror images of the right side's."""
    right = vertices[quads, 0].mean(axis=1) > 1e-9
    middle = np.abs(vertices[quads, 0].mean(axis=1)) <= 1e-9
    q = quads[right | middle]
    first = np.linalg.norm(vertices[q[:, 0]] - vertices[q[:, 2]], axis=1)
    second = np.linalg.norm(vertices[q[:, 1]] - vertices[q[:, 3]], axis=1)
    q = np.where((first <= second)[:, None], q, np.roll(q, -1, axis=1))
    triangles = np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])
    own = np.concatenate([right[right | middle]] * 2)
    return np.vstack([triangles, partner[triangles[own]][:, ::-1]])


def even_out(vertices: Array, quads: NDArray[np.int64], partner: NDArray[np.int64], rounds: int) -> Array:
    """Slide the vertices to the middles of their neighbours along the surface, then back onto it."""
    edges = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    count = np.bincount(edges.ravel(), minlength=len(vertices))[:, None]
    links = coo_array(
        (np.ones(2 * len(edges)), (edges.ravel(), edges[:, ::-1].ravel())), shape=(len(vertices),) * 2
    ).tocsr()
    for _ in range(rounds):
        normals = gradient(vertices)
        move = links @ vertices / count - vertices
        move -= normals * np.einsum("vc,vc->v", move, normals)[:, None]
        vertices = onto_surface(vertices + 0.6 * move, partner)
    return vertices


def onto_surface(vertices: Array, partner: NDArray[np.int64]) -> Array:
    """Newton steps onto the surface, and the two sides made equal."""
    for _ in range(3):
        slope = np.stack([field(vertices + 1e-4 * a) - field(vertices - 1e-4 * a) for a in np.eye(3)], axis=-1) / 2e-4
        step = field(vertices)[:, None] * slope / np.maximum((slope**2).sum(axis=1, keepdims=True), 0.05)
        vertices = vertices - np.clip(step, -0.003, 0.003)
    return 0.5 * (vertices + vertices[partner] * [-1, 1, 1])


def above_hairline(points: Array) -> Array:
    """Height over the hairline, metres; ears count as below."""
    azimuth = np.degrees(np.arctan2(np.abs(points[..., 0]), -(points[..., 1] - AXIS[1])))
    height = points[..., 2] - PchipInterpolator(*HAIRLINE.T)(azimuth)
    p = points.copy()
    p[..., 0] = np.abs(p[..., 0])
    return np.minimum(height, ear(p) - 0.003)


def snap_to_hairline(vertices: Array, partner: NDArray[np.int64], cell: float) -> Array:
    """Slide the vertices next to the hairline onto it, so that it is a smooth line of edges."""
    for _ in range(4):
        value = above_hairline(vertices)
        h = 2e-4
        slope = np.stack(
            [above_hairline(vertices + h * a) - above_hairline(vertices - h * a) for a in np.eye(3)], -1
        ) / (2 * h)
        normals = gradient(vertices)
        slope -= normals * np.einsum("vc,vc->v", slope, normals)[:, None]
        step = value[:, None] * slope / np.maximum((slope**2).sum(axis=1, keepdims=True), 0.3)
        # the ears keep their vertices: there the line is short, and bends more sharply than the mesh can
        near = (np.linalg.norm(step, axis=1) < 0.4 * cell) & (ear(vertices * np.sign(vertices[:, :1] + 1e-12)) > 0.006)
        vertices = onto_surface(vertices - np.where(near[:, None], step, 0.0), partner)
    return vertices


def undo_folds(moved: Array, before: Array, triangles: NDArray[np.int64], partner: NDArray[np.int64]) -> Array:
    """Put the vertices of triangles that face the wrong way, or are slivers, back to where they were."""
    moved = moved.copy()
    for _ in range(4):
        corners = moved[triangles]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing = np.einsum("tc,tc->t", cross, gradient(corners.mean(axis=1)))
        folded = facing < 0.06 * np.median(facing)
        bad = np.zeros(len(moved), bool)
        bad[triangles[folded]] = True
        bad |= bad[partner]
        moved[bad] = before[bad]
    return moved


def unwrap_head(vertices: Array, triangles: NDArray[np.int64]) -> Array:
    """Corner uv: the skin as one chart without a seam (SLIM, least distortion), the base of the neck as another."""
    base = vertices[triangles].mean(axis=1)[:, 2] < NECK_BASE + 0.0015
    corner_uv = np.zeros((len(triangles), 3, 2))
    for chosen, corner, size in ((~base, np.array([0.01, 0.01]), 0.98), (base, np.array([0.86, 0.86]), 0.13)):
        used, faces = np.unique(triangles[chosen], return_inverse=True)
        faces = faces.reshape(-1, 3).astype(np.int64)
        uv = flatten(np.ascontiguousarray(vertices[used]), faces, slim=corner[0] < 0.5)
        uv = (uv - uv.min(axis=0)) / np.ptp(uv, axis=0).max()
        corner_uv[chosen] = (uv * size + corner)[faces]
    return corner_uv


def flatten(vertices: Array, faces: NDArray[np.int64], slim: bool) -> Array:
    """A disc of triangles in the plane, on a circle first (Tutte), then with the least distortion."""
    border = np.asarray(igl.boundary_loop(faces)).ravel()
    # start at the back and run the same way round whatever the numbering
    border = np.roll(border, -int(np.argmax(vertices[border, 1])))
    circle = np.asarray(igl.map_vertices_to_circle(vertices, border))
    uv = tutte(faces, border, circle)
    if not slim:
        return uv
    # the energy is least where the chart is as large as the skin
    uv *= np.sqrt(igl.doublearea(vertices, faces).sum() / (2.0 * np.pi))
    data = igl.slim_precompute(
        np.asfortranarray(vertices), np.asfortranarray(faces, np.int32), np.asfortranarray(uv),
        igl.MappingEnergyType.SYMMETRIC_DIRICHLET, np.empty(0, np.int32), np.empty((0, 2), order="F"), 0.0,
    )  # fmt: skip
    return np.asarray(igl.slim_solve(data, 100))[:, :2]


def tutte(faces: NDArray[np.int64], border: NDArray[np.int64], places: Array) -> Array:
    """Every inner vertex in the middle of its neighbours, the border at `places`: no triangle can flip."""
    count = int(faces.max()) + 1
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    links = coo_array((np.ones(2 * len(edges)), (edges.ravel(), edges[:, ::-1].ravel())), shape=(count, count)).tocsr()
    inner = np.setdiff1d(np.arange(count), border)
    laplacian = (diags_array(links.sum(axis=1)) - links).tocsr()
    uv = np.zeros((count, 2))
    uv[border] = places
    uv[inner] = spsolve(laplacian[inner][:, inner].tocsc(), -laplacian[inner][:, border] @ places)
    return uv


def make_head() -> Head:
    """The finished head."""
    vertices, quads = surface_net(CELL)
    partner = mirror_partners(vertices, CELL)
    vertices = onto_surface(vertices, partner)
    vertices = even_out(vertices, quads, partner, 30)
    snapped = snap_to_hairline(vertices, partner, CELL)
    triangles = split_quads(snapped, quads, partner)
    vertices = undo_folds(snapped, vertices, triangles, partner)
    scalp = above_hairline(vertices[triangles].mean(axis=1)) > 0
    corner_uv = unwrap_head(vertices, triangles)
    placed = np.round(vertices - [0.0, 0.0, NECK_BASE], 6).astype(np.float32)
    return Head(placed, triangles.astype(np.int32), scalp, np.round(corner_uv, 5).astype(np.float32))


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else OUTPUT
    head = make_head()
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        path, vertices=head.vertices, triangles=head.triangles, scalp=head.scalp, corner_uv=head.corner_uv
    )
    size = path.stat().st_size // 1024
    print(
        f"{path}: {len(head.vertices)} vertices, {len(head.triangles)} triangles, {head.scalp.sum()} scalp, {size} KB"
    )


if __name__ == "__main__":
    main()
