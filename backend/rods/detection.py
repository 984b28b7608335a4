"""Where strands touch solids and each other (B-26): samples along strands, signed distances, near segments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..errors import require
from ..geometry.collider import Collider
from ..types import Float64, Int32, Int64
from ._detection_kernels import hash_cells, near_segments, probe_solid
from .helices import Helices
from .model import Rods
from .statics import element_motion, pose_rods

_MOST_SAMPLES = 16  # an element


def rigid_inverse(matrix: Float64) -> Float64:
    """(4, 4) of a rigid (4, 4); without LAPACK, whose threads cost a millisecond where kernels have theirs."""
    turn = matrix[:3, :3].T
    inverse = np.eye(4)
    inverse[:3, :3], inverse[:3, 3] = turn, -turn @ matrix[:3, 3]
    return inverse


@dataclass(frozen=True, slots=True)
class Solid:
    """A solid that moves rigidly during a time step; one that bends is given anew every frame.

    collider : signed distance in its own space, metres. matrix, previous : (4, 4) float64, own space to world at the
    step's end and begin, rigid. friction : Coulomb's coefficient; the greater of the hair's and this counts.
    """

    collider: Collider
    matrix: Float64
    previous: Float64
    friction: float = 0.3

    def __post_init__(self) -> None:
        for name in ("matrix", "previous"):
            matrix = getattr(self, name)
            require(matrix.shape == (4, 4), f"a solid's {name} has shape {matrix.shape}; it must be (4, 4)")
            turn = matrix[:3, :3]
            is_rigid = np.allclose(turn @ turn.T, np.eye(3), atol=1e-4) and np.linalg.det(turn) > 0
            require(is_rigid, f"a solid's {name} scales or mirrors; apply the object's scale")
        require(self.friction >= 0, f"a solid's friction is {self.friction:g}; it must be 0 or more")

    def velocities(self, points: Float64, dt: float) -> Float64:
        """(n, 3) m/s, world, of the solid's material at points (n, 3), as it came here during the step."""
        back = self.previous @ rigid_inverse(self.matrix)
        result: Float64 = (points - (points @ back[:3, :3].T + back[:3, 3])) / dt
        return result


@dataclass(frozen=True, slots=True)
class Samples:
    """n places along strands where contact is looked for, the root first and the tip last in each strand.

    elements (n,) int32, arcs (n,) float64, m from the element's start, strands (n,) int32, is_root, is_tip (n,) bool.
    """

    elements: Int32
    arcs: Float64
    strands: Int32
    is_root: NDArray[np.bool_]
    is_tip: NDArray[np.bool_]


def sample_rods(rods: Rods, spacing: float) -> Samples:
    """Places at equal steps along every strand, root and tip included, at most `spacing` metres apart.

    However long the elements are, so that finer elements cost no more contacts; but at most 16 places an element.
    """
    roots, n_elements = rods.offsets[:-1], np.diff(rods.offsets)
    lengths = np.add.reduceat(rods.lengths, roots)
    parts = np.clip(np.ceil(lengths / spacing - 1e-9), 1, _MOST_SAMPLES * n_elements).astype(np.int64)
    strands = np.repeat(np.arange(len(roots)), parts + 1)
    begins = np.cumsum(parts + 1) - (parts + 1)
    place = np.arange(len(strands)) - begins[strands]
    # arc lengths of all strands one after the other, so that one search finds the elements
    ends = np.cumsum(rods.lengths)
    starts = ends - rods.lengths
    along = starts[roots][strands] + lengths[strands] * place / parts[strands]
    elements = np.searchsorted(ends, along * (1.0 - 1e-12), side="left")
    elements = np.clip(elements, roots[strands], rods.offsets[1:][strands] - 1)
    arcs = np.clip(along - starts[elements], 0.0, rods.lengths[elements])
    is_root, is_tip = place == 0, place == parts[strands]
    arcs[is_root], arcs[is_tip] = 0.0, rods.lengths[elements[is_tip]]
    return Samples(elements.astype(np.int32), arcs, strands.astype(np.int32), is_root, is_tip)


def place_legs(helices: Helices, elements: Int32, arcs: Float64) -> Float64:
    """(n, 3) metres, world: where elements (n,) at arcs (n,) are in a pose."""
    pose = pose_rods(helices)
    inside = element_motion(helices.curvatures[elements], arcs)[0]
    return np.asarray(pose.starts[elements] + np.einsum("nij,nj->ni", pose.frames[elements], inside))


