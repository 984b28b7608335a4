"""Every test of this folder starts in an empty scene of factory settings, with the add-on enabled."""

from __future__ import annotations

import importlib
from types import ModuleType

import bpy
import pytest

MODULE = "bl_ext.user_default.hairloom"


@pytest.fixture(autouse=True)
def empty_scene() -> None:
    """An empty file; read_homefile keeps the preferences, and with them the add-on."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert MODULE in bpy.context.preferences.addons


@pytest.fixture(scope="session")
def addon() -> ModuleType:
    """The enabled add-on's top module."""
    return importlib.import_module(MODULE)


@pytest.fixture(scope="session")
def backend() -> ModuleType:
    """The backend as it is packed in the add-on; import its modules with `importlib.import_module`."""
    return importlib.import_module(f"{MODULE}.backend")
