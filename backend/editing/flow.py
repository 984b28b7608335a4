"""The flow of a groom as strands of its own, edited with any tool, and the hair that follows it (W-U4).

Wang et al. 2009, sec. 6: the user edits the coarsest level, or imposes another one, and the finer levels come back. A
flow strand is the mean of a wisp. Each point of a hair strand keeps its place along its flow strand and its
displacement in the transported frame there (sec. 5.2, M-6); both stay valid whatever moves, bends, resamples or
simulates the flow. A strand keeps the lengths of its segments, and its root where the flow strand's root says.

All positions are in world space, metres.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np

from ..errors import require
from ..geometry._grouping_kernels import list_members
from ..geometry.frames import transport_frames
from ..geometry.strands import from_dense, resample, resample_smooth, strand_lengths, strand_of_point, subdivide
from ..types import Bools, Float32, Float64, Floats, Int32, StrandSet
from ._binding_kernels import average_members
from ._flow_kernels import bind_points, lay_strands, measure_marks, place_strands

UNBOUND = 0  # the id of a strand that belongs to no flow strand
_N_NODES = 65  # points of equal arc length at which a flow strand's shape and frames are taken
_SUBDIVISION = 4  # pieces of a flow strand's segment: the same for every flow, so that all are read alike
_IDS = 2**31 - 1
# relative difference of a strand's marks that is no edit, and what rounding adds to it, metres a point
_MARK_SHARE, _MARK_ROUNDING = 1e-4, 1e-6


@dataclass(frozen=True, slots=True)
class Flow:
    """K flow strands and what the hair bound to them must know; `strands` may be edited, the rest stays as it was.

    strands : the flow, any number of points a strand.
    ids : (K,) int32 above 0, unique. Of a repeated id the first strand counts.
    normals, tangents : (K, 3) float32 unit vectors, the frame at the root when the hair was bound; they turn with the
        flow as a whole (the object), not with its bending.
    widths : (K,) float32, metres, over which the flow strand's direction is taken on both sides of a point.
    lengths : (K,) float32, metres, of the flow strands when the hair was bound.
    """

    strands: StrandSet
    ids: Int32
    normals: Float32
    tangents: Float32
    widths: Float32
    lengths: Float32

    def __post_init__(self) -> None:
        count = self.strands.n_strands
        require(count > 0, "the flow has no strands; undo what deleted them, or run Extract Flow again")
        for name, shape in (("ids", ()), ("normals", (3,)), ("tangents", (3,)), ("widths", ()), ("lengths", ())):
            found = getattr(self, name).shape
            require(found == (count, *shape), f"the flow's {name} have shape {found}, not {(count, *shape)}")


@dataclass(frozen=True, slots=True)
class FlowBinding:
    """How S strands with P points hang on flow strands.

    ids : (S,) int32, the flow strand of each strand; UNBOUND (0) for none.
    places : (P,) float32, metres along the flow strand; beyond its length it goes straight on.
    offsets : (P, 3) float32, metres: displacement from the flow there, along the normal, binormal and tangent.
    steps : (P,) float32, metres: the length of the segment before each point, 0 at roots.
    """

    ids: Int32
    places: Float32
    offsets: Float32
    steps: Float32

    def require_fit(self, strands: StrandSet) -> None:
        """Raise InputError where this is the binding of other strands."""
        n_points = len(strands.points)
        fits = len(self.ids) == strands.n_strands and {len(self.places), len(self.steps)} == {n_points}
        require(
            fits and self.offsets.shape == (n_points, 3),
            f"the binding of {len(self.ids)} strands with {len(self.places)} points does not fit "
            f"{strands.n_strands} strands with {n_points} points; run Extract Flow again",
        )


@dataclass(frozen=True, slots=True)
class Marks:
    """By what an edited strand is told from one that only moved as a whole.

    reaches : (S,) float32, metres: the sum of the distances of a strand's points from its root.
    headings : (S, 3) float32: the sum of the points' vectors from the root, over `reaches`.
    """

    reaches: Float32
    headings: Float32


def extract_flow(strands: StrandSet, labels: Int32, n_points: int = 32) -> tuple[Flow, FlowBinding]:
    """The mean strand of each wisp, and the hair bound to it.

    Parameters
    ----------
    strands : S strands. labels : (S,) int32, the wisp of each strand, 0 or more; numbers may be left out.
    n_points : points of a flow strand, 4 .. 512.

    Returns
    -------
    Flow : strands in the order of their labels; a flow strand's root is the mean of its hair's roots. The ids come
        from the strands' positions, so that the flows of several grooms can be joined.
    FlowBinding : of all strands.

    Raises
    ------
    InputError : no strands, labels that do not fit, or n_points out of its range.
    """
    require(strands.n_strands > 0, "there are no strands to take a flow from; choose a groom that has strands")
    require(4 <= n_points <= 512, f"a flow strand cannot have {n_points} points; choose 4 to 512")
    require(
        labels.shape == (strands.n_strands,),
        f"there are {labels.size} wisp numbers for {strands.n_strands} strands; run Cluster Wisps again",
    )
    require(labels.min() >= 0, f"strand {int(labels.argmin())} is in no wisp; run Cluster Wisps again")
    _, wisp = np.unique(labels, return_inverse=True)
    flow_of = wisp.reshape(-1).astype(np.int32)
    means = from_dense(_means(resample_smooth(strands, n_points), flow_of))
    ids = _new_ids(means)
    flow = _unframed(means, ids)
    state = _read_state(flow)
    places = np.empty(len(strands.points), np.float32)
    distances = np.empty(len(strands.points))
    points = np.ascontiguousarray(strands.points)
    place_strands(points, strands.offsets, flow_of, state.nodes, state.frames, state.lengths, places, distances)
    widths = _widths(distances, flow_of[strand_of_point(strands)], state.lengths)
    flow = _framed(replace(flow, widths=widths, lengths=state.lengths.astype(np.float32)))
    state = _read_state(flow)
    local, steps = np.empty_like(points), np.empty_like(places)
    bind_points(points, strands.offsets, flow_of, state.nodes, state.frames, state.lengths, places, local, steps)
    return flow, FlowBinding(ids[flow_of], places, local, steps)


def apply_flow(strands: StrandSet, binding: FlowBinding, flow: Flow, *, follow_length: bool = False) -> StrandSet:
    """The hair along the flow as it is now; a strand whose flow strand is missing stays as it is.

    With the flow as it was extracted the hair is where it was, within the rounding of float32; a rigid motion of the
    flow with its normals and tangents moves the hair exactly so. Segments keep their lengths within 0.01 %.

    Parameters
    ----------
    strands : S strands; only those without a flow strand are taken from here. binding : of these strands.
    follow_length : a strand grows and shrinks with its flow strand; else it keeps its length.

    Raises
    ------
    InputError : the binding is of other strands, or no flow strand of the hair is there.
    """
    session = FlowSession(strands, binding)
    session.update(flow, follow_length=follow_length)
    return replace(strands, points=session.points)


class FlowSession:
    """Hair that follows its flow from one state to the next; only strands whose flow strand changed are moved.

    points : (P, 3) float32, the hair now; the same array from first to last.
    n_missing : strands that no flow strand of the last state belongs to.
    """

    def __init__(self, strands: StrandSet, binding: FlowBinding) -> None:
        binding.require_fit(strands)
        self.points = np.array(strands.points, np.float32)
        self.n_missing = 0
        self._offsets = strands.offsets
        self._binding = binding
        self._last_ids = np.zeros(0, np.int32)
        self._last: _State | None = None

    def update(self, flow: Flow, *, follow_length: bool = False) -> int:
        """Bring the hair to the flow's new state; returns how many strands were laid anew."""
        flow_of = _find(self._binding.ids, flow.ids)
        n_missing = int(np.count_nonzero(flow_of < 0))
        require(
            n_missing < len(flow_of),
            f"none of the {flow.strands.n_strands} flow strands belongs to this hair; choose its own flow, or run "
            "Extract Flow again",
        )
        state = _read_state(flow, follow_length=follow_length)
        changed = np.ones(len(flow.ids), np.bool_)
        if self._last is not None and np.array_equal(self._last_ids, flow.ids):
            changed = state.differs_from(self._last)
        chosen = np.flatnonzero((flow_of >= 0) & changed[flow_of])
        binding = self._binding
        lay_strands(
            chosen, self._offsets, flow_of, state.nodes, state.frames, state.lengths, state.root_frames, state.growth,
            binding.places, binding.offsets, binding.steps, self.points,
        )  # fmt: skip
        self._last, self._last_ids, self.n_missing = state, flow.ids, n_missing
        return len(chosen)

    def marks(self) -> Marks:
        """`strand_marks` of the hair now."""
        return _measure(self.points, self._offsets)


