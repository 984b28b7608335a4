"""Drive a real Blender window: install the zip, open the panel, synthesize, undo, cancel.

    python tests/gui/run.py BLENDER

Builds the zip for that Blender (or takes the one in HAIRLOOM_ZIP), installs it in a scratch user folder and runs
`session.py` in a window with simulated events. Screenshots are kept in tests/gui/out/; docs/pictures/panel.png is a
copy of synthesized.png. Without a screen of its own, the Blender must bring one, as shared/tools/blender-gui does.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
OUT = HERE / "out"
LIMIT_SECONDS = 1800  # compiling the kernels on a busy machine and drawing in software included


def build_zip(blender: str) -> Path:
    sys.path.insert(0, str(ROOT))
    import build_addon

    return build_addon.build_for(blender)


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    blender = arguments[0]
    package = Path(os.environ["HAIRLOOM_ZIP"]) if os.environ.get("HAIRLOOM_ZIP") else build_zip(blender)
    if not package.is_file():
        print(f"there is no {package}; HAIRLOOM_ZIP must name a zip, or be empty", file=sys.stderr)
        return 2
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir()
    with tempfile.TemporaryDirectory() as scratch:
        env = {**os.environ, "BLENDER_USER_RESOURCES": scratch, "BLENDER_LIMIT": str(LIMIT_SECONDS)}
        env["HAIRLOOM_GUI_OUT"] = str(OUT)
        install = [blender, "--command", "extension", "install-file", "-r", "user_default", "-e", str(package)]
        subprocess.run(install, env=env, check=True, timeout=LIMIT_SECONDS)
        window = ["--no-window-focus", "--window-geometry", "0", "0", "1600", "900", "--enable-event-simulate"]
        session = [blender, *window, "--python-exit-code", "1", "--python", str(HERE / "session.py")]
        status = subprocess.run(session, env=env, timeout=2 * LIMIT_SECONDS).returncode
    print(f"tests/gui: {'passed' if status == 0 else 'FAILED'}; screenshots in {OUT}")
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
