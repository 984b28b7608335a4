"""The add-on's preferences: compiled kernels and where they are kept."""

from __future__ import annotations

import bpy

from . import jobs, lazy, warmup


class HairloomPreferences(bpy.types.AddonPreferences):
    """Shown in Edit > Preferences > Add-ons"""

    bl_idname = __package__

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        box = layout.box()
        box.label(text="Compiled kernels", icon="MEMORY")
        job = jobs.status(context)
        if job.is_running and job.label == "Compile Kernels":
            jobs.draw_progress(box, job)
        elif warmup.is_running():
            fraction, message = warmup.progress()
            box.progress(factor=fraction, text=message)
        else:
            is_warm = warmup.is_warm()
            text = "Compiled" if is_warm else "Not compiled yet: the first job will take half a minute longer"
            box.label(text=text, icon="CHECKMARK" if is_warm else "TIME")
            box.operator("hairloom.warm_up", text="Compile Again" if is_warm else "Compile Now")
        folder = lazy.kernel_cache_folder()
        row = box.row()
        row.label(text=f"Kept in {folder}" if folder else "The user folder cannot be written: nothing is kept")
        if folder:
            row.operator("wm.path_open", text="", icon="FILE_FOLDER").filepath = lazy.cache_folder()


register, unregister = bpy.utils.register_classes_factory([HairloomPreferences])