def strand_marks(strands: StrandSet) -> Marks:
    """What to keep with strands that were just written, to find edits later with `edited_strands`."""
    return _measure(np.ascontiguousarray(strands.points), strands.offsets)


def edited_strands(before: Marks, after: Marks, point_counts: Int32) -> Bools:
    """(S,) bool: strands that were edited between the two.

    A strand was edited where its distances from its root changed, or where it turned; turned strands count as not
    edited where one rotation explains all of them, three or more (an object's rotation that was applied to its data).
    """
    reaches = np.maximum(after.reaches.astype(np.float64), before.reaches)
    slack = _MARK_SHARE + _MARK_ROUNDING * point_counts / np.where(reaches > 0.0, reaches, np.inf)
    reshaped = np.abs(after.reaches.astype(np.float64) - before.reaches) > slack * reaches
    turned = ~reshaped & (_lengths(after.headings - before.headings) > slack)
    old, new = before.headings[turned].astype(np.float64), after.headings[turned].astype(np.float64)
    if len(old) >= 3:
        left, _, right = np.linalg.svd(new.T @ old)
        sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        if (_lengths(new - old @ (left @ sign @ right).T) <= slack[turned]).all():
            turned[:] = False
    return np.asarray(reshaped | turned)


@dataclass(frozen=True, slots=True)
class _State:
    """A flow as the kernels take it: K strands at F nodes."""

    nodes: Float64  # (K, F, 3)
    frames: Float64  # (K, F, 3, 3)
    lengths: Float64  # (K,)
    root_frames: Float64  # (K, 3, 3)
    growth: Float64  # (K,)

    def differs_from(self, other: _State) -> Bools:
        """(K,) bool."""
        pairs = ((self.nodes, other.nodes), (self.root_frames, other.root_frames), (self.growth, other.growth))
        return np.asarray(np.logical_or.reduce([(a != b).reshape(len(a), -1).any(axis=1) for a, b in pairs]))


