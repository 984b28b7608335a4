"""Drive a real Blender window: install the zip, then do what users do, with simulated events.

    python tests/gui/run.py BLENDER [SESSION ...]      sessions by name, such as comb_session; without any, SESSIONS

Builds the zip for that Blender (or takes the one in HAIRLOOM_ZIP), installs it in a scratch user folder and runs the
sessions, each in a window of its own. Screenshots are kept in tests/gui/out/; those in docs/pictures that `PICTURES`
names are copied there with --pictures. Without a screen of its own, the Blender must bring one, as
shared/tools/blender-gui does.
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


COMPILING = "session"  # compiles the kernels, as a new user's Blender does
BY_NAME = ("fourview_session",)  # runs when it is named: with its 4 minutes .ci/run would be too near its 40
SESSIONS = (COMPILING, *sorted({path.stem for path in HERE.glob("*_session.py")} - {*BY_NAME}))
# what docs/pictures keeps of the screenshots
PICTURES = {
    "synthesized": "panel",
    "comb_before": "comb_before",
    "comb_after": "comb_after",
    "sintel_before": "comb_sintel_before",
    "sintel_after": "comb_sintel_after",
    "simulation_helices": "simulation_helices",
    "simulation_scrubbed": "simulation",
    "fourview_border": "wizard_border",
    "fourview_planes": "wizard_cameras",
    "fourview_shape": "wizard_shape",
    "fourview_texture": "wizard_texture",
    "fourview_directions": "wizard_directions",
    "fourview_strands": "wizard_strands",
}


def build_zip(blender: str) -> Path:
    sys.path.insert(0, str(ROOT))
    import build_addon

    return build_addon.build_for(blender)


def install_anew(blender: str, package: Path, env: dict[str, str]) -> None:
    """Install the zip in an empty user folder, where no kernel is compiled yet."""
    folder = Path(env["BLENDER_USER_RESOURCES"])
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    install = [blender, "--command", "extension", "install-file", "-r", "user_default", "-e", str(package)]
    subprocess.run(install, env=env, check=True, timeout=LIMIT_SECONDS)


def run_sessions(blender: str, package: Path, sessions: list[str]) -> dict[str, int]:
    """Exit status of each session."""
    with tempfile.TemporaryDirectory() as scratch:
        env = {**os.environ, "BLENDER_USER_RESOURCES": str(Path(scratch) / "user"), "BLENDER_LIMIT": str(LIMIT_SECONDS)}
        env["HAIRLOOM_GUI_OUT"] = str(OUT)
        install_anew(blender, package, env)
        window = ["--no-window-focus", "--window-geometry", "0", "0", "1600", "900", "--enable-event-simulate"]
        found = {}
        for session in sessions:
            command = [blender, *window, "--python-exit-code", "1", "--python", str(HERE / f"{session}.py")]
            found[session] = subprocess.run(command, env=env, timeout=2 * LIMIT_SECONDS).returncode
            if found[session]:
                # simulated clicks on software OpenGL can miss on a busy machine: one more try, and what failed is said
                print(f"tests/gui: {session} failed with {found[session]}; once more", flush=True)
                if session == COMPILING:
                    install_anew(blender, package, env)
                found[session] = subprocess.run(command, env=env, timeout=2 * LIMIT_SECONDS).returncode
    return found


def keep_pictures() -> None:
    for name, kept in PICTURES.items():
        if (OUT / f"{name}.png").is_file():
            shutil.copy(OUT / f"{name}.png", ROOT / "docs" / "pictures" / f"{kept}.png")


def main(arguments: list[str]) -> int:
    sessions = [name for name in arguments[1:] if name != "--pictures"] or list(SESSIONS)
    if not arguments or not set(sessions) <= {*SESSIONS, *BY_NAME}:
        print(__doc__, file=sys.stderr)
        return 2
    blender = arguments[0]
    package = Path(os.environ["HAIRLOOM_ZIP"]) if os.environ.get("HAIRLOOM_ZIP") else build_zip(blender)
    if not package.is_file():
        print(f"there is no {package}; HAIRLOOM_ZIP must name a zip, or be empty", file=sys.stderr)
        return 2
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir()
    found = run_sessions(blender, package, sessions)
    if "--pictures" in arguments:
        keep_pictures()
    words = ", ".join(f"{session} {'passed' if status == 0 else 'FAILED'}" for session, status in found.items())
    print(f"tests/gui: {words}; screenshots in {OUT}")
    return max(found.values())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
