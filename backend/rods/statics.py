"""Forces that loads have on rods at rest, and how these change as the rods bend: f(q), df/dq, Jacobians (M-25, M-26).

Whole arrays over all elements of all rods; the only loops run over the elements of the longest rod, since a frame
follows from the one before it. An element's motion is written by its end: from there on all points move by
`end_shift` q' + (`end_turn` q') x (point - end).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Float64, Int64
from .helices import Helices

# Turn of an element (radians) below which closed forms lose digits and series are used.
_SMALL_TURN = 0.5
_TERMS = 8
# Change of an element's turn (radians) in central differences; their error is about 1e-9 of the derivative.
_TURN_STEP = 1e-4


@dataclass(frozen=True, slots=True)
class Loads:
    """Point forces on rods that keep their direction: weights, or contact forces that stay as they are.

    elements : (p,) int64, ascending, every element at least once. arcs : (p,) m from the element's start.
    forces : (p, 3) N, world.
    """

    elements: Int64
    arcs: Float64
    forces: Float64


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the E elements of rods are, and how their ends move; world space.

    starts, ends : (E, 3) m. frames : (E, 3, 3) at the starts. end_shift : (E, 3, 3) m^2, the end's motion by q';
    end_turn : (E, 3, 3) m, turn of all that follows by q'.
    """

    starts: Float64
    ends: Float64
    frames: Float64
    end_shift: Float64
    end_turn: Float64