@dataclass(frozen=True, slots=True)
class ContactSet:
    """c contacts of a leg with a solid, or with another leg.

    elements : (c, 2) int32 of the first and second leg, -1 for none. arcs : (c, 2) m from the elements' starts.
    axes : (c, 3, 3) float64, rows normal (towards the first leg) and two tangents, right-handed, world.
    gaps : (c,) m, signed distance from the solid's surface, or between the two middles. offsets : (c,) m, the gap
    that is kept free. friction : (c,). solids : (c,) int32, -1 between strands. keys : (c,) int64, the same for a
    contact that goes on.
    """

    elements: Int32
    arcs: Float64
    axes: Float64
    gaps: Float64
    offsets: Float64
    friction: Float64
    solids: Int32
    keys: Int64

    @property
    def n_contacts(self) -> int:
        return len(self.gaps)

    def select(self, chosen: NDArray[np.bool_] | Int64) -> ContactSet:
        return ContactSet(*(getattr(self, field.name)[chosen] for field in fields(self)))


def no_contacts() -> ContactSet:
    """An empty set."""
    none = np.zeros(0)
    numbers, empty = none.astype(np.int32), none.reshape(0, 2)
    return ContactSet(
        empty.astype(np.int32), empty, none.reshape(0, 3, 3), none, none, none, numbers, none.astype(np.int64)
    )


def join_contacts(sets: Sequence[ContactSet]) -> ContactSet:
    """One set of all, in order; at least one is needed."""
    if len(sets) == 1:
        return sets[0]
    return ContactSet(*(np.concatenate([getattr(one, field.name) for one in sets]) for field in fields(ContactSet)))


def contact_axes(normals: Float64, along: Float64) -> Float64:
    """(c, 3, 3) right-handed rows: normals (c, 3), then as near to directions `along` (c, 3) as can be.

    With the strand's own direction the axes turn with the strand, and with them the impulses kept for the next step.
    """
    tangents = along - np.einsum("ci,ci->c", normals, along)[:, None] * normals
    sizes = np.linalg.norm(tangents, axis=1)
    bad = sizes <= 1e-3 * np.linalg.norm(along, axis=1)
    if bad.any():
        other = np.eye(3)[np.abs(normals[bad]).argmin(axis=1)]
        tangents[bad] = other - np.einsum("ci,ci->c", normals[bad], other)[:, None] * normals[bad]
        sizes[bad] = np.linalg.norm(tangents[bad], axis=1)
    axes = np.empty((len(normals), 3, 3))
    axes[:, 0], axes[:, 1] = normals, tangents / sizes[:, None]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # np.cross takes three times as long
        axes[:, 2, i] = axes[:, 0, j] * axes[:, 1, k] - axes[:, 0, k] * axes[:, 1, j]
    return axes


def solid_offsets(samples: Samples, radius: Float64, n_solids: int) -> Float64:
    """(k, n) m: the strands' radius (S,), and -inf at roots, which move as they are told and touch nothing."""
    return np.tile(np.where(samples.is_root, -np.inf, radius[samples.strands]), (n_solids, 1))


def solid_contacts(
    samples: Samples,
    points: Float64,
    moves: Float64,
    solids: Sequence[Solid],
    friction: Float64,
    offsets: Float64,
    margin: float,
) -> ContactSet:
    """Contacts of all samples that moves (n, 3) would bring nearer to a solid than the offset and `margin` together.

    points : (n, 3) of the samples. friction : (S,) of the strands. offsets : (k, n) m, gaps to keep to each solid, as
    those of solid_offsets.
    """
    found = []
    for number, solid in enumerate(solids):
        gaps, normals, is_near = np.empty(len(points)), np.empty((len(points), 3)), np.empty(len(points), np.bool_)
        limits = offsets[number] + margin
        grid, inverse = solid.collider, rigid_inverse(solid.matrix)
        probe_solid(
            grid.distance, grid.origin, grid.cell, inverse, points, moves, limits, gaps, normals, is_near
        )  # fmt: skip
        near = np.flatnonzero(is_near)
        found.append(
            ContactSet(
                np.stack([samples.elements[near], np.full(len(near), -1, np.int32)], axis=1),
                np.stack([samples.arcs[near], np.zeros(len(near))], axis=1),
                contact_axes(normals[near], points[near] - points[near - 1]),
                gaps[near],
                offsets[number, near],
                np.maximum(friction[samples.strands[near]], solid.friction),
                np.full(len(near), number, np.int32),
                near + number * len(points),
            )
        )
    return join_contacts(found)


