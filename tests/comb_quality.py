"""What a stroke did to hair, in numbers: detail kept, hair in the brush, lengths, roots, depth in the head.

Shared by the tests, `docs/figure_comb.py` and scripts. Strands are in world space, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hairloom.editing.binding import bind_strands
from hairloom.editing.brush import project
from hairloom.editing.comb import CombSession
from hairloom.editing.grips import nearest_on
from hairloom.editing.strokes import Stroke, View
from hairloom.geometry.collider import Collider
from hairloom.geometry.frames import transport_frames
from hairloom.geometry.head import HeadSurface
from hairloom.geometry.strands import resample, strand_lengths
from hairloom.synthesis.detail_statistics import detail_spectrum, spectrum_distance
from hairloom.types import Bools, Float32, Float64, Int32, StrandSet, WispHierarchy
from scipy.ndimage import gaussian_filter1d

HEAD_RADIUS = 0.1  # metres: the unit of the spectra's wavelengths
STRONG = 0.02  # metres that a strand has to go anywhere to count as strongly combed
N_SAMPLES = 64  # points that strands are compared with
REACHABLE = 0.95  # share of its length that a strand can be expected to be pulled straight to
WITHIN = 0.1  # of the brush's radius: the limit for hair that stays in the brush


def composed_labels(hierarchy: WispHierarchy) -> tuple[Int32, ...]:
    """Per level of wisps, finest first, (S,) int32: the wisp of each strand of the groom."""
    found = [hierarchy.labels[0]]
    for labels in hierarchy.labels[1:]:
        found.append(labels[found[-1]])
    return tuple(found)


def look(
    eye: Sequence[float], target: Sequence[float], size: tuple[float, float] = (1000.0, 800.0), angle: float = 0.6
) -> View:
    """A perspective view from `eye` to `target`, metres, z up; `angle` is the vertical field of view, radians."""
    place = np.asarray(eye, np.float64)
    forward = np.asarray(target, np.float64) - place
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    to_view = np.eye(4)
    to_view[:3, :3] = np.stack([right, np.cross(right, forward), -forward])
    to_view[:3, 3] = -to_view[:3, :3] @ place
    near, far, scale = 0.01, 100.0, 1.0 / np.tan(angle / 2.0)
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1], clip[3, 2] = scale * size[1] / size[0], scale, -1.0
    clip[2, 2], clip[2, 3] = -(far + near) / (far - near), -2.0 * far * near / (far - near)
    return View(clip @ to_view, *size)


def drag(view: View, start: Sequence[float], way: Sequence[float], steps: int = 20) -> Float64:
    """(steps, 3) samples of a straight stroke: from the picture of a world point (3,), by `way` (2,) pixels."""
    first = project(view).pixels(np.asarray([start], np.float64))[0][0]
    places = first + np.linspace(0.0, 1.0, steps)[:, None] * np.asarray(way, np.float64)
    return np.column_stack([places, np.ones(steps)])


def ways(before: StrandSet, points: Float32) -> Float64:
    """(S,) metres that each strand went where it went farthest."""
    return np.maximum.reduceat(np.linalg.norm(points - before.points.astype(np.float64), axis=1), before.offsets[:-1])


# --- detail ---


def straightened(strands: StrandSet, labels: Int32 | None, smoothing: float = 0.0) -> Float32:
    """(S, N, 3) the strands with the bends of their wisps' centers taken out, metres: what the finer levels add.

    Each edge is expressed in the frame that its center strand has at the same share of the length, transported from the
    root without twist (M-6), and the edges are put together again. A center is the mean of its wisp's strands at equal
    shares of their lengths (W-12), smoothed by a Gaussian of `smoothing` of the strand.
    """
    samples = resample(strands, N_SAMPLES).astype(np.float64)
    binding = bind_strands(strands, labels, N_SAMPLES)
    centers = binding.centers.astype(np.float64)
    if smoothing > 0:
        centers = gaussian_filter1d(centers, smoothing * N_SAMPLES, axis=1, mode="nearest")
    frames = transport_frames(centers, np.tile([0.0, 0.0, 1.0], (len(centers), 1))).astype(np.float64)
    own = np.einsum("snji,snj->sni", frames[binding.labels, :-1], np.diff(samples, axis=1))
    result = np.zeros(samples.shape, np.float32)
    result[:, 1:] = np.cumsum(own, axis=1)
    return result


@dataclass(frozen=True, slots=True)
class DetailKept:
    """Distances, 0 equal .. 1 nothing in common, between spectra before and after, of the strands combed strongly.

    finer_* : of the strands with the bends of their largest wisps' centers taken out (`straightened`). whole_* : of the
    strands as they are, bends that were combed in included. n_strands : how many strands were combed strongly.
    """

    finer_curvature: float
    finer_torsion: float
    whole_curvature: float
    whole_torsion: float
    n_strands: int


def detail_kept(before: StrandSet, points: Float32, labels: Int32 | None, strong: Bools | None = None) -> DetailKept:
    """How much the spectra of curvature and torsion changed; `labels` (S,) are those of the largest wisps.

    All wavelengths from four samples (a sixteenth of the strand) to the strand's length count, as the finer levels have
    some at all of them: curls at a few centimetres, flyaways that leave their wisp for good at the longest. What the
    comb bends is told apart by where it is, in the centers, not by its wavelength: it bends over a few centimetres too.
    strong (S,) : the strands to compare; by default those that went farther than STRONG.
    """
    after = StrandSet(points, before.offsets)
    chosen = ways(before, points) > STRONG if strong is None else strong
    found: list[float] = []
    for first, second in (
        (straightened(before, labels), straightened(after, labels)),
        (resample(before, N_SAMPLES), resample(after, N_SAMPLES)),
    ):
        a, b = (detail_spectrum(np.ascontiguousarray(x[chosen]) / np.float32(HEAD_RADIUS)) for x in (first, second))
        found += [spectrum_distance(a.curvature, b.curvature), spectrum_distance(a.torsion, b.torsion)]
    return DetailKept(*found, int(chosen.sum()))


# --- grip ---


def held_at_start(session: CombSession) -> Int32:
    """The centers (n,) that the brush holds with all its strength; call it after the stroke's first sample."""
    running = session._stroke
    assert running is not None
    return np.flatnonzero(running._grips[0] >= 0.999).astype(np.int32)


