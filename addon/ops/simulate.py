"""Simulate the active groom over the scene's frames, into a cache that is played back."""

from __future__ import annotations

import bpy

from .. import lazy, playback, scene, simulation
from ..backend.errors import require
from ..jobs import JobOperator, Values


class SimulationJob(JobOperator):
    """What a simulation from the start and one that goes on share."""

    job = "simulate"
    is_resumed = False

    def sources(self, context: bpy.types.Context) -> dict[str, bpy.types.Object]:
        # the names tell what each object is; colliders keep their order
        others = {f"collider {number}": obj for number, obj in enumerate(simulation.colliders(context))}
        return {**simulation.groom_and_head(context), **others}

    def read(self, sources: dict[str, bpy.types.Object]) -> Values:
        state, text = playback.status(sources["groom"])
        require(state != playback.EDITED, text)
        bridge = lazy.bridge("simulation")
        settings = bpy.context.scene.hairloom.simulation
        others = [obj for name, obj in sources.items() if name.startswith("collider ")]
        reading = bridge.read_scene(
            bpy.context,
            sources["groom"],
            sources.get("head"),
            others,
            friction=settings.collider_friction,
            air_speed=settings.air_speed,
            collide_head=settings.collide_head,
        )
        self._remarks = reading.remarks
        self._groom = sources["groom"].name
        self._scene_mark = lazy.bridge("fingerprint").fingerprint({"scene": reading.scene})[:12]
        return bridge.simulation_inputs(reading, sources["groom"])

    def watched(self, sources: dict[str, bpy.types.Object], inputs: Values | None = None) -> Values:
        # the groom alone: reading the whole scene again takes long, and what else changed is simulated the next time
        return lazy.bridge("simulation").own_positions(sources["groom"])

    def params(self, context: bpy.types.Context) -> Values:
        groom = scene.active_groom(context)
        self._folder = simulation.next_cache(groom)
        return {
            **scene.settings(context).simulation.to_params(),
            "cache": str(self._folder),
            # a simulation goes on only in the scene that it began in
            "fingerprint": f"{playback.fingerprint(groom)}-{self._scene_mark}",
            "resume": self.is_resumed,
        }

    def apply(self, context: bpy.types.Context, sources: dict[str, bpy.types.Object], outputs: Values) -> str:
        groom, before = sources["groom"], playback.folder(sources["groom"])
        playback.attach(groom, self._folder)
        simulation.drop_old_caches(groom, {self._folder, before})
        return simulation.remember_report(groom, outputs["report"], self._remarks)

    def when_cancelled(self) -> str:
        groom = bpy.data.objects.get(self._groom)
        kept = simulation.unfinished(groom) if groom is not None else None
        if kept is None:
            return "nothing was changed"
        return f"{kept.n_frames} of {kept.n_planned} frames are kept: Resume goes on from there"


class HAIRLOOM_OT_simulate(SimulationJob, bpy.types.Operator):
    """Simulate the active groom over the frames of the scene and play the result back. The groom as it is at the first
    frame is what it hangs like at rest
    """

    bl_idname = "hairloom.simulate"
    bl_label = "Simulate"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, simulation.why_no_simulation(context))


CLASSES = (HAIRLOOM_OT_simulate,)