def cross_matrix(vectors: Float64) -> Float64:
    """(..., 3, 3) matrices of v x, for v (..., 3)."""
    matrices = np.zeros((*vectors.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrices[..., k, j] = vectors[..., i]
        matrices[..., j, k] = -vectors[..., i]
    return matrices


def _series(x: Float64, first: int) -> tuple[Float64, Float64]:
    """sum_k (-x)^k / (first + 2 k)! and twice its derivative by x."""
    factorials = np.array([np.prod(np.arange(1.0, first + 2 * k + 1)) for k in range(_TERMS)])
    terms = (-1.0) ** np.arange(_TERMS) / factorials
    return np.polyval(terms[::-1], x), 2.0 * np.polyval((terms[1:] * np.arange(1, _TERMS))[::-1], x)


def _coefficients(square: Float64, s: Float64) -> tuple[Float64, Float64, Float64, Float64]:
    """A = (1 - cos ws)/w^2, B = (ws - sin ws)/w^3, A_w/w and B_w/w, for w^2 = `square` and arc lengths s."""
    x = square * s * s
    small = x < _SMALL_TURN**2
    (a, a_slope), (b, b_slope) = (_series(np.where(small, x, 0.0), first) for first in (2, 3))
    series = (s**2 * a, s**3 * b, s**4 * a_slope, s**5 * b_slope)
    square = np.where(small, 1.0, square)
    w = np.sqrt(square)
    a, b = (1.0 - np.cos(w * s)) / square, (w * s - np.sin(w * s)) / (square * w)
    closed = (a, b, (s * np.sin(w * s) / w - 2.0 * a) / square, (s * a - 3.0 * b) / square)
    values: Float64 = np.where(small, np.stack(series), np.stack(closed))
    return values[0], values[1], values[2], values[3]


def element_motion(u: Float64, s: Float64) -> tuple[Float64, Float64, Float64, Float64]:
    """Inside elements of curvatures u (k, 3) at arc lengths s (k,), in the frames of their starts.

    Returns position rho (k, 3), d rho / du (k, 3, 3), rotation (k, 3, 3) and W (k, 3, 3), turn by u' (eq. 8, M-25).
    """
    square = np.einsum("ki,ki->k", u, u)
    a, b, a_slope, b_slope = _coefficients(square, s)
    a, b, a_slope, b_slope = (value[:, None, None] for value in (a, b, a_slope, b_slope))
    tangent = np.array([1.0, 0.0, 0.0])
    side = np.cross(u, tangent)
    inner = np.cross(u, side)
    turn = cross_matrix(u)
    turn_square = turn @ turn
    along = s[:, None, None] * np.eye(3)
    rho = s[:, None] * tangent + a[:, :, 0] * side + b[:, :, 0] * inner
    slope = u[:, :1, None] * np.eye(3) + u[:, :, None] * tangent - 2.0 * tangent[:, None] * u[:, None, :]
    slope = b * slope - a * cross_matrix(tangent)
    slope += (a_slope[:, :, 0] * side + b_slope[:, :, 0] * inner)[:, :, None] * u[:, None, :]
    rotation = np.eye(3) + (along - b * square[:, None, None] * np.eye(3)) @ turn + a * turn_square
    return rho, slope, rotation, np.asarray(along + a * turn + b * turn_square, np.float64)


def pose_rods(helices: Helices) -> Pose:
    """Frames along rods, and how their elements' ends move."""
    counts, first = helices.element_counts, helices.offsets[:-1].astype(np.int64)
    rho, slope, rotation, turn = element_motion(helices.curvatures, helices.lengths)
    starts, frames = np.empty_like(rho), np.empty_like(rotation)
    starts[first], frames[first] = helices.roots, helices.frames
    for k in range(1, int(counts.max(initial=1))):
        before = first[counts > k] + k - 1
        starts[before + 1] = starts[before] + np.einsum("kij,kj->ki", frames[before], rho[before])
        frames[before + 1] = frames[before] @ rotation[before]
    ends = starts + np.einsum("kij,kj->ki", frames, rho)
    return Pose(starts, ends, frames, frames @ slope, frames @ turn)


def elements_to(offsets: Int64, elements: Int64) -> tuple[Int64, Int64, Int64]:
    """For each of k elements, all elements of its rod from the root to itself, one after the other.

    Returns row offsets (k + 1,), and for each row the place in `elements` and the element.
    """
    rod = np.searchsorted(offsets, elements, side="right") - 1
    counts = elements - offsets[rod] + 1
    row_offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    place = np.repeat(np.arange(len(elements)), counts)
    return row_offsets, place, np.arange(row_offsets[-1]) - row_offsets[place] + offsets[rod][place]


def jacobians(helices: Helices, pose: Pose, elements: Int64, arcs: Float64) -> tuple[Int64, Int64, Float64]:
    """How material points (k,) move with the curvatures of the elements up to theirs: H of M-26.

    Returns row offsets (k + 1,), each row's element (r,), and its d point / d q (r, 3, 3), m^2, world.
    """
    rho, slope, _, _ = element_motion(helices.curvatures[elements], arcs)
    frames = pose.frames[elements]
    points = pose.starts[elements] + np.einsum("kij,kj->ki", frames, rho)
    row_offsets, place, rows = elements_to(helices.offsets.astype(np.int64), elements)
    arms = points[place] - pose.ends[rows]
    values = pose.end_shift[rows] - cross_matrix(arms) @ pose.end_turn[rows]
    values[row_offsets[1:] - 1] = frames @ slope
    return row_offsets, rows, values


def outer_loads(helices: Helices, pose: Pose, loads: Loads) -> tuple[Float64, Float64]:
    """Sum of the forces F (E, 3) that act beyond each element, and sum of (point - end) F^T (E, 3, 3)."""
    firsts = np.searchsorted(loads.elements, np.arange(len(helices.lengths)))
    rho, _, _, _ = element_motion(helices.curvatures[loads.elements], loads.arcs)
    arms = np.einsum("kij,kj->ki", pose.frames[loads.elements], rho)
    own = np.add.reduceat(loads.forces, firsts, axis=0)
    own_moments = np.add.reduceat(arms[:, :, None] * loads.forces[:, None, :], firsts, axis=0)
    forces, moments = np.zeros_like(own), np.zeros_like(own_moments)
    counts, first = helices.element_counts, helices.offsets[:-1].astype(np.int64)
    for k in range(int(counts.max(initial=1)) - 1, 0, -1):
        e = first[counts > k] + k
        forces[e - 1] = forces[e] + own[e]
        length = pose.ends[e] - pose.starts[e]
        moments[e - 1] = moments[e] + own_moments[e] + length[:, :, None] * forces[e][:, None, :]
    return forces, moments


def _axial(moments: Float64) -> Float64:
    """sum d x F (..., 3) from sum d F^T (..., 3, 3)."""
    turned = [moments[..., j, k] - moments[..., k, j] for j, k in ((1, 2), (2, 0), (0, 1))]
    return np.stack(turned, axis=-1)


def _own_force(u: Float64, lengths: Float64, loads: Loads, inner: Float64, outer: Float64, moments: Float64) -> Float64:
    """(E, 3) generalised force as a function of an element's own curvatures u, all else held.

    inner (p, 3), outer (E, 3) : the forces within and beyond the element, in the frame of its start. moments (E, 3, 3):
    sum d F^T of what is beyond, F in the frame of the start and d in that of the end.
    """
    firsts = np.searchsorted(loads.elements, np.arange(len(u)))
    _, slope, _, _ = element_motion(u[loads.elements], loads.arcs)
    force: Float64 = np.add.reduceat(np.einsum("kji,kj->ki", slope, inner), firsts, axis=0)
    _, slope, rotation, turn = element_motion(u, lengths)
    force += np.einsum("kji,kj->ki", slope, outer)
    force += np.einsum("kji,kj->ki", turn, _axial(rotation @ moments))
    return force


def _own_parts(helices: Helices, pose: Pose, loads: Loads) -> tuple[Float64, Float64, Float64]:
    """inner, outer and moments of `_own_force`."""
    forces, moments = outer_loads(helices, pose, loads)
    inner = np.einsum("kji,kj->ki", pose.frames[loads.elements], loads.forces)
    outer = np.einsum("kji,kj->ki", pose.frames, forces)
    _, _, rotation, _ = element_motion(helices.curvatures, helices.lengths)
    to_end = np.swapaxes(pose.frames @ rotation, 1, 2)
    return inner, outer, to_end @ moments @ pose.frames


def load_force(helices: Helices, pose: Pose, loads: Loads) -> Float64:
    """(E, 3) N m^2, generalised force f of loads: their work by a change of q (right side of eq. 9)."""
    return _own_force(helices.curvatures, helices.lengths, loads, *_own_parts(helices, pose, loads))


@dataclass(frozen=True, slots=True)
class LoadStiffness:
    """df/dq of loads, symmetric: own (E, 3, 3) of an element with itself; with any later element of the same rod it is
    -turn[i]^T moved[j], turn (E, 3, 3) and moved (E, 3, 3) = sum of F x d point / d q_j. N m^3."""

    own: Float64
    turn: Float64
    moved: Float64

    def dense(self, first: Int64, count: int) -> Float64:
        """(k, 3 count, 3 count) of the k rods whose `count` elements begin at first (k,)."""
        elements = first[:, None] + np.arange(count)
        blocks: Float64 = -np.einsum("kiba,kjbc->kiajc", self.turn[elements], self.moved[elements])
        later = np.arange(count)[:, None] < np.arange(count)
        blocks *= later[None, :, None, :, None]
        blocks += np.einsum("kiajc->kjcia", blocks)
        diagonal = np.arange(count)
        blocks[:, diagonal, :, diagonal, :] = np.swapaxes(self.own[elements], 0, 1)
        return blocks.reshape(len(first), 3 * count, 3 * count)


def load_stiffness(helices: Helices, pose: Pose, loads: Loads) -> LoadStiffness:
    """df/dq of loads (M-26): minus the Hessian of their potential.

    An element before j feels q_j only by the turning moment of what q_j moves: one matrix for each j. The element's
    own block is a central difference of the closed form.
    """
    parts = _own_parts(helices, pose, loads)
    u = helices.curvatures
    own = np.empty((len(u), 3, 3))
    for axis in range(3):
        step = np.zeros_like(u)
        step[:, axis] = _TURN_STEP / helices.lengths
        difference = _own_force(u + step, helices.lengths, loads, *parts)
        difference -= _own_force(u - step, helices.lengths, loads, *parts)
        own[:, :, axis] = difference / (2.0 * step[:, axis, None])
    forces, moments = outer_loads(helices, pose, loads)
    firsts = np.searchsorted(loads.elements, np.arange(len(u)))
    _, slope, _, _ = element_motion(u[loads.elements], loads.arcs)
    moved = np.add.reduceat(cross_matrix(loads.forces) @ pose.frames[loads.elements] @ slope, firsts, axis=0)
    moved += cross_matrix(forces) @ pose.end_shift
    trace = np.einsum("kii->k", moments)[:, None, None]
    moved += (trace * np.eye(3) - moments) @ pose.end_turn
    return LoadStiffness((own + np.swapaxes(own, 1, 2)) / 2.0, pose.end_turn, moved)