def share_held(session: CombSession) -> float:
    """The share of the strands whose centers the brush holds, however loosely, in the running stroke."""
    running = session._stroke
    assert running is not None
    return float((running._grips.max(axis=0) > 0)[running._binding.labels].mean())


@dataclass(frozen=True, slots=True)
class GripKept:
    """share : of the held strands or centers that can reach their place, how many are within WITHIN radii beside it.

    median : of how far beside they are, in radii. n_held, n_reachable : how many touch the brush, and how many of these
    can reach. `share` is nan where none can.
    """

    share: float
    median: float
    n_reachable: int
    n_held: int


def grip_kept(before: Float64, after: Float64, view: View, samples: Float64, radius: float) -> GripKept:
    """Whether hair (n, N, 3) stayed in the brush over a stroke (m, 2 or 3), pixels.

    The contact of a strand is the place where its picture is nearest to the middle of the brush at the first sample.
    At the end of the stroke the brush wants it at the same place beside its middle; hair may slip along itself, so what
    counts is how far the strand passes from there. Only strands that touch the brush are looked at, and only those
    whose length would allow it: the wanted place, at the contact's depth, is nearer to the root than REACHABLE lengths.
    """
    projection = project(view)
    places = samples[:, :2]
    count, n_points = before.shape[:2]
    pixels = [
        projection.pixels(x.reshape(-1, 3).astype(np.float64))[0].reshape(count, n_points, 2) for x in (before, after)
    ]
    contacts, where = nearest_on(pixels[0], np.broadcast_to(places[0], (count, 2)))
    move = places[-1] - places[0]
    goals = contacts + move
    found, _ = nearest_on(pixels[1], goals)
    away = np.linalg.norm(found - goals, axis=1) / radius
    held_points = before[np.arange(count), np.rint(where).astype(int)].astype(np.float64)
    wanted = held_points + projection.moves(held_points, move)
    lengths = np.linalg.norm(np.diff(before.astype(np.float64), axis=1), axis=2).sum(axis=1)
    touches = np.linalg.norm(contacts - places[0], axis=1) <= radius
    reachable = touches & (np.linalg.norm(wanted - before[:, 0], axis=1) < REACHABLE * lengths)
    within = away[reachable] < WITHIN
    n_reachable = int(reachable.sum())
    if n_reachable == 0:
        return GripKept(float("nan"), float("nan"), 0, int(touches.sum()))
    return GripKept(float(within.mean()), float(np.median(away[reachable])), n_reachable, int(touches.sum()))


