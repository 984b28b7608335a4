"""The job and the command `simulate`, and scene files: rest, resuming, object space, bad input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hairloom.cli import main
from hairloom.errors import FileError, HairloomError, InputError
from hairloom.geometry.head import sphere_head
from hairloom.io.sim_cache import CacheReader
from hairloom.io.strands import write_strands
from hairloom.jobs.scene_file import read_scene_file
from hairloom.registry import run_job
from hairloom.rods.material import PRESETS
from hairloom.rods.scene import CollisionMesh, Scene
from hairloom.types import Head, StrandSet
from scipy.spatial.transform import Rotation

N_STRANDS, N_POINTS, N_FRAMES = 60, 17, 7


def hair(head: Head) -> StrandSet:
    """Strands that leave the ball's upper half and bend down, 12 cm long."""
    rng = np.random.default_rng(0)
    outwards = rng.normal(size=(N_STRANDS, 3)) * [1, 1, 0.3] + [0, 0, 0.5]
    outwards /= np.linalg.norm(outwards, axis=1)[:, None]
    radius = float(np.linalg.norm(head.vertices, axis=1).max())
    along = np.linspace(0, 0.12, N_POINTS)[None, :, None]
    flat = outwards * [1, 1, 0] / np.linalg.norm(outwards[:, :2], axis=1)[:, None]
    points = outwards[:, None] * radius + flat[:, None] * 0.06 * (1 - np.exp(-along / 0.04))
    points = points - [0, 0, 1] * np.maximum(along - 0.03, 0)
    return StrandSet(points.reshape(-1, 3).astype(np.float32), np.arange(N_STRANDS + 1, dtype=np.int32) * N_POINTS)


@pytest.fixture(scope="module")
def head() -> Head:
    return sphere_head()


@pytest.fixture(scope="module")
def strands(head: Head) -> StrandSet:
    return hair(head)


def turned(degrees: float) -> np.ndarray:
    motion = np.tile(np.eye(4), (N_FRAMES, 1, 1))
    angles = np.radians(degrees) * np.arange(N_FRAMES)
    motion[:, :3, :3] = Rotation.from_rotvec(angles[:, None] * np.array([0, 0, 1.0])).as_matrix()
    return motion


def inputs(strands: StrandSet, head: Head, motion: np.ndarray, **more: Any) -> dict[str, Any]:
    guides = np.arange(0, N_STRANDS, 3, dtype=np.int32)
    scene = Scene(24.0, motion, frame_start=10, colliders=(CollisionMesh(head.triangles, head.vertices, motion),))
    given = {"strands": strands, "guides": guides, "wisps": np.arange(N_STRANDS, dtype=np.int32) // 3, "scene": scene}
    return given | more


def frames_of(folder: Path) -> np.ndarray:
    cache = CacheReader(folder)
    return np.stack([cache.frame(cache.frame_start + number) for number in range(cache.n_frames)])


def test_a_still_head_keeps_all_hair_where_it_was(strands: StrandSet, head: Head, tmp_path: Path):
    report = run_job("simulate", inputs(strands, head, turned(0.0)), {"cache": str(tmp_path)})["report"]
    frames = frames_of(tmp_path)
    assert len(frames) == N_FRAMES and report["frames"] == N_FRAMES and CacheReader(tmp_path).frame_start == 10
    np.testing.assert_allclose(frames, np.broadcast_to(strands.points, frames.shape), atol=1e-6)
    assert report["equilibrium"]["n_stable"] == len(inputs(strands, head, turned(0.0))["guides"])


def test_roots_of_all_hair_stay_on_the_head(strands: StrandSet, head: Head, tmp_path: Path):
    motion = turned(5.0)
    run_job("simulate", inputs(strands, head, motion), {"cache": str(tmp_path)})
    roots = frames_of(tmp_path)[:, strands.offsets[:-1]]
    expected = np.einsum("fij,sj->fsi", motion[:, :3, :3], strands.roots)
    np.testing.assert_allclose(roots, expected, atol=1e-6)


def test_the_cache_can_be_in_the_space_of_an_object_that_moves_along(strands: StrandSet, head: Head, tmp_path: Path):
    motion = turned(5.0)
    given = inputs(strands, head, motion)
    run_job("simulate", given, {"cache": str(tmp_path / "world")})
    run_job("simulate", given | {"object_motion": motion}, {"cache": str(tmp_path / "object")})
    world, own = frames_of(tmp_path / "world"), frames_of(tmp_path / "object")
    np.testing.assert_allclose(np.einsum("fij,fpj->fpi", motion[:, :3, :3], own), world, atol=1e-6)
    np.testing.assert_array_equal(
        own[:, strands.offsets[:-1]], np.broadcast_to(strands.roots, own[:, strands.offsets[:-1]].shape)
    )


def test_a_resumed_simulation_gives_the_same_bytes(strands: StrandSet, head: Head, tmp_path: Path):
    given = inputs(strands, head, turned(5.0))
    run_job("simulate", given, {"cache": str(tmp_path / "whole"), "fingerprint": "a"})

    class Stop(Exception):
        pass

    def stop_in_the_middle(fraction: float, message: str) -> None:
        if message == "Frame 13":
            raise Stop

    settings = {"cache": str(tmp_path / "parts"), "fingerprint": "a"}
    with pytest.raises(Stop):
        run_job("simulate", given, settings, stop_in_the_middle)
    assert CacheReader(tmp_path / "parts").n_frames == 3
    report = run_job("simulate", given, settings | {"resume": True})["report"]
    assert frames_of(tmp_path / "parts").tobytes() == frames_of(tmp_path / "whole").tobytes()
    assert len(report["log"]) == N_FRAMES - 1
    with pytest.raises(FileError, match="another groom or with other settings"):
        run_job("simulate", given, settings | {"resume": True, "fingerprint": "b"})


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"guides": np.zeros(0, np.int32)}, "no guides"),
        ({"guides": np.array([N_STRANDS], np.int32)}, "another groom"),
        ({"wisps": np.full(N_STRANDS, 99, np.int32)}, "guide that is not there"),
        ({"wisps": np.zeros(3, np.int32)}, "another groom"),
        ({"object_motion": np.tile(np.eye(4), (2, 1, 1))}, "a matrix for each"),
    ],
)
def test_inputs_that_do_not_fit_are_refused(strands, head, tmp_path, changes, says):
    with pytest.raises(InputError, match=says):
        run_job("simulate", inputs(strands, head, turned(0.0)) | changes, {"cache": str(tmp_path / "cache")})
    assert not (tmp_path / "cache").exists()


