"""Run tests/blender with the add-on enabled as `bl_ext.user_default.hairloom`.

    python tests/blender/run.py [PYTEST ARGS]                   under the pip module bpy; stages the working tree first
    blender -b --python tests/blender/run.py -- [PYTEST ARGS]   inside Blender; tests the zip that is installed there

Inside Blender two variables are needed: BLENDER_USER_RESOURCES, the scratch folder where the zip was installed (so that
nobody's own settings are touched), and HAIRLOOM_TEST_PATH, a site-packages folder that has pytest (Blender has none).
`build_addon.py test` and `build_addon.py test --gui BLENDER` do all that.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import traceback
from pathlib import Path

INSIDE_BLENDER = "bpy" in sys.modules
HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
MODULE = "bl_ext.user_default.hairloom"
# pytest and what it imports, all of it plain Python that any version runs
PYTEST_PARTS = ("pytest", "_pytest", "pluggy", "iniconfig", "packaging", "pygments", "py.py")


def stage_for_module() -> None:
    """Lay the working tree out as an installed extension, in a folder that this Python's runs share."""
    sys.path.insert(0, str(ROOT))
    import build_addon

    resources = ROOT / ".cache" / f"blender-python{sys.version_info.major}.{sys.version_info.minor}"
    build_addon.stage(resources / "extensions" / "user_default" / "hairloom")
    os.environ["BLENDER_USER_RESOURCES"] = str(resources)


def borrow_pytest(scratch: Path) -> None:
    """Make pytest, and nothing else of that environment, importable: its other packages are for another Python."""
    source = os.environ.get("HAIRLOOM_TEST_PATH")
    if not source or not os.environ.get("BLENDER_USER_RESOURCES"):
        sys.exit("set BLENDER_USER_RESOURCES (scratch folder) and HAIRLOOM_TEST_PATH (site-packages with pytest) first")
    for part in PYTEST_PARTS:
        original = Path(source) / part
        if original.is_dir():
            shutil.copytree(original, scratch / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(original, scratch)
    sys.path.append(str(scratch))


def enable_addon() -> None:
    import bpy

    bpy.ops.preferences.addon_enable(module=MODULE)
    if MODULE not in bpy.context.preferences.addons:
        sys.exit(f"{MODULE} cannot be enabled; the reason is above")


def main() -> int:
    with tempfile.TemporaryDirectory() as scratch:
        if INSIDE_BLENDER:
            arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
            borrow_pytest(Path(scratch))
        else:
            arguments = sys.argv[1:]
            stage_for_module()
        enable_addon()
        import bpy
        import pytest

        print(f"Blender {bpy.app.version_string}, Python {sys.version.split()[0]}, {sys.modules[MODULE].__file__}")
        return int(pytest.main([str(HERE), "-p", "no:cacheprovider", *arguments]))


try:
    status = main()
except SystemExit as stop:
    print(stop, file=sys.stderr)
    status = 1
except BaseException:  # noqa: BLE001  whatever it is, it must end in an exit status: Blender would just go on
    traceback.print_exc()
    status = 1
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)  # the bpy module sometimes hangs when the interpreter ends in the normal way
