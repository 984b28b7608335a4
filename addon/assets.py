"""The content that ships with the add-on: starter grooms, shown in Blender's asset browser and in the panel's menu."""

from __future__ import annotations

import functools
import glob
import os

import bpy

from .backend.errors import require

LIBRARY = "Hairloom"
HEAD = "Hairloom Head"


def folder() -> str:
    """Where the .blend files lie; in the extension, so replaced with it."""
    return os.path.join(os.path.dirname(__file__), "blend_templates")


def _library() -> bpy.types.UserAssetLibrary | None:
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return next((library for library in libraries if same(library.path, folder())), None)


def same(path: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool:
    """Do two paths name the same folder?"""
    return os.path.normcase(os.path.normpath(path)) == os.path.normcase(os.path.normpath(other))


def register() -> None:
    if os.path.isdir(folder()) and _library() is None:
        bpy.context.preferences.filepaths.asset_libraries.new(name=LIBRARY, directory=folder())


def unregister() -> None:
    library = _library()
    if library is not None:
        bpy.context.preferences.filepaths.asset_libraries.remove(library)


@functools.cache
def starter_grooms() -> tuple[tuple[str, str], ...]:
    """(name, .blend file) of each starter groom: the Curves assets of the files that ship, saved details aside."""
    found = []
    for path in sorted(glob.glob(os.path.join(glob.escape(folder()), "*.blend"))):
        with bpy.data.libraries.load(path, assets_only=True) as (source, _):
            found += [(name, path) for name in source.objects if name != HEAD]
    return tuple(found)


def append_groom(context: bpy.types.Context, name: str) -> bpy.types.Object:
    """Append a starter groom into the scene; it arrives with the head that it was made on.

    Raises
    ------
    InputError : there is no such groom.
    """
    path = dict(starter_grooms()).get(name)
    require(
        path is not None, f"there is no starter groom '{name}'; there are {', '.join(n for n, _ in starter_grooms())}"
    )
    before = set(bpy.data.objects)
    with bpy.data.libraries.load(path, link=False) as (_, wanted):
        wanted.objects = [name]
    for obj in bpy.data.objects:
        if obj not in before:
            context.collection.objects.link(obj)
    groom = wanted.objects[0]
    groom.asset_clear()
    return groom
