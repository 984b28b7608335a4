"""Go on with a simulation that was cancelled or cut short."""

from __future__ import annotations

import bpy

from .. import scene, simulation
from .simulate import SimulationJob


class HAIRLOOM_OT_resume_simulation(SimulationJob, bpy.types.Operator):
    """Go on with the simulation that was cancelled or cut short, after its last frame; the result is as if in one go"""

    bl_idname = "hairloom.resume_simulation"
    bl_label = "Resume"
    bl_options = {"UNDO"}
    is_resumed = True

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return scene.allowed(cls, simulation.why_no_resume(context))


CLASSES = (HAIRLOOM_OT_resume_simulation,)