def _read_state(flow: Flow, *, follow_length: bool = False) -> _State:
    plain = StrandSet(flow.strands.points, flow.strands.offsets)
    fine = subdivide(plain, _SUBDIVISION)
    lengths = strand_lengths(fine)
    nodes = resample(fine, _N_NODES).astype(np.float64)
    tangents = _directions(nodes, flow, lengths)
    frames = _frames_along(tangents, _turn(flow.normals, flow.tangents, tangents[:, 0]))
    growth = np.ones(len(lengths))
    if follow_length:
        growth = np.where(flow.lengths > 0.0, lengths / np.where(flow.lengths > 0.0, flow.lengths, 1.0), 1.0)
    return _State(nodes, frames, lengths, _root_frames(flow), growth)


def _directions(nodes: Float64, flow: Flow, lengths: Float64) -> Float64:
    """(K, F, 3) unit directions of the flow, of the chord from `widths` before to `widths` after each node.

    Hair beside a sharp bend would run backwards if its frames turned in one place.
    """
    spacing = lengths / (_N_NODES - 1)
    reach = np.rint(flow.widths / np.where(spacing > 0.0, spacing, np.inf)).astype(np.int64)
    reach = np.clip(reach, 1, _N_NODES // 4)[:, None]
    index = np.arange(_N_NODES)
    after = np.minimum(index + reach, _N_NODES - 1)[:, :, None]
    before = np.maximum(index - reach, 0)[:, :, None]
    chords = np.take_along_axis(nodes, after, axis=1) - np.take_along_axis(nodes, before, axis=1)
    # where a chord has no length, the direction from root to tip, and else that of before
    for other in (nodes[:, -1:] - nodes[:, :1], flow.tangents[:, None, :]):
        chords = np.where(_lengths(chords)[..., None] > 0.0, chords, other)
    return np.asarray(chords / _lengths(chords)[..., None])


def _frames_along(tangents: Float64, start_normals: Floats) -> Float64:
    """(K, F, 3, 3) frames with these tangents: those of the strand whose segments run along them (M-6)."""
    run = np.concatenate([np.zeros_like(tangents[:, :1]), np.cumsum(tangents, axis=1)], axis=1)
    return transport_frames(run, start_normals)[:, :-1].astype(np.float64)


def _root_frames(flow: Flow) -> Float64:
    """(K, 3, 3) orthonormal: normal, binormal and tangent at the root when the hair was bound, as the flow turned."""
    tangents = flow.tangents.astype(np.float64)
    normals = flow.normals.astype(np.float64)
    return np.stack([normals, np.cross(tangents, normals), tangents], axis=-1)


def _turn(vectors: Floats, before: Floats, after: Floats) -> Float64:
    """(K, 3): `vectors` turned by the smallest rotation that takes the unit `before` to the unit `after`."""
    vectors, before, after = (np.asarray(array, np.float64) for array in (vectors, before, after))
    axis = np.cross(before, after)
    cosine = np.einsum("kc,kc->k", before, after)[:, None]
    along = np.einsum("kc,kc->k", axis, vectors)[:, None]
    # a turn of 180 degrees has no smallest rotation: the vector is kept
    weight = np.where(cosine > -1.0 + 1e-9, 1.0 / np.maximum(1.0 + cosine, 1e-9), 0.0)
    return np.asarray(cosine * vectors + np.cross(axis, vectors) + weight * along * axis)


def _unframed(means: StrandSet, ids: Int32) -> Flow:
    """The flow before its frames are chosen: directions over a segment, normals that point to no side of their own."""
    count = means.n_strands
    upward = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (count, 1))
    zeros = np.zeros(count, np.float32)
    return Flow(means, ids, np.zeros((count, 3), np.float32), upward, zeros, zeros)