# --- what must hold after any stroke ---


@dataclass(frozen=True, slots=True)
class Kept:
    """length_error : the largest change of a strand's length, as a share of it. root_error : metres.

    deepest : metres, how deep in the head the deepest point is that moved, measured from where it was if that was in
    the head already; negative where all are outside. moved : share of the points that moved.
    """

    length_error: float
    root_error: float
    deepest: float
    moved: float


def kept(before: StrandSet, points: Float32, surface: HeadSurface | None = None) -> Kept:
    """Compare points (P, 3) after a stroke with the strands before."""
    lengths = strand_lengths(before), strand_lengths(StrandSet(points, before.offsets))
    ratio = lengths[1] / np.maximum(lengths[0], 1e-9)
    roots = np.abs(points[before.offsets[:-1]] - before.roots)
    has_moved = (points != before.points).any(axis=1)
    deepest = -np.inf
    if surface is not None and has_moved.any():
        was, now = (-surface.signed_distance(x[has_moved]) for x in (before.points, points))
        deepest = float(np.minimum(now, now - np.maximum(was, 0.0)).max())
    return Kept(float(np.abs(ratio - 1.0).max()), float(roots.max()), deepest, float(has_moved.mean()))


# --- a whole stroke ---


@dataclass(frozen=True, slots=True)
class Combed:
    """points (P, 3) after a stroke; held (K,) bool: the centers that the brush held fully at the first sample.

    labels (S,): the center of each strand; centers_before (K, N, 3).
    """

    points: Float32
    held: Bools
    labels: Int32
    centers_before: Float32

    def centers_grip(self, before: StrandSet, stroke: Stroke) -> GripKept:
        """Did the centers stay in the brush? They are made anew from the combed hair."""
        after = bind_strands(StrandSet(self.points, before.offsets), self.labels, N_SAMPLES).centers
        view, radius = stroke.view, stroke.params.radius
        return grip_kept(self.centers_before[self.held], after[self.held], view, stroke.samples, radius)

    def strands_grip(self, before: StrandSet, stroke: Stroke) -> GripKept:
        """Did the single strands that the brush touched, of centers that it held, stay in it?"""
        return strands_grip(before, self.points, self.held[self.labels], stroke)


def strands_grip(before: StrandSet, points: Float32, chosen: Bools, stroke: Stroke) -> GripKept:
    """Did the chosen strands (S,) stay in the brush?"""
    first, second = (resample(StrandSet(x, before.offsets), N_SAMPLES) for x in (before.points, points))
    return grip_kept(first[chosen], second[chosen], stroke.view, stroke.samples, stroke.params.radius)


def play(before: StrandSet, labels: Sequence[Int32], stroke: Stroke, collider: Collider | None = None) -> Combed:
    """Make a stroke on the hair."""
    session = CombSession(before, labels, collider)
    level = len(labels) if stroke.params.level < 0 else stroke.params.level
    binding = bind_strands(before, labels[level - 1] if level else None, N_SAMPLES)
    session.begin(stroke.params, stroke.view, stroke.frame, stroke.selection)
    session.move(*stroke.samples[0].tolist())
    held = np.zeros(binding.n_centers, np.bool_)
    held[held_at_start(session)] = True
    for sample in stroke.samples[1:].tolist():
        session.move(*sample)
    session.end()
    return Combed(session.points, held, binding.labels, binding.centers)
