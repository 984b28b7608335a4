"""The sidebar: panels, presets and menus draw and nothing else."""

from __future__ import annotations

from . import (
    bake_panel,
    comb_panel,
    flow_panel,
    fourview_panel,
    menus,
    panels,
    physics_presets,
    presets,
    simulation_panel,
    transfer_panel,
)

_PARTS = (
    presets, physics_presets, panels, flow_panel, comb_panel, transfer_panel, simulation_panel, bake_panel,
    fourview_panel, menus,
)  # fmt: skip


def register() -> None:
    for part in _PARTS:
        part.register()


def unregister() -> None:
    for part in reversed(_PARTS):
        part.unregister()
