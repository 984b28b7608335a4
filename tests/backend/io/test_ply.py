"""Strands in .ply: encodings, how many points a strand has, and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.io import ply
from hairloom.io.strands import Units, read_strands

FILE_AXES = Units(1.0, "Z")  # leaves coordinates as they are


def write_ply(path: Path, points: np.ndarray, encoding: str = "binary_little_endian", extra: str = "") -> None:
    header = f"ply\nformat {encoding} 1.0\ncomment made by hand\n{extra}element vertex {len(points)}\n"
    header += "property float x\nproperty float y\nproperty float z\n"
    header += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    if encoding == "ascii":
        body = "".join(f"{x:.9g} {y:.9g} {z:.9g} 255 0 51\n" for x, y, z in points).encode()
    else:
        order = "<" if "little" in encoding else ">"
        table = np.zeros(len(points), dtype=[("p", order + "f4", 3), ("c", "u1", 3)])
        table["p"], table["c"] = points, (255, 0, 51)
        body = table.tobytes()
    path.write_bytes(header.encode() + body)


def ply_hair(n_strands: int, n_points: int, seed: int = 0) -> np.ndarray:
    """Strands 0.1 long that start anywhere on a unit square, as neural methods write them."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(n_strands, n_points, 3)) * 0.1 + [0, 0, 1.0]
    roots = rng.uniform(size=(n_strands, 1, 3))
    return (roots + steps.cumsum(axis=1) * 0.1 / n_points).reshape(-1, 3).astype(np.float32)


@pytest.mark.parametrize("encoding", ["binary_little_endian", "binary_big_endian", "ascii"])
def test_ply_encodings_and_colours(tmp_path, encoding):
    path, points = tmp_path / "a.ply", ply_hair(20, 100)
    write_ply(path, points, encoding)
    strands = read_strands(path, units=FILE_AXES)
    np.testing.assert_array_equal(strands.points, points)
    assert strands.point_counts.tolist() == [100] * 20
    np.testing.assert_allclose(strands.point_attributes["color"][3], [1.0, 0.0, 0.2], rtol=1e-6)


@pytest.mark.parametrize("n_points", [4, 16, 60, 64, 100, 256])
def test_ply_points_per_strand_are_guessed(n_points):
    assert ply.guess_points_per_strand(ply_hair(48, n_points, n_points)) == n_points


def test_ply_is_refused_when_the_guess_is_open(tmp_path):
    path = tmp_path / "a.ply"
    one_strand = ply_hair(1, 600)
    write_ply(path, one_strand)
    with pytest.raises(FileError, match="points_per_strand"):
        read_strands(path)
    assert read_strands(path, points_per_strand=600).n_strands == 1
    assert read_strands(path, points_per_strand=100).n_strands == 6
    with pytest.raises(FileError, match="no whole number of strands of 7"):
        read_strands(path, points_per_strand=7)
    write_ply(path, one_strand, extra="comment points_per_strand 60\n")
    assert read_strands(path).n_strands == 10
    noise = np.random.default_rng(0).normal(size=(600, 3)).astype(np.float32)
    assert ply.guess_points_per_strand(noise) == 0
    with pytest.raises(InputError, match="ply"):
        read_strands(tmp_path / "a.hair", points_per_strand=3)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b"ply\n", b"plx\n", "no .ply file"),
        (b"end_header", b"end_headex", "no .ply file"),
        (b"format binary", b"format bimary", "no format"),
        (b"vertex 12", b"vertex 99999999999", "need"),
        (b"vertex 12", b"vertex 13", "need"),
        (b"float z", b"float w", "x, y and z"),
        (b"float z", b"list uchar int z", "not known"),
        (b"float z", b"float y", "x, y and z"),
        (b"comment made by hand", b"element face 3\ncomment", "vertices"),
    ],
)
def test_ply_headers_that_lie(tmp_path, old, new, reason):
    path = tmp_path / "a.ply"
    write_ply(path, ply_hair(3, 4))
    path.write_bytes(path.read_bytes().replace(old, new, 1))
    with pytest.raises(FileError, match=reason):
        read_strands(path)


def test_a_ply_mesh_is_no_hair(tmp_path):
    path = tmp_path / "a.ply"
    write_ply(path, ply_hair(3, 4))
    path.write_bytes(path.read_bytes().replace(b"end_header", b"element face 9\nend_header", 1))
    with pytest.raises(FileError, match="mesh of 9 faces"):
        read_strands(path)
