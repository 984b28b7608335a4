"""Entries in Blender's File > Import and File > Export menus."""

from __future__ import annotations

import bpy

_TEXT = "Hair Groom (.hair/.tfx/.data/.npz)"


def _draw_import(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator("hairloom.import_groom", text=_TEXT)


def _draw_export(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator("hairloom.export_groom", text=_TEXT)


def register() -> None:
    bpy.types.TOPBAR_MT_file_import.append(_draw_import)
    bpy.types.TOPBAR_MT_file_export.append(_draw_export)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_export.remove(_draw_export)
    bpy.types.TOPBAR_MT_file_import.remove(_draw_import)
