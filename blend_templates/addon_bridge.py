"""The add-on's bridge for scripts: without the add-on installed, and with the package `hairloom` as its backend."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import bpy  # noqa: F401  the bridge needs it; pip's bpy must come before the modules that it brings

_PACKAGE = "hairloom_addon"
_ADDON = Path(__file__).parent.parent / "addon"
# what the bridge imports of the backend: the same modules, or there would be two classes StrandSet
_BACKEND = (
    "", ".errors", ".types", ".geometry", ".geometry.head", ".geometry.scalp_space", ".geometry.strands", ".synthesis",
    ".synthesis.details",
)  # fmt: skip


def _import(name: str) -> ModuleType:
    if _PACKAGE not in sys.modules:
        # the add-on's __init__ registers panels and operators: stands in for it, and knows where its modules are
        package = ModuleType(_PACKAGE)
        package.__path__ = [str(_ADDON)]
        sys.modules[_PACKAGE] = package
        for part in _BACKEND:
            sys.modules[f"{_PACKAGE}.backend{part}"] = import_module(f"hairloom{part}")
    return import_module(f"{_PACKAGE}.{name}")


attachment = _import("bridge.attachment")
curves = _import("bridge.curves")
detail_assets = _import("bridge.detail_assets")
material = _import("material")
mesh = _import("bridge.mesh")
