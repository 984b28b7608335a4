"""The job `simulate`: guides of a groom moved over a scene, all hair after them, written to a cache frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import require
from ..geometry.strands import select_strands
from ..io.sim_cache import CacheWriter
from ..progress import Progress, subrange
from ..rods.fitting import FitParams, HelixFit, fit_helices
from ..rods.interpolation import FollowerParams, Followers, bind_followers, interpolate, keep_out, rest_depths
from ..rods.material import MaterialParams
from ..rods.model import make_rods
from ..rods.scene import Scene
from ..rods.simulation import Simulation, SimulationParams
from ..rods.training import train_followers
from ..types import Float32, Float64, Int32, StrandSet

Values = dict[str, Any]


@dataclass(frozen=True, slots=True)
class SimulateParams:
    """All settings of a simulation.

    fit, material, simulation, followers : of the steps. cache : folder to write. fingerprint : what the add-on
    compares to tell a cache that is out of date. resume : go on after the last whole frame of the cache, if it has the
    same fingerprint; the result is the same as in one go.
    """

    fit: FitParams = field(default_factory=FitParams)
    material: MaterialParams = field(default_factory=MaterialParams)
    simulation: SimulationParams = field(default_factory=SimulationParams)
    followers: FollowerParams = field(default_factory=FollowerParams)
    cache: str = ""
    fingerprint: str = ""
    resume: bool = False


def run(inputs: Values, params: SimulateParams, progress: Progress) -> Values:
    """Simulate and write the cache.

    Parameters
    ----------
    inputs : strands (StrandSet, world space at the scene's first frame), guides (G,) int32 strands that are simulated,
        wisps (S,) int32 which of the guides each strand follows most, scene (Scene, root_motion per strand or none),
        object_motion (F, 4, 4) float64 world matrices of the object whose space the cache is in; None for the world.

    Returns
    -------
    report : counts, fit, equilibrium and contacts; `log` one dict a frame.
    """
    require(params.cache != "", "no folder for the cache is given; choose one")
    setting = Setting.make(inputs, params, subrange(progress, 0.0, 0.2))
    for frame in write_cache(setting, params):
        progress(0.2 + 0.8 * frame / setting.simulation.scene.n_frames, f"Frame {frame + setting.scene.frame_start}")
    return {"report": setting.report()}


@dataclass(slots=True)
class Setting:
    """A groom ready to be simulated: its guides, and how the hair follows them."""

    simulation: Simulation
    scene: Scene
    fit: HelixFit
    followers: Followers
    object_motion: Float64 | None
    depths: Float32
    points: Float32

    @classmethod
    def make(cls, inputs: Values, params: SimulateParams, progress: Progress) -> Setting:
        """Fit helices, find the rest shape, bind the hair.

        Raises
        ------
        InputError : no guides, or guides, root motion or object motion that do not fit the groom or the scene.
        """
        strands, scene, object_motion = inputs["strands"], inputs["scene"], inputs.get("object_motion")
        guides, wisps = checked_guides(strands, inputs["guides"], inputs["wisps"])
        n_moved = scene.root_motion.shape[1] if len(scene.root_motion) else strands.n_strands
        require(n_moved == strands.n_strands, f"root_motion is of {n_moved} strands, the groom has {strands.n_strands}")
        require(
            object_motion is None or len(object_motion) == scene.n_frames,
            f"object_motion must have a matrix for each of the scene's {scene.n_frames} frames",
        )
        progress(0.0, "Fitting helices to the guides")
        fit = fit_helices(select_strands(strands, guides), params.fit)
        hairs = np.bincount(wisps, minlength=len(guides)).astype(np.float64)
        rods = make_rods(fit.helices, params.material, hairs=hairs, radius=params.simulation.contact.radius)
        progress(0.1, "Finding the rest shape")
        bends = len(scene.root_motion) > 0
        moving = np.ascontiguousarray(scene.root_motion[:, guides]) if bends else scene.root_motion
        simulation = Simulation(rods, fit.helices, replace(scene, root_motion=moving), params.simulation)
        progress(0.4, "Binding the hair to the guides")
        followers = bind_followers(strands, fit.helices, params.followers, guides=guides, wisps=wisps)
        if params.followers.training:
            part = subrange(progress, 0.4, 1.0)
            followers = train_followers(
                followers, strands, fit.helices, params.material, params.followers, progress=part
            )
        depths = rest_depths(followers, simulation.solids(0.0, 0.0))
        return cls(simulation, scene, fit, followers, object_motion, depths, strands.points.copy())

    def place(self) -> Float32:
        """(P, 3) float32: all hair now, in the space of the cache; overwritten by the next call."""
        frame = self.simulation.frame
        # followed in a space that moves with the head: exact for hair that rests, and at any distance from the origin
        carried = self.scene.motion[frame] @ np.linalg.inv(self.scene.motion[0])
        back = np.linalg.inv(carried)
        if frame == 0:
            self.points[:] = self.followers.points
        else:
            points, frames = self.simulation.sample(self.followers.n_samples)
            points, frames = points @ back[:3, :3].T + back[:3, 3], np.matmul(back[:3, :3], frames)
            bends = len(self.scene.root_motion) > 0
            roots = np.matmul(back, _homogeneous(self.scene.root_motion[frame]))[:, :3] if bends else None
            interpolate(self.followers, points, frames, self.points, roots=roots)
            solids = [replace(solid, matrix=back @ solid.matrix) for solid in self.simulation.solids(frame, frame)]
            keep_out(self.followers, self.points, solids, self.depths)
        into = carried if self.object_motion is None else np.linalg.inv(self.object_motion[frame]) @ carried
        if np.abs(into - np.eye(4)).max() < 1e-9:
            return self.points
        return np.asarray(self.points @ into[:3, :3].T + into[:3, 3], np.float32)

    def report(self) -> Values:
        """What to tell the user, for JSON."""
        equilibrium = self.simulation.equilibrium
        return {
            "strands": self.followers.n_strands,
            "guides": self.fit.helices.n_strands,
            "elements": len(self.fit.helices.lengths),
            "fit_rms": float(np.sqrt(np.mean(self.fit.rms**2))),
            "fit_maximum": float(self.fit.maximum.max()),
            "equilibrium": None if equilibrium is None else equilibrium.report(),
            "frames": self.simulation.frame + 1,
            "log": self.simulation.log,
        }


def checked_guides(strands: StrandSet, guides: Int32, wisps: Int32) -> tuple[Int32, Int32]:
    """The guides and wisps, if they fit the strands.

    Raises
    ------
    InputError : there are no guides, or they belong to another groom.
    """
    require(len(guides) > 0, "the groom has no guides; make guides first")
    fits = len(wisps) == strands.n_strands and guides.min() >= 0 and guides.max() < strands.n_strands
    require(fits, "the guides belong to another groom, or it was changed since; make guides again")
    known = wisps.min() >= 0 and wisps.max() < len(guides)
    require(known, "a strand follows a guide that is not there; make guides again")
    return guides, wisps


def write_cache(setting: Setting, params: SimulateParams) -> Iterator[int]:
    """Simulate frame by frame into the cache, with the state to go on from; yields each frame before it is made.

    Raises
    ------
    FileError : the cache cannot be written, or cannot be resumed; what is there stays playable.
    """
    simulation, scene = setting.simulation, setting.scene
    if params.resume:
        writer = CacheWriter.resume(params.cache, params.fingerprint)
        simulation.restore(writer.read_state())
    else:
        writer = CacheWriter.create(
            params.cache,
            len(setting.points),
            fps=scene.fps,
            frame_start=scene.frame_start,
            fingerprint=params.fingerprint,
            n_planned=scene.n_frames,
        )
    with writer:
        if not params.resume:
            writer.append(setting.place())
            writer.write_state(simulation.save())
        for frame in range(simulation.frame + 1, scene.n_frames):
            yield frame
            simulation.advance()
            writer.append(setting.place())
            writer.write_state(simulation.save())


def _homogeneous(transforms: Float64) -> Float64:
    """(S, 4, 4) of (S, 3, 4)."""
    last = np.broadcast_to(np.array([0.0, 0.0, 0.0, 1.0]), (len(transforms), 1, 4))
    return np.concatenate([transforms, last], axis=1)
