"""Weights of followers from a short motion in which they are simulated too (Chai et al. 2014; B-27, M-27)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import require
from ..geometry.strands import select_strands, strand_lengths
from ..progress import NO_PROGRESS, Progress, subrange
from ..types import Float64, Int32, StrandSet, check_array
from ._training_kernels import add_errors, solve_weights
from .dynamics import Stepper
from .equilibrium import EquilibriumParams, find_rest_shape
from .fitting import FitParams, fit_helices
from .helices import Helices, evaluate
from .interpolation import FollowerParams, Followers, motions_of_guides
from .material import MaterialParams
from .model import RodState, initial_state, make_rods

_FPS, _SUBSTEPS = 24.0, 2
_GRAVITY = np.array([0.0, 0.0, -9.81])
# the head shakes and nods so far, with so many turns a second, in air of such a speed that goes round
_SHAKE_DEG, _SHAKE_HZ, _NOD_DEG, _NOD_HZ = 20.0, 1.7, 15.0, 1.1
_WIND_SPEED, _WIND_HZ = 4.0, 0.6
_SHORTEST = 1e-4  # m; shorter strands cannot be simulated


@dataclass(frozen=True, slots=True)
class TrainingFrame:
    """One frame of a motion: guides and hairs at the same M samples along their length, metres, one space.

    points : (G, M, 3), frames : (G, M, 3, 3), the guides. hairs : (n, M, 3). All float64.
    """

    points: Float64
    frames: Float64
    hairs: Float64


def fit_weights(
    followers: Followers, chosen: Int32, rest: Float64, motion: Iterable[TrainingFrame], ridge: float
) -> Followers:
    """The followers with new weights of the chosen strands, by constrained least squares (M-27).

    Of each knot: min sum_frames |sum_g w_g B_g x0 - x|^2 + ridge E |w - w0|^2 with sum w = 1 and w >= 0, over the
    samples around the knot by how near they are; B the guides' rigid motions, w0 the weights of `followers`, E the mean
    squared error of a single guide of the strand. Only sums over the frames are held, so the motion may be long.

    Parameters
    ----------
    chosen : (n,) int32, strands, each once. rest : (n, M, 3) float64, metres, where their samples are at rest.

    Raises
    ------
    InputError : strands that are not there, arrays of other shapes, no frames.
    """
    check_array("chosen", chosen, np.int32, (None,))
    require(len(chosen) > 0, "no strands are chosen for training; choose one or more")
    known = chosen.min() >= 0 and chosen.max() < followers.n_strands and len(np.unique(chosen)) == len(chosen)
    require(known, f"the strands chosen for training must be different ones in 0..{followers.n_strands - 1}")
    check_array("rest", rest, np.float64, (len(chosen), followers.n_samples, 3))
    guides = np.ascontiguousarray(followers.guides[chosen])
    prior = np.ascontiguousarray(followers.weights[chosen])
    products = np.zeros((*prior.shape, followers.n_neighbours))
    count = 0
    for frame in motion:
        check_array("points", frame.points, np.float64, followers.guide_points.shape)
        check_array("frames", frame.frames, np.float64, followers.guide_frames.shape)
        check_array("hairs", frame.hairs, np.float64, rest.shape)
        motions, centre = motions_of_guides(followers, frame.points, frame.frames)
        add_errors(motions, centre, guides, np.ascontiguousarray(rest), np.ascontiguousarray(frame.hairs), products)
        count += 1
    require(count > 0, "the training motion has no frames; give one or more")
    weights = followers.weights.copy()
    found = np.empty_like(prior)
    solve_weights(products, prior, ridge, found)
    weights[chosen] = found
    return replace(followers, weights=weights)


def train_followers(
    followers: Followers,
    strands: StrandSet,
    helices: Helices,
    material: MaterialParams,
    params: FollowerParams = FollowerParams(),
    *,
    progress: Progress = NO_PROGRESS,
) -> Followers:
    """Weights from a short simulation of guides and hairs without contact: the head shakes and nods in turning wind.

    A seeded choice of `params.training_strands` strands is simulated; the others keep their weights by distance. Guides
    and hairs are rods of one material, each for as many hairs as its wisp has, and rest under gravity at the start.

    Parameters
    ----------
    strands, helices : what the followers were bound with: all hair and the guides, at rest, world space, metres.

    Raises
    ------
    InputError : strands or helices that are not those of the followers. Cancelled : from `progress`.
    """
    require(strands.n_strands == followers.n_strands, "the followers are of another groom; bind it again")
    require(helices.n_strands == followers.n_guides, "the followers are of other guides; bind the hair again")
    chosen = _choose(strands, followers, params)
    if not len(chosen):
        return followers
    progress(0.0, f"Training: fitting {len(chosen)} strands")
    hairs = fit_helices(select_strands(strands, chosen), FitParams()).helices
    wisp_sizes = np.maximum(np.bincount(followers.guides[:, 0], minlength=followers.n_guides), 1).astype(np.float64)
    sizes = np.concatenate([wisp_sizes, wisp_sizes[followers.guides[chosen, 0]]])
    motion = simulated_motion(join_helices(helices, hairs), sizes, material, params, progress=progress)
    rest = evaluate(hairs, followers.n_samples)[0]
    n_guides = helices.n_strands
    frames = (
        TrainingFrame(points[:n_guides], frames[:n_guides], np.ascontiguousarray(points[n_guides:]))
        for points, frames in motion
    )
    return fit_weights(followers, chosen, rest, frames, params.ridge)


def _choose(strands: StrandSet, followers: Followers, params: FollowerParams) -> Int32:
    """(n,) int32, rising: strands to simulate, of those that are long enough and not guides themselves."""
    alone = (followers.weights == 1.0).any(axis=2).all(axis=1)
    usable = np.flatnonzero((strand_lengths(strands) > _SHORTEST) & ~alone)
    rng = np.random.default_rng(params.seed)
    count = min(params.training_strands, len(usable))
    return np.sort(rng.choice(usable, count, replace=False)).astype(np.int32)


def join_helices(first: Helices, second: Helices) -> Helices:
    """The strands of both, in order."""
    return Helices(
        np.concatenate([first.roots, second.roots]),
        np.concatenate([first.frames, second.frames]),
        np.concatenate([first.offsets, first.offsets[-1] + second.offsets[1:]]).astype(np.int32),
        np.concatenate([first.lengths, second.lengths]),
        np.concatenate([first.curvatures, second.curvatures]),
    )


def simulated_motion(
    helices: Helices,
    hairs: Float64,
    material: MaterialParams,
    params: FollowerParams,
    *,
    progress: Progress = NO_PROGRESS,
) -> Iterator[tuple[Float64, Float64]]:
    """The training motion, frame by frame: points (S, M, 3) and frames (S, M, 3, 3) of rods that start at rest.

    hairs : (S,) float64, 1 or more, that each rod stands for.
    """
    rods = find_rest_shape(make_rods(helices, material, hairs=hairs), helices, _GRAVITY, None, EquilibriumParams()).rods
    state, stepper = initial_state(helices), Stepper(rods)
    middle = helices.roots.mean(axis=0)
    n_steps = params.training_frames * _SUBSTEPS
    dt = 1.0 / (_FPS * _SUBSTEPS)
    part = subrange(progress, 0.1, 1.0)
    for step in range(1, n_steps + 1):
        part(step / n_steps, f"Training: frame {step // _SUBSTEPS} of {params.training_frames}")
        turn, wind = training_pose(step * dt)
        roots = middle + (helices.roots - middle) @ turn.T
        air = np.broadcast_to(wind, (len(rods.lengths), 3))
        stepper.begin(state, roots, turn @ helices.frames, dt, _GRAVITY, np.ascontiguousarray(air))
        stepper.end(state)
        if step % _SUBSTEPS == 0:
            yield evaluate(_as_helices(helices, state), params.n_samples)


def training_pose(seconds: float) -> tuple[Float64, Float64]:
    """The head's turn (3, 3) about the middle of the roots, and the wind (3,), m/s: both 0 at the start."""
    shake = np.sin(2.0 * np.pi * _SHAKE_HZ * seconds) * _SHAKE_DEG
    nod = np.sin(2.0 * np.pi * _NOD_HZ * seconds) * _NOD_DEG
    turn = Rotation.from_euler("zx", [shake, nod], degrees=True).as_matrix()
    phase = 2.0 * np.pi * _WIND_HZ * seconds
    grown = _WIND_SPEED * min(1.0, 4.0 * _WIND_HZ * seconds)
    return turn, grown * np.array([np.cos(phase), np.sin(phase), 0.0])


def _as_helices(helices: Helices, state: RodState) -> Helices:
    return Helices(state.roots, state.frames, helices.offsets, helices.lengths, state.curvatures)
