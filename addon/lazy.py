"""The one door to backend, bridge and workers: their modules are imported on first use, so that enabling stays quick.

numpy, scipy and numba take longer to import than Blender should wait for an add-on at start; nothing of them is
imported before an operator runs.
"""

from __future__ import annotations

import importlib
import os
from types import ModuleType

import bpy


def cache_folder() -> str:
    """The extension's own cache folder; '' where the user folder cannot be written."""
    try:
        return bpy.utils.extension_path_user(__package__, path="cache", create=True)
    except OSError:
        return ""


def kernel_cache_folder() -> str:
    """Where numba keeps compiled kernels; '' leaves the choice to numba."""
    folder = cache_folder()
    return os.path.join(folder, "kernels") if folder else ""


def _load(name: str) -> ModuleType:
    if "NUMBA_CACHE_DIR" not in os.environ and (folder := kernel_cache_folder()):
        # numba reads this once, when it is imported; another add-on's choice stands
        os.environ["NUMBA_CACHE_DIR"] = folder
    return importlib.import_module(name, __package__)


def backend(name: str) -> ModuleType:
    """A module of the backend by its dotted name, such as 'io.strands'."""
    return _load(f".backend.{name}")


def bridge(name: str) -> ModuleType:
    """A module of `addon/bridge`, such as 'curves'."""
    return _load(f".bridge.{name}")


def workers() -> ModuleType:
    """The module of worker processes."""
    return _load(".workers")
