#!/usr/bin/env python3
"""Build, try and test Hairloom. Needs Python 3.11 or 3.13 and nothing but its standard library.

    python3 build_addon.py                    six zips in dist/: three systems x Blender 4.5-5.0 and 5.1-5.2
    python3 build_addon.py --for BLENDER      one zip for exactly that Blender (the path of its program)
    python3 build_addon.py demo               synthesize a hairstyle from a starter groom, with a picture, in demo/
    python3 build_addon.py test [ARGS]        lint, types and every test; other arguments go to pytest
    python3 build_addon.py lock               choose the wheels anew from pyproject.toml's ranges: wheels.lock.json

Everything runs in .venv-<Python version>, which is made on the first call. Downloads are kept in .cache/.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

try:
    import tomllib
except ImportError:
    sys.exit("build_addon.py: needs Python 3.11 or 3.13, this is " + sys.version.split()[0])

ROOT = Path(__file__).resolve().parent
CACHE = ROOT / ".cache"
DIST = ROOT / "dist"
LOCK = ROOT / "wheels.lock.json"
MANIFEST = "blender_manifest.toml"
MAX_ZIP_BYTES = 240_000_000  # on Linux llvmlite 60, OpenCV 56, scipy 35, embreex 15, libigl 14, content 44
PROBE_MARK = "HAIRLOOM-PROBE "
# Blender has its own numpy, which another must not hide; the others serve the command line alone
NOT_SHIPPED = ("numpy", "psutil", "tqdm")
TEST_PARTS = ("lint", "unit", "blender", "gui")


@dataclass(frozen=True)
class Series:
    """Blender versions that share one Python."""

    name: str
    python: str
    first: str
    below: str  # blender_version_max: the first version that is not supported
    numpy: str  # the oldest numpy that these versions bring: wheels must work with it, and numpy is never shipped
    bpy: str  # the release of the pip module that stands for the series in tests


SERIES = (
    Series("4.5-5.0", "3.11", "4.5.0", "5.1.0", "1.26.4", "4.5.*"),
    Series("5.1-5.2", "3.13", "5.1.0", "5.3.0", "2.3.5", "5.2.*"),
)
# Blender's name of a system: pip's. Linux: glibc 2.28, which Blender 4.5 itself asks for. macOS: embreex asks for 13.
PLATFORMS = {
    "windows-x64": ["win_amd64"],
    "macos-arm64": ["macosx_13_0_arm64"],
    "linux-x64": [f"manylinux_2_{minor}_x86_64" for minor in range(28, 16, -1)] + ["manylinux2014_x86_64"],
}


class BuildError(Exception):
    """Something the caller can put right: shown as one line (after the output of the program that failed)."""


@contextmanager
def step(text: str) -> Iterator[None]:
    """Say what is being done, then how long it took."""
    print(f"- {text} ...", end=" ", flush=True)
    start = time.perf_counter()
    try:
        yield
    except BaseException:
        print("failed", flush=True)
        raise
    print(f"{time.perf_counter() - start:.1f} s", flush=True)


def run_quietly(command: Sequence[str | Path], what: str, env: Mapping[str, str] | None = None) -> str:
    """Run a program in the project's folder; its output is returned, and shown only when it fails."""
    result = subprocess.run([str(part) for part in command], cwd=ROOT, env=env, text=True, encoding="utf-8",
                            errors="replace", stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip
    if result.returncode:
        raise BuildError(f"{result.stdout.rstrip()}\n{what} failed (exit status {result.returncode}); see above")
    return result.stdout


def run_openly(command: Sequence[str | Path], env: Mapping[str, str] | None = None) -> int:
    """Run a program in the project's folder with its output on the terminal; returns its exit status."""
    return subprocess.run([str(part) for part in command], cwd=ROOT, env=env).returncode


def sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def normal_name(distribution: str) -> str:
    return re.sub(r"[-_.]+", "-", distribution).lower()


def requirements() -> list[str]:
    """What the backend needs inside Blender, as pyproject.toml says it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [line for line in project["dependencies"] if re.match(r"[\w.-]+", line)[0] not in NOT_SHIPPED]


def manifest_text() -> str:
    return (ROOT / "addon" / MANIFEST).read_text(encoding="utf-8")


def version() -> str:
    """The version of everything: the extension's manifest is its single source."""
    return str(tomllib.loads(manifest_text())["version"])


def this_series() -> Series:
    running = f"{sys.version_info.major}.{sys.version_info.minor}"
    for series in SERIES:
        if series.python == running:
            return series
    names = [f"python{series.python}" for series in SERIES]
    # started, because pyenv puts programs on the PATH that only say that they are switched off
    found = [
        name
        for name in names
        if shutil.which(name) and not subprocess.run([name, "-V"], capture_output=True).returncode
    ]
    remedy = f"run it with {' or '.join(found)}" if found else "install one of the two"
    raise BuildError(f"Blender's modules exist for Python 3.11 and 3.13 only, this is Python {running}: {remedy}")


def environment() -> Path:
    """The Python of the virtual environment with bpy, Hairloom (editable) and all tools; made or renewed if need be."""
    series = this_series()
    folder = ROOT / f".venv-{series.python}"
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    stamp_file = folder / "hairloom-stamp"
    inputs = [(ROOT / name).read_text(encoding="utf-8") for name in ("pyproject.toml", "setup.py", LOCK.name)]
    stamp = hashlib.sha256("\n".join([*inputs, version(), series.bpy]).encode()).hexdigest()
    if python.exists() and stamp_file.exists() and stamp_file.read_text(encoding="utf-8") == stamp:
        return python
    with step(f"making {folder.name}"):
        run_quietly(
            [sys.executable, "-m", "venv", "--clear", folder], "making the virtual environment (python -m venv)"
        )
        run_quietly([python, "-m", "pip", "install", "--upgrade", "pip"], "pip")
    CACHE.mkdir(exist_ok=True)
    constraints = CACHE / f"constraints-{series.python}.txt"
    constraints.write_text("\n".join(locked_versions(series.python)) + "\n", encoding="utf-8")
    with step(f"installing bpy {series.bpy}, Hairloom and the tools in {folder.name} (about 600 MB the first time)"):
        wanted = ["-c", constraints, "-e", f"{ROOT}[test,lint,bench,docs]", f"bpy=={series.bpy}"]
        run_quietly([python, "-m", "pip", "install", *wanted], "pip")
    stamp_file.write_text(stamp, encoding="utf-8")
    return python


def bundled_extension_tool(python: Path) -> Path:
    """Blender's own extension builder and checker, a plain script inside the bpy package."""
    site = site_packages(python)
    found = sorted(site.glob("bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    if not found:
        raise BuildError(f"no blender_ext.py in {site}/bpy: delete {python.parent.parent} and start again")
    return found[-1]


def site_packages(python: Path) -> Path:
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    return Path(run_quietly([python, "-c", code], "asking for the site-packages folder").strip())


def read_lock() -> dict[str, dict[str, list[dict[str, str]]]]:
    """{platform: {Python version: [{name, version, file, sha256}]}}"""
    return json.loads(LOCK.read_text(encoding="utf-8"))


def locked_versions(python_version: str) -> list[str]:
    """`name==version` lines of the wheels that ship, so that tests run on the same versions."""
    wheels = read_lock().get("linux-x64", {}).get(python_version, [])
    return [f"{wheel['name']}=={wheel['version']}" for wheel in wheels]


def target_options(platform: str, python_version: str) -> list[str]:
    tags = [option for tag in PLATFORMS[platform] for option in ("--platform", tag)]
    return ["--only-binary", ":all:", "--implementation", "cp", "--python-version", python_version, *tags]


def resolve(python: Path, platform: str, series: Series) -> list[dict[str, str]]:
    """Let pip choose the newest wheels within pyproject's ranges that work with the series' oldest numpy."""
    with tempfile.TemporaryDirectory() as scratch:
        report_file = Path(scratch) / "report.json"
        wanted = ["--dry-run", "--ignore-installed", "--target", scratch, "--report", report_file]
        command = [python, "-m", "pip", "install", *wanted, *target_options(platform, series.python)]
        run_quietly([*command, f"numpy=={series.numpy}", *requirements()], "pip")
        report = json.loads(report_file.read_text(encoding="utf-8"))
    wheels = []
    for item in report["install"]:
        name, download = normal_name(item["metadata"]["name"]), item["download_info"]
        if name not in NOT_SHIPPED:
            file = unquote(urlsplit(download["url"]).path.rsplit("/", 1)[-1])
            digest = download["archive_info"]["hashes"]["sha256"]
            wheels.append({"name": name, "version": item["metadata"]["version"], "file": file, "sha256": digest})
    return sorted(wheels, key=lambda wheel: wheel["name"])


def make_lock(python: Path) -> None:
    lock: dict[str, dict[str, list[dict[str, str]]]] = {}
    for platform in PLATFORMS:
        for series in SERIES:
            with step(f"choosing wheels for {platform}, Python {series.python}"):
                lock.setdefault(platform, {})[series.python] = resolve(python, platform, series)
    LOCK.write_text(json.dumps(lock, indent=1) + "\n", encoding="utf-8")
    print(f"wrote {LOCK.name}; look at its diff before committing it")


def fetch_wheels(python: Path, platform: str, python_version: str) -> list[Path]:
    """The locked wheels of a target, downloaded if need be, each verified against the lock's SHA-256."""
    folder = CACHE / "wheels"
    folder.mkdir(parents=True, exist_ok=True)
    locked = read_lock()[platform][python_version]
    paths = [folder / wheel["file"] for wheel in locked]
    missing = [wheel for wheel, path in zip(locked, paths) if not (path.exists() and sha256(path) == wheel["sha256"])]
    if missing:
        with step(f"downloading {len(missing)} wheels for {platform}, Python {python_version}"):
            listing = folder / f"requirements-{platform}-{python_version}.txt"
            lines = [f"{wheel['name']}=={wheel['version']} --hash=sha256:{wheel['sha256']}\n" for wheel in missing]
            listing.write_text("".join(lines), encoding="utf-8")
            command = [python, "-m", "pip", "download", "--no-deps", "--require-hashes", "--dest", folder]
            run_quietly([*command, *target_options(platform, python_version), "-r", listing], "pip")
    for wheel, path in zip(locked, paths):
        if not path.exists() or sha256(path) != wheel["sha256"]:
            raise BuildError(f"{path} is not the file that {LOCK.name} names: delete it and start again")
    return paths


def staged_manifest(changes: Mapping[str, str | list[str]]) -> str:
    """The add-on's manifest with some top-level keys set; its comments and tables stay as they are."""
    head, bracket, tables = manifest_text().partition("\n[")
    kept = [line for line in head.splitlines() if line.split("=")[0].strip() not in changes]
    # a JSON string or list of strings is valid TOML too
    added = [f"{key} = {json.dumps(value)}" for key, value in changes.items() if value]
    return "\n".join([*kept, *added]) + "\n" + bracket + tables


def package_files(wheels: Sequence[Path] = ()) -> dict[str, Path]:
    """What belongs into the zip beside the manifest: path in the zip -> file, sorted."""
    files = {"LICENSE": ROOT / "LICENSE"}
    for folder, prefix in ((ROOT / "addon", ""), (ROOT / "backend", "backend/")):
        for path in folder.rglob("*"):
            inside = path.relative_to(folder)
            hidden = any(part.startswith((".", "__pycache__")) for part in inside.parts)
            if path.is_file() and not hidden and path.suffix != ".pyc":
                files[prefix + inside.as_posix()] = path
    templates = ROOT / "blend_templates"
    details = [path for path in (templates / "details").glob("*") if path.suffix in {".npz", ".png"}]
    for path in [*templates.rglob("*.blend"), *templates.rglob("blender_assets.cats.txt"), *details]:
        files["blend_templates/" + path.relative_to(templates).as_posix()] = path
    files |= {f"wheels/{wheel.name}": wheel for wheel in wheels}
    del files[MANIFEST]
    return dict(sorted(files.items()))


def stage(folder: Path) -> None:
    """Lay the add-on out as a folder, without wheels, for a Blender whose Python has the packages.

    Files that did not change keep their times, so that compiled kernels are found again. When a kernel changes all get
    new times: numba does not see that a function which it compiled into a kernel of another file is another one now.
    """
    files = package_files()
    for path in [path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts]:
        if path.relative_to(folder).as_posix() not in files:
            path.unlink()
    olds = {name: (folder / name).stat() if (folder / name).exists() else None for name in files}
    changed = [name for name, old in olds.items() if old is None or old.st_size != files[name].stat().st_size
               or old.st_mtime_ns < files[name].stat().st_mtime_ns]  # fmt: skip
    for name in changed:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(files[name], folder / name)
    for kernel in folder.rglob("*_kernels.py") if any(name.endswith("_kernels.py") for name in changed) else ():
        os.utime(kernel)  # newer than its source from now on
    (folder / MANIFEST).write_text(staged_manifest({}), encoding="utf-8")


def write_zip(path: Path, files: Mapping[str, Path], manifest: str) -> None:
    """Write a zip whose bytes depend on the content only: fixed times and rights, sorted names."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    with zipfile.ZipFile(partial, "w") as archive:
        for name in sorted([MANIFEST, *files]):
            entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            entry.external_attr = 0o100644 << 16
            entry.create_system = 3
            entry.compress_type = zipfile.ZIP_STORED if name.endswith(".whl") else zipfile.ZIP_DEFLATED
            archive.writestr(entry, manifest.encode() if name == MANIFEST else files[name].read_bytes())
    partial.replace(path)


def finish_zip(
    path: Path, wheels: Sequence[Path], changes: Mapping[str, str | list[str]], validate: Sequence[str | Path]
) -> None:
    """Write the zip, print its size, and keep it only if it is small enough and Blender's validator accepts it."""
    listed = [f"./wheels/{wheel.name}" for wheel in wheels]
    write_zip(path, package_files(wheels), staged_manifest({**changes, "wheels": listed}))
    size = path.stat().st_size
    try:
        if size > MAX_ZIP_BYTES:
            raise BuildError(f"{path.name} has {size / 1e6:.1f} MB; {MAX_ZIP_BYTES / 1e6:.0f} MB are allowed")
        run_quietly([*validate, path], f"validation of {path.name}")
    except BuildError:
        path.unlink()
        raise
    print(f"  {path.relative_to(ROOT)}  {size / 1e6:.1f} MB, valid")


def build_all(platforms: Sequence[str]) -> None:
    """The zips of the given systems, for each series of Blender versions, checked with Blender's own validator."""
    python = environment()
    for platform in platforms:
        for series in SERIES:
            wheels = fetch_wheels(python, platform, series.python)
            path = DIST / f"hairloom-{version()}-{platform}-blender-{series.name}.zip"
            limits = {"blender_version_min": series.first, "blender_version_max": series.below}
            validate = [python, bundled_extension_tool(python), "validate"]
            finish_zip(path, wheels, {**limits, "platforms": [platform]}, validate)


@dataclass(frozen=True)
class Probe:
    """What a Blender says about itself."""

    blender: tuple[int, int, int]
    python: str
    system: str  # sys.platform
    machine: str
    numpy: str

    @property
    def platform(self) -> str:
        system = {"win32": "windows", "darwin": "macos"}.get(self.system, self.system)
        machine = self.machine.lower()
        return f"{system}-{ {'x86_64': 'x64', 'amd64': 'x64', 'aarch64': 'arm64'}.get(machine, machine) }"


def ask_blender(blender: str, expression: str, what: str) -> dict[str, object]:
    """Run an expression inside Blender; `answer` is what it must call with a JSON-able value, once."""
    code = f"import json; answer = lambda value: print({PROBE_MARK!r} + json.dumps(value), flush=True)\n{expression}"
    command = [blender, "--background", "--factory-startup", "--python-exit-code", "1", "--python-expr", code]
    output = run_quietly(command, what)
    for line in output.splitlines():
        if line.startswith(PROBE_MARK):
            return json.loads(line.removeprefix(PROBE_MARK))
    raise BuildError(f"{output.rstrip()}\n{what}: no answer; is {blender} a Blender program?")


def probe_blender(blender: str) -> Probe:
    expression = (
        "import platform, sys, bpy, numpy\n"
        "answer(dict(blender=list(bpy.app.version), python='%d.%d' % sys.version_info[:2], system=sys.platform,"
        " machine=platform.machine(), numpy=numpy.__version__))"
    )
    said = ask_blender(blender, expression, f"asking {blender} for its Python")
    return Probe(**{**said, "blender": tuple(said["blender"])})  # type: ignore[arg-type]


def wheels_from_blender(python: Path, blender: str, probe: Probe) -> list[Path]:
    """Collect wheels with the Blender's own Python: downloaded where they exist, built from source where not.

    Blender starts its Python itself, so this works through any wrapper script; pip comes from our environment (it is
    plain Python), because not every Blender brings one, and nothing is installed into the Blender.
    """
    folder = CACHE / f"wheels-{probe.platform}-{probe.python}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    constraints = folder / "constraints.txt"
    # the versions that ship elsewhere, and the numpy that is there
    constraints.write_text("\n".join([*locked_versions(SERIES[-1].python), f"numpy=={probe.numpy}"]), encoding="utf-8")
    pip = site_packages(python) / "pip"
    options = ["wheel", "--prefer-binary", "--wheel-dir", str(folder), "-c", str(constraints), *requirements()]
    expression = (
        "import subprocess, sys\n"
        f"done = subprocess.run([sys.executable, {str(pip)!r}, *{options!r}], text=True, stdout=-1, stderr=-2)\n"
        "print(done.stdout)\n"
        "answer(dict(status=done.returncode)) if not done.returncode else sys.exit(1)"
    )
    ask_blender(blender, expression, "pip in Blender's Python")
    return sorted(path for path in folder.glob("*.whl") if not path.name.startswith("numpy-"))


def build_for(blender: str) -> Path:
    """The zip for exactly that Blender: locked wheels if its Python and system are among the six, else its own."""
    if not shutil.which(blender):
        raise BuildError(f"{blender} is not a program: give the path of Blender's executable")
    python = environment()
    with step(f"asking {blender}"):
        probe = probe_blender(blender)
    major, minor, _patch = probe.blender
    if (major, minor) < (4, 5):
        raise BuildError(f"Blender {major}.{minor} is too old: Hairloom needs 4.5 or newer")
    print(f"  Blender {major}.{minor}, Python {probe.python}, numpy {probe.numpy}, {probe.platform}")
    if probe.python in read_lock().get(probe.platform, {}):
        wheels = fetch_wheels(python, probe.platform, probe.python)
    else:
        with step(f"collecting wheels for Python {probe.python}, building those that do not exist"):
            wheels = wheels_from_blender(python, blender, probe)
    tag = "py" + probe.python.replace(".", "")
    path = DIST / f"hairloom-{version()}-{probe.platform}-blender-{major}.{minor}-{tag}.zip"
    limits = {"blender_version_min": f"{major}.{minor}.0", "blender_version_max": f"{major}.{minor + 1}.0"}
    finish_zip(path, wheels, {**limits, "platforms": [probe.platform]}, [blender, "--command", "extension", "validate"])
    return path


def demo() -> int:
    """From a starter groom to a new hairstyle with strands, .blend and picture; docs/demo.py says where they are."""
    return run_openly([environment(), ROOT / "docs" / "demo.py"])


def lint_commands(python: Path) -> list[list[str | Path]]:
    ruff = [python, "-m", "ruff"]
    return [[*ruff, "check", "."], [*ruff, "format", "--check", "."], [python, "-m", "mypy"]]


def test_in_blender(python: Path, blender: str, pytest_arguments: Sequence[str]) -> dict[str, int]:
    """Build and install the zip for that Blender in a scratch folder, then run both suites on what was installed."""
    package = build_for(blender)
    runner = ROOT / "tests" / "blender" / "run.py"
    with tempfile.TemporaryDirectory() as scratch:
        env = {**os.environ, "BLENDER_USER_RESOURCES": scratch, "HAIRLOOM_TEST_PATH": str(site_packages(python))}
        env["HAIRLOOM_ZIP"] = str(package)
        install = [blender, "--command", "extension", "install-file", "-r", "user_default", "-e", package]
        with step(f"installing {package.name} in a scratch folder"):
            run_quietly(install, "installing the zip", env)
        inside = [blender, "--background", "--python-exit-code", "1", "--python", runner, "--", *pytest_arguments]
        results = {f"tests/blender in {blender}": run_openly(inside, env)}
    env.pop("BLENDER_USER_RESOURCES")
    results["tests/gui"] = run_openly([python, ROOT / "tests" / "gui" / "run.py", blender], env)
    return results


def run_tests(parts: Sequence[str], blender: str | None, pytest_arguments: Sequence[str]) -> int:
    python = environment()
    results: dict[str, int] = {}
    if "lint" in parts:
        for command in lint_commands(python):
            results[" ".join(map(str, command[2:]))] = run_openly(command)
    if "unit" in parts:
        results["tests"] = run_openly([python, "-m", "pytest", *pytest_arguments])
    if "blender" in parts:
        runner = ROOT / "tests" / "blender" / "run.py"
        results[f"tests/blender, bpy {this_series().bpy}"] = run_openly([python, runner, *pytest_arguments])
    if blender and "gui" in parts:
        results |= test_in_blender(python, blender, pytest_arguments)
    no_tests_collected = 5  # not a failure when the caller narrows the tests down, with -k for instance
    passed = {name: not code or (code == no_tests_collected and pytest_arguments) for name, code in results.items()}
    print("\n" + "; ".join(f"{name}: {'passed' if good else 'FAILED'}" for name, good in passed.items()))
    return 0 if all(passed.values()) else 1


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--for", dest="blender", metavar="BLENDER", help="build for exactly this Blender")
    parser.add_argument("--platform", choices=PLATFORMS, help="build the zips of this system only")
    commands = parser.add_subparsers(dest="command", metavar="{demo,test,lock}")
    commands.add_parser("demo", help="run the main job and write demo/")
    commands.add_parser("lock", help="choose the wheels anew")
    test = commands.add_parser("test", help="lint, types and every test; other arguments go to pytest")
    test.add_argument("--gui", metavar="BLENDER", help="also test in a window of this Blender")
    test.add_argument("--only", choices=TEST_PARTS, help="only this part of the tests")
    options, rest = parser.parse_known_args(arguments)
    if rest and options.command != "test":
        parser.error(f"unknown arguments: {' '.join(rest)}")
    try:
        if options.command == "demo":
            return demo()
        if options.command == "test":
            return run_tests([options.only] if options.only else TEST_PARTS, options.gui, rest)
        if options.command == "lock":
            make_lock(environment())
        elif options.blender:
            build_for(options.blender)
        else:
            build_all([options.platform] if options.platform else list(PLATFORMS))
    except BuildError as error:
        print(f"\n{error}" if "\n" in str(error) else f"build_addon.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
