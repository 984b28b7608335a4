"""What the comb keeps from stroke to stroke: the session on the groom and the collider of the head.

It lives here, not with those who make it, so that it can be dropped without importing what they need.
"""

from __future__ import annotations

from typing import Any

import bpy

kept: dict[str, Any] = {}


@bpy.app.handlers.persistent
def _drop(*_: object) -> None:
    kept.clear()


def register() -> None:
    bpy.app.handlers.load_pre.append(_drop)


def unregister() -> None:
    bpy.app.handlers.load_pre.remove(_drop)
    kept.clear()
