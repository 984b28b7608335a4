"""The gizmos of the 3D view."""

from __future__ import annotations

from . import view_plane

register, unregister = view_plane.register, view_plane.unregister
