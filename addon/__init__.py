"""Hairloom in Blender: hairstyles from examples, as native Curves.

Nothing heavy is imported here; `lazy` is the door to the backend and to the modules that use numpy.
"""

from __future__ import annotations

from . import assets, detail_library, jobs, ops, prefs, props, ui, warmup

_PARTS = (jobs, props, ops, ui, prefs, assets, detail_library, warmup)


def register() -> None:
    for part in _PARTS:
        part.register()


def unregister() -> None:
    for part in reversed(_PARTS):
        part.unregister()
