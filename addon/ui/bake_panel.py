"""The panel of playback and baking: how the cache of the active groom plays, and where it can go."""

from __future__ import annotations

import bpy

from .. import playback, scene
from .layout import HairloomPanel, hint

_ICONS = {playback.PLAYING: "CHECKMARK", playback.STALE: "ERROR", playback.EDITED: "ERROR", playback.BROKEN: "CANCEL"}


class HAIRLOOM_PT_bake(HairloomPanel, bpy.types.Panel):
    bl_label = "Playback & Bake"
    # after the simulation
    bl_order = 8

    def draw(self, context: bpy.types.Context) -> None:
        layout, groom = self.layout, scene.active_groom(context)
        if groom is None:
            hint(layout, scene.why_no_groom(context))
            return
        state, message = playback.status(groom)
        if state == playback.NONE:
            hint(layout, "The groom has no simulation yet: press Simulate first")
        else:
            self._draw_cache(context, state, message)
        column = layout.column(align=True)
        column.operator("hairloom.bake_alembic", icon="EXPORT")
        column.operator("hairloom.bake_usd", icon="EXPORT")
        column.operator("hairloom.bake_playback", icon="RENDER_ANIMATION")
        layout.operator("hairloom.export_unreal", icon="EXPORT")
        if playback.BAKED in groom.modifiers:
            hint(layout, f"Blender plays a baked file: see the modifier {playback.BAKED}")

    def _draw_cache(self, context: bpy.types.Context, state: str, message: str) -> None:
        box = self.layout.box()
        box.label(text=state.capitalize(), icon=_ICONS[state])
        hint(box, message)
        row = box.row(align=True)
        if state == playback.EDITED:
            row.operator("hairloom.free_cache", text="Keep Edit", icon="CHECKMARK").keep_shape = True
            row.operator("hairloom.play_again", text="Drop Edit", icon="PLAY")
        else:
            row.operator("hairloom.free_cache", icon="TRASH")
        if not context.scene.render.use_lock_interface:
            # the hair moves while a picture is rendered, which the viewport must not touch then
            hint(box, "For rendering in this window, lock the interface:")
            box.prop(context.scene.render, "use_lock_interface")


register, unregister = bpy.utils.register_classes_factory([HAIRLOOM_PT_bake])