# --- scene files ---

SCENE = """
fps = 30
frames = 5
[motion]
shake = { frequency = 2.0, degrees = 10, axis = [0, 0, 2], pivot = [1, 0, 0] }
move = { frequency = 1.0, way = [0.1, 0, 0] }
[[field]]
kind = "wind"
strength = 3.0
direction = [0, 2, 0]
[guides]
n_guides = 20
[settings.material]
preset = "wet"
friction = 0.9
"""


def test_a_scene_file_says_what_it_says(tmp_path: Path):
    (tmp_path / "scene.toml").write_text(SCENE)
    found = read_scene_file(tmp_path / "scene.toml")
    assert found.scene.fps == 30 and found.scene.n_frames == 5 and found.head is None
    angle = np.radians(10) * np.sin(4 * np.pi * 2 / 30)
    turn = Rotation.from_rotvec([0, 0, angle]).as_matrix()
    np.testing.assert_allclose(found.scene.motion[2, :3, :3], turn, atol=1e-12)
    pivot = np.array([1.0, 0, 0])
    moved = pivot - turn @ pivot + [0.1 * np.sin(2 * np.pi * 2 / 30), 0, 0]
    np.testing.assert_allclose(found.scene.motion[2, :3, 3], moved, atol=1e-12)
    np.testing.assert_allclose(found.scene.fields[0].matrices[0, :3, 2], [0, 1, 0], atol=1e-12)
    assert found.guides == {"n_guides": 20}
    assert found.settings["material"]["friction"] == 0.9
    assert found.settings["material"]["young"] == PRESETS["wet"].young


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("fps = ", "is not a TOML file"),
        ("frames = 2\nspeed = 3", "no setting 'speed'"),
        ("fps = 24", "frames is missing"),
        ("frames = -3", "frames is -3"),
        ("frames = 2\nfps = 0", "fps is 0"),
        ("frames = 2\nfps = 'many'", "fps is 'many'"),
        ("frames = 2\ngravity = [0, 1]", "three finite numbers"),
        ("frames = 2\n[[field]]\nkind = 'magnet'", "'magnet' is not known"),
        ("frames = 2\n[[field]]\ndirection = [0, 0, 0]", "0 long"),
        ("frames = 2\n[field]\nkind = 'wind'", r"write each field as \[\[field\]\]"),
        ("frames = 2\n[head]\nunits = 'm'", "no 'mesh'"),
        ("frames = 2\n[head]\nmesh = 'nowhere.obj'", "nowhere.obj"),
        ("frames = 2\n[settings.material]\npreset = 'silk'", "no preset 'silk'"),
        ("[motion]\nfile = 'nowhere.npz'", "nowhere.npz"),
    ],
)
def test_bad_scene_files_are_refused_in_one_line(tmp_path: Path, text: str, says: str):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(HairloomError, match=says) as error:
        read_scene_file(tmp_path / "scene.toml")
    assert "\n" not in str(error.value)


def test_motion_from_a_file(tmp_path: Path):
    np.savez(tmp_path / "head.npz", motion=turned(3.0))
    (tmp_path / "scene.toml").write_text('[motion]\nfile = "head.npz"')
    np.testing.assert_array_equal(read_scene_file(tmp_path / "scene.toml").scene.motion, turned(3.0))
    np.savez(tmp_path / "head.npz", motion=np.zeros((4, 3)))
    with pytest.raises(InputError, match="must be"):
        read_scene_file(tmp_path / "scene.toml")


def test_the_command_writes_all_frames(strands: StrandSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_strands(tmp_path / "hair.npz", strands)
    (tmp_path / "scene.toml").write_text("frames = 4\n[motion]\nmove = { way = [0.05, 0, 0] }\n[guides]\nn_guides = 60")
    command = ["simulate", str(tmp_path / "hair.npz"), str(tmp_path / "scene.toml"), str(tmp_path / "out.npz")]
    assert main([*command, "--json", "--cache", str(tmp_path / "cache")]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["guides"] == N_STRANDS and report["frames"] == 4
    with np.load(tmp_path / "out.npz") as out:
        assert out["positions"].shape == (4, N_STRANDS * N_POINTS, 3) and out["positions"].dtype == np.float32
        np.testing.assert_array_equal(out["positions"][0], strands.points)
        np.testing.assert_array_equal(out["offsets"], strands.offsets)
    assert main([*command, "--resume"]) == 2
    assert "--resume needs --cache" in capsys.readouterr().err
