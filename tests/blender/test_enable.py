"""Enabling the add-on: quick, and nothing left behind when it is disabled."""

from __future__ import annotations

import os
import subprocess
import sys

import bpy
import pytest
import scenes

HEAVY = ("numba", "scipy", "igl", "embreex", "xatlas", "llvmlite")
SCRIPT = f"""
import sys
import bpy
bpy.ops.preferences.addon_enable(module="{scenes.MODULE}")
assert "{scenes.MODULE}" in bpy.context.preferences.addons
print("LOADED " + " ".join(sorted(sys.modules)))
sys.stdout.flush()
import os
os._exit(0)
"""


def test_enabling_imports_nothing_heavy(tmp_path):
    if not bpy.app.module:
        pytest.skip("needs a Python that imports bpy, to start from nothing")
    script = tmp_path / "enable.py"
    script.write_text(SCRIPT)
    done = subprocess.run([sys.executable, script], env=os.environ, text=True, capture_output=True, timeout=120)
    loaded = next(line for line in done.stdout.splitlines() if line.startswith("LOADED ")).split()
    assert scenes.MODULE in loaded
    assert [name for name in loaded if name.split(".")[0] in HEAVY] == []
    ours = [name.removeprefix(scenes.MODULE) for name in loaded if name.startswith(scenes.MODULE)]
    assert [name for name in ours if name.startswith((".backend.", ".bridge."))] == [".backend.errors"]


def test_disabling_takes_everything_away_and_enabling_brings_it_back():
    libraries = bpy.context.preferences.filepaths.asset_libraries
    had = [library.name for library in libraries]
    bpy.ops.preferences.addon_disable(module=scenes.MODULE)
    try:
        assert not hasattr(bpy.types.Scene, "hairloom")
        assert not hasattr(bpy.types, "HAIRLOOM_OT_synthesize")
        assert not hasattr(bpy.types, "HAIRLOOM_PT_synthesis")
        assert "Hairloom" not in [library.name for library in libraries]
    finally:
        bpy.ops.preferences.addon_enable(module=scenes.MODULE)
    assert bpy.context.scene.hairloom.synthesis.n_samples == 64
    assert [library.name for library in libraries] == had


def test_a_user_folder_that_cannot_be_written_is_no_error(monkeypatch):
    lazy = scenes.module("lazy")

    def refuse(*_, **__):
        raise OSError("read-only")

    monkeypatch.setattr(lazy.bpy.utils, "extension_path_user", refuse)
    assert lazy.cache_folder() == ""
    assert lazy.kernel_cache_folder() == ""
    assert not scenes.module("warmup").is_warm()
