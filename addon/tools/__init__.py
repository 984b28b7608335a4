"""The tools of the toolbar."""

from __future__ import annotations

from . import comb_tool


def register() -> None:
    comb_tool.register()


def unregister() -> None:
    comb_tool.unregister()