def near_pairs(samples: Samples, points: Float64, moves: Float64, reach: float, limit: float) -> tuple[Int64, Float64]:
    """Parts of different strands nearer than `reach` that moves (n, 3) bring nearer than `limit`, all in metres.

    Gives the samples that end the parts (p, 2) and places between (p, 2).

    Broad phase by a hash grid, the nearest points of segments between neighbouring samples; places are 0 at the sample
    before and 1 at the one given.
    """
    segments = np.flatnonzero(~samples.is_root)
    middles = 0.5 * (points[segments] + points[segments - 1])
    longest = np.linalg.norm(points[segments] - points[segments - 1], axis=1).max(initial=0.0)
    cells = np.floor((middles - middles.min(axis=0)) / (longest + reach)).astype(np.int64)
    slots = 2 * len(segments) + 1
    keys = np.empty(len(segments), np.int64)
    hash_cells(cells, slots, keys)
    order = np.argsort(keys, kind="stable")
    table = np.zeros(slots + 1, np.int64)
    np.cumsum(np.bincount(keys, minlength=slots), out=table[1:])
    counts, none = np.empty(len(segments), np.int64), np.empty(0, np.int64)
    grid = points, samples.strands, samples.is_tip, segments, cells, table, order, moves, longest + reach, reach, limit
    near_segments(*grid, none, counts, np.empty((0, 2), np.int64), np.empty((0, 2)))
    begins = np.cumsum(counts) - counts
    pairs, places = np.empty((counts.sum(), 2), np.int64), np.empty((counts.sum(), 2))
    near_segments(*grid, begins, counts, pairs, places)
    return pairs, places


def nearest_of_each(samples: Samples, pairs: Int64, gaps: Float64, most: int) -> NDArray[np.bool_]:
    """(p,) bool: pairs among the `most` with the least gaps (p,) of both their strands."""
    chosen = np.ones(len(pairs), np.bool_)
    for side in range(2):
        strands = samples.strands[pairs[:, side]]
        order = np.lexsort((gaps, strands))
        begins = np.searchsorted(strands[order], strands[order])
        chosen[order] &= np.arange(len(order)) - begins < most
    return chosen


def pair_legs(samples: Samples, pairs: Int64, places: Float64) -> tuple[Int32, Float64]:
    """Elements and arcs (p, 2) of `near_pairs`."""
    elements = samples.elements[pairs]
    # the sample before may be the end of the element before
    before = np.where(samples.elements[pairs - 1] == elements, samples.arcs[pairs - 1], 0.0)
    return elements, before + places * (samples.arcs[pairs] - before)


def pair_contacts(
    samples: Samples,
    points: Float64,
    pairs: Int64,
    places: Float64,
    place: Callable[[Int32, Float64], Float64],
    friction: Float64,
    radius: Float64,
) -> ContactSet:
    """Contacts between strands of `near_pairs`; `place` tells where elements (k,) at arcs (k,) are.

    friction, radius : (S,), of which the mean and the sum count.
    """
    elements, arcs = pair_legs(samples, pairs, places)
    legs = place(elements.T.ravel(), arcs.T.ravel()).reshape(2, -1, 3)
    along = points[pairs[:, 0]] - points[pairs[:, 0] - 1]
    apart = legs[0] - legs[1]
    gaps = np.linalg.norm(apart, axis=1)
    touching = gaps < 1e-9  # crossing exactly: any direction across both will do
    if touching.any():
        others = np.cross(along[touching], np.roll(along[touching], 1, axis=1))
        apart[touching] = others / np.maximum(np.linalg.norm(others, axis=1), 1e-12)[:, None]
    normals = apart / np.where(touching, 1.0, gaps)[:, None]
    strands = samples.strands[pairs]
    return ContactSet(
        elements,
        arcs,
        contact_axes(normals, along),
        gaps,
        radius[strands].sum(axis=1),
        friction[strands].mean(axis=1),
        np.full(len(pairs), -1, np.int32),
        -1 - (pairs[:, 0] * len(samples.arcs) + pairs[:, 1]),
    )
