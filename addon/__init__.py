"""Hairloom in Blender: hairstyles from examples, as native Curves.

Nothing heavy is imported here; `lazy` is the door to the backend and to the modules that use numpy.
"""

from __future__ import annotations

from . import (
    assets,
    comb_cache,
    detail_library,
    detail_settings,
    fourview,
    fourview_overlay,
    fourview_settings,
    fourview_tools,
    gizmos,
    jobs,
    live_details,
    live_flow,
    ops,
    playback,
    prefs,
    props,
    simulation_settings,
    tools,
    ui,
    warmup,
)

_PARTS = (
    jobs, props, detail_settings, simulation_settings, fourview_settings, live_details, live_flow, playback, fourview,
    ops, tools, fourview_tools, gizmos, ui, fourview_overlay, comb_cache, prefs, assets, detail_library, warmup,
)  # fmt: skip


def register() -> None:
    for part in _PARTS:
        part.register()


def unregister() -> None:
    for part in reversed(_PARTS):
        part.unregister()
