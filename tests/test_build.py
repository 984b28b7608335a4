"""build_addon.py without network: the lock, the staged tree, the zip, the version."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest
from packaging.requirements import Requirement
from packaging.utils import parse_wheel_filename

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("build_addon", ROOT / "build_addon.py")
    module = sys.modules["build_addon"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def targets(build):
    return [(platform, series.python) for platform in build.PLATFORMS for series in build.SERIES]


@pytest.fixture
def wheels(tmp_path):
    """Two files that only look like wheels."""
    paths = [tmp_path / f"{name}-1.0-py3-none-any.whl" for name in ("alpha", "beta")]
    for path in paths:
        path.write_bytes(path.name.encode() * 100)
    return paths


def test_the_manifest_is_the_only_place_of_the_version(build) -> None:
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" in pyproject["project"]["dynamic"]
    assert build.version() == tomllib.loads((ROOT / "addon" / "blender_manifest.toml").read_text("utf-8"))["version"]
    assert re.search(rf"^## \[{re.escape(build.version())}\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M)
    for path in [*(ROOT / "addon").rglob("*.py"), *(ROOT / "backend").rglob("*.py")]:
        assert not re.search(r"^(__version__|VERSION) *= *[\"']", path.read_text(encoding="utf-8"), re.M), path


def test_the_lock_covers_the_six_targets_and_every_requirement(build, targets) -> None:
    lock = build.read_lock()
    assert len(targets) == 6
    assert {(platform, python) for platform in lock for python in lock[platform]} == set(targets)
    for platform, python in targets:
        locked = {wheel["name"]: wheel["version"] for wheel in lock[platform][python]}
        assert not set(locked) & set(build.NOT_SHIPPED)
        for requirement in map(Requirement, build.requirements()):
            # pip would evaluate it for the machine that makes the lock, not for the target
            assert requirement.marker is None, f"{requirement}: a wheel that ships must ship everywhere"
            assert requirement.name in locked, f"{requirement.name} is not locked: run build_addon.py lock"
            assert requirement.specifier.contains(locked[requirement.name]), f"{requirement}: run build_addon.py lock"


def test_only_the_command_line_imports_what_is_not_shipped(build) -> None:
    names = "|".join(set(build.NOT_SHIPPED) - {"numpy"})
    for path in [*(ROOT / "addon").rglob("*.py"), *(ROOT / "backend").rglob("*.py")]:
        if path not in {ROOT / "backend" / "cli.py", ROOT / "backend" / "bench.py"}:
            assert not re.search(rf"^ *(import|from) ({names})\b", path.read_text(encoding="utf-8"), re.M), path


def test_locked_wheels_fit_their_target(build, targets) -> None:
    ending = {"windows-x64": "win_amd64", "macos-arm64": "arm64", "linux-x64": "x86_64"}
    for platform, python in targets:
        for wheel in build.read_lock()[platform][python]:
            name, version, _, tags = parse_wheel_filename(wheel["file"])
            assert (name, str(version)) == (wheel["name"], wheel["version"])
            assert re.fullmatch("[0-9a-f]{64}", wheel["sha256"])
            minor = int(python.split(".")[1])
            for tag in tags:
                # what Blender's installer accepts: the system by the tag's ending, musl not at all
                assert tag.platform == "any" or tag.platform.endswith((ending[platform], "universal2")), wheel["file"]
                assert "musllinux" not in tag.platform
                stable = tag.abi == "abi3" and int(tag.interpreter.removeprefix("cp3")) <= minor
                assert tag.interpreter in {f"cp3{minor}", "py3"} or stable, wheel["file"]


def test_a_platform_has_the_same_distributions_everywhere(build, targets) -> None:
    lock = build.read_lock()
    names = {tuple(wheel["name"] for wheel in lock[platform][python]) for platform, python in targets}
    assert len(names) == 1


def test_package_has_the_code_and_nothing_else(build) -> None:
    files = build.package_files()
    assert {"LICENSE", "__init__.py", "backend/__init__.py", "backend/types.py"} <= set(files)
    tracked = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, text=True, capture_output=True)
    if tracked.returncode == 0:  # else: the project was unpacked from an archive
        known = {(ROOT / line) for line in tracked.stdout.splitlines()}
        assert set(files.values()) <= known, "a file that git ignores would ship"
    for name in files:
        assert "__pycache__" not in name and not name.endswith((".pyc", ".blend1", ".nbi", ".nbc")), name
        assert not name.startswith(("tests/", "docs/", "benchmarks/")), name
        assert not (name.startswith("blend_templates/") and name.endswith(".py")), name


def test_stage_follows_the_sources(build, tmp_path) -> None:
    (tmp_path / "backend").mkdir()
    (tmp_path / "backend" / "left_over.py").write_text("gone by then")
    build.stage(tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    assert names == {*build.package_files(), build.MANIFEST}
    source = ROOT / "backend" / "types.py"
    assert (tmp_path / "backend" / "types.py").stat().st_mtime_ns == source.stat().st_mtime_ns


def test_a_changed_kernel_makes_all_kernels_new(build, tmp_path) -> None:
    build.stage(tmp_path)
    kernels = sorted(tmp_path.rglob("*_kernels.py"))
    before = [path.stat().st_mtime_ns for path in kernels]
    build.stage(tmp_path)
    assert [path.stat().st_mtime_ns for path in kernels] == before
    kernels[0].write_text("another one")
    build.stage(tmp_path)
    assert kernels[0].read_text() != "another one"
    assert all(path.stat().st_mtime_ns > earlier for path, earlier in zip(kernels, before))
    after = [path.stat().st_mtime_ns for path in kernels]
    build.stage(tmp_path)
    assert [path.stat().st_mtime_ns for path in kernels] == after


def test_staged_manifest_sets_keys_before_the_tables(build) -> None:
    limits = {"blender_version_min": "5.1.0", "blender_version_max": "5.3.0"}
    text = build.staged_manifest({**limits, "platforms": ["linux-x64"], "wheels": ["./wheels/a-1-py3-none-any.whl"]})
    staged = tomllib.loads(text)
    original = tomllib.loads(build.manifest_text())
    assert staged == {**original, **limits, "platforms": ["linux-x64"], "wheels": ["./wheels/a-1-py3-none-any.whl"]}
    assert tomllib.loads(build.staged_manifest({})) == original


def test_series_join_without_gap_or_overlap(build) -> None:
    for earlier, later in zip(build.SERIES, build.SERIES[1:]):
        assert earlier.below == later.first
    assert tomllib.loads(build.manifest_text())["blender_version_min"] == build.SERIES[0].first


def test_zip_has_the_same_bytes_at_any_time(build, wheels, tmp_path) -> None:
    files = build.package_files(wheels)
    build.write_zip(tmp_path / "a.zip", files, "x = 1\n")
    os.utime(wheels[0], (1, 1))
    build.write_zip(tmp_path / "b.zip", dict(reversed(files.items())), "x = 1\n")
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        assert archive.testzip() is None
        assert archive.namelist() == sorted([*files, build.MANIFEST])
        assert archive.read("wheels/alpha-1.0-py3-none-any.whl") == wheels[0].read_bytes()


def test_a_zip_over_the_limit_or_refused_is_not_kept(build, wheels, tmp_path, monkeypatch) -> None:
    path = tmp_path / "big.zip"
    monkeypatch.setattr(build, "MAX_ZIP_BYTES", 1000)
    with pytest.raises(build.BuildError, match="are allowed"):
        build.finish_zip(path, wheels, {}, [sys.executable, "-c", ""])
    assert not path.exists()
    monkeypatch.setattr(build, "MAX_ZIP_BYTES", 10**9)
    with pytest.raises(build.BuildError, match="no good"):
        build.finish_zip(path, wheels, {}, [sys.executable, "-c", "raise SystemExit('no good')"])
    assert not path.exists()


def test_a_wheel_that_is_not_the_locked_one_is_refused(build, tmp_path, monkeypatch) -> None:
    name = "alpha-1.0-py3-none-any.whl"
    (tmp_path / "wheels").mkdir()
    (tmp_path / "wheels" / name).write_bytes(b"right")
    digest = hashlib.sha256(b"right").hexdigest()
    locked = [{"name": "alpha", "version": "1.0", "file": name, "sha256": digest}]
    monkeypatch.setattr(build, "CACHE", tmp_path)
    monkeypatch.setattr(build, "LOCK", tmp_path / "lock.json")
    build.LOCK.write_text(json.dumps({"linux-x64": {"3.11": locked}}))
    monkeypatch.setattr(build, "run_quietly", lambda *_: pytest.fail("pip is not needed"))
    assert build.fetch_wheels(Path("python"), "linux-x64", "3.11") == [tmp_path / "wheels" / name]
    (tmp_path / "wheels" / name).write_bytes(b"wrong")
    monkeypatch.setattr(build, "run_quietly", lambda *_: "")  # a download that changes nothing
    with pytest.raises(build.BuildError, match="is not the file that"):
        build.fetch_wheels(Path("python"), "linux-x64", "3.11")


@pytest.mark.parametrize(
    ("system", "machine", "platform"),
    [("linux", "x86_64", "linux-x64"), ("win32", "AMD64", "windows-x64"), ("darwin", "arm64", "macos-arm64")],
)
def test_a_probe_names_the_platform_as_blender_does(build, system: str, machine: str, platform: str) -> None:
    assert build.Probe((5, 2, 0), "3.13", system, machine, "2.3.5").platform == platform


def test_another_python_gets_one_line(build, monkeypatch) -> None:
    monkeypatch.setattr(build.sys, "version_info", SimpleNamespace(major=3, minor=12))
    monkeypatch.setattr(build.shutil, "which", lambda name: name if name == "python3.13" else None)
    monkeypatch.setattr(build.subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=0))
    with pytest.raises(build.BuildError) as caught:
        build.this_series()
    assert "3.12" in str(caught.value) and "run it with python3.13" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_blender_gets_one_line(build, capsys) -> None:
    assert build.main(["--for", "/nowhere/blender"]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "/nowhere/blender is not a program" in said


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_the_ci_script_is_valid_shell() -> None:
    assert subprocess.run(["bash", "-n", ROOT / ".ci" / "run"]).returncode == 0
    assert os.access(ROOT / ".ci" / "run", os.X_OK)
