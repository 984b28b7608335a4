"""Damaged files at every reader: a HairloomError or a valid result, never another exception, never much memory.

Small valid files of each format are cut at every byte of their headers and at some later ones; bytes are flipped,
numbers of the header replaced by extremes, and pieces repeated or left out; seeds are fixed.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hairloom.errors import FileError, HairloomError
from hairloom.io.bundle import read_bundle, write_bundle
from hairloom.io.mesh import read_mesh_file
from hairloom.io.strands import read_strands, write_strands
from hairloom.types import StrandSet

N_FLIPS = 100
MOST_MEMORY = 64 * 2**20  # bytes; the files have less than 4 kB
EXTREMES = (0, 2**31 - 1, 2**32 - 1, 10**9, 0x7FC00000)  # as numbers, -1 and NaN


def small_strands() -> StrandSet:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(12, 3)).astype(np.float32)
    attributes = {"radius": np.ones(12, np.float32), "color": rng.random((12, 3)).astype(np.float32)}
    wisps = {"surface_uv_coordinate": rng.random((4, 2)).astype(np.float32)}
    return StrandSet(points, np.arange(0, 13, 3, dtype=np.int32), attributes, wisps)


def strand_file(suffix: str, version: int | None = None) -> Callable[[Path], tuple[Path, Callable[[Path], object]]]:
    def make(folder: Path) -> tuple[Path, Callable[[Path], object]]:
        path = folder / f"hair{suffix}"
        write_strands(path, small_strands(), tfx_version=version)
        return path, read_strands

    return make


def mesh_file(folder: Path) -> tuple[Path, Callable[[Path], object]]:
    path = folder / "head.obj"
    path.write_bytes(
        b"o head\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0.5 1\n"
        b"g body\nf 1/1/1 2/2 3/3\nf -1 1//1 2 3\n"
    )
    return path, read_mesh_file


def ascii_ply(folder: Path) -> tuple[Path, Callable[[Path], object]]:
    path = folder / "hair.ply"
    header = "ply\nformat ascii 1.0\ncomment points_per_strand 3\nelement vertex 6\n"
    header += "property float x\nproperty double y\nproperty float z\nend_header\n"
    path.write_text(header + "".join(f"{i} {i}.5 1e-3\n" for i in range(6)))
    return path, read_strands


def bundle_file(folder: Path) -> tuple[Path, Callable[[Path], object]]:
    path = folder / "values.npz"
    write_bundle(path, {"strands": small_strands(), "n": 3, "list": [1.5, ("a", None)], "flags": np.array([True])})
    return path, read_bundle


FILES = {
    "hair": strand_file(".hair"),
    "data": strand_file(".data"),
    "tfx2": strand_file(".tfx", 2),
    "tfx3": strand_file(".tfx", 3),
    "tfx4": strand_file(".tfx", 4),
    "ply": strand_file(".ply"),
    "ascii_ply": ascii_ply,
    "obj": strand_file(".obj"),
    "npz": strand_file(".npz"),
    "mesh": mesh_file,
    "bundle": bundle_file,
}


def damaged_versions(data: bytes, seed: int) -> Iterator[bytes]:
    rng = np.random.default_rng(seed)
    yield from (data[:end] for end in range(min(len(data), 300)))
    yield from (data[:end] for end in range(300, len(data), 61))
    for _ in range(N_FLIPS):
        flipped = bytearray(data)
        for place in rng.integers(0, len(data), rng.integers(1, 5)):
            flipped[place] = rng.integers(0, 256)
        yield bytes(flipped)
    for place in range(0, min(len(data), 168), 4):
        for value in EXTREMES:
            yield data[:place] + value.to_bytes(4, "little") + data[place + 4 :]
    for _ in range(20):
        start, end = sorted(rng.integers(0, len(data), 2))
        yield data[:end] + data[start:]
        yield data[:start] + data[end:]
    yield data + b"\0" * 7


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", FILES)
def test_damaged_files(tmp_path, kind):
    path, read = FILES[kind](tmp_path)
    data = path.read_bytes()
    read(path)
    refused = 0
    tracemalloc.start()
    try:
        for number, content in enumerate(damaged_versions(data, seed=len(kind))):
            path.write_bytes(content)
            tracemalloc.reset_peak()
            try:
                result = read(path)
            except HairloomError as error:
                refused += 1
                assert isinstance(error, FileError), f"version {number}: {error!r}"
                assert path.name in str(error) and "\n" not in str(error), f"version {number}: {error!r}"
            else:
                # StrandSet and the mesh check themselves when they are made; NaN must not get through
                points = getattr(result, "points", getattr(result, "vertices", np.zeros(0)))
                assert np.isfinite(points).all()
            assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY, f"version {number} took too much memory"
    finally:
        tracemalloc.stop()
    assert refused > 100  # else this test does not damage anything that matters


@pytest.mark.parametrize("suffix", [".hair", ".data", ".tfx", ".ply", ".obj", ".npz"])
def test_noise_and_emptiness(tmp_path, suffix):
    path = tmp_path / f"noise{suffix}"
    for seed in range(30):
        rng = np.random.default_rng(seed)
        path.write_bytes(rng.bytes(int(rng.integers(0, 2000))))
        with pytest.raises(FileError, match="noise"):
            read_strands(path)