def _framed(flow: Flow) -> Flow:
    """`flow` with the tangents and normals that its strands have at their roots."""
    first = _read_state(flow).frames[:, 0].astype(np.float32)
    return replace(flow, normals=np.ascontiguousarray(first[..., 0]), tangents=np.ascontiguousarray(first[..., 2]))


def _measure(points: Float32, offsets: Int32) -> Marks:
    count = len(offsets) - 1
    reaches, headings = np.empty(count, np.float32), np.empty((count, 3), np.float32)
    measure_marks(points, offsets, reaches, headings)
    return Marks(reaches, headings)


def _means(dense: Float32, flow_of: Int32) -> Float32:
    """(K, N, 3) float32: the mean strand of each wisp of dense strands (S, N, 3)."""
    starts, members = list_members(flow_of, int(flow_of.max()) + 1)
    means = np.empty((len(starts) - 1, *dense.shape[1:]), np.float32)
    average_members(dense, members, starts, means)
    return means


def _widths(distances: Float64, flow_of_point: Int32, lengths: Float64) -> Float32:
    """(K,) float32, metres: twice the usual distance of the hair from the flow strand, a quarter of its length at most.

    A right angle in the flow, spread over that width, folds no hair within twice the usual distance.
    """
    squares = np.bincount(flow_of_point, weights=distances**2) / np.bincount(flow_of_point)
    return np.minimum(2.0 * np.sqrt(squares), lengths / 4.0).astype(np.float32)


def _new_ids(means: StrandSet) -> Int32:
    """(K,) int32, successive numbers above 0 from a start that depends on every position."""
    digest = hashlib.blake2b(means.points.tobytes(), digest_size=8).digest()
    first = 1 + int.from_bytes(digest, "little") % (_IDS - means.n_strands)
    return np.arange(first, first + means.n_strands, dtype=np.int32)


def _find(wanted: Int32, ids: Int32) -> Int32:
    """(S,) int32: the first flow strand with the wanted id, -1 where there is none."""
    known, first = np.unique(ids, return_index=True)
    at = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    found = (known[at] == wanted) & (wanted != UNBOUND)
    return np.where(found, first[at], -1).astype(np.int32)


def _lengths(vectors: Floats) -> Float64:
    """(...,) lengths of vectors (..., 3)."""
    return np.asarray(np.sqrt(np.einsum("...c,...c->...", vectors, vectors)), dtype=np.float64)
