"""Strand files: round trips, layouts written by hand as the format descriptions say, and refusals."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hairloom.errors import FileError, InputError
from hairloom.io import hair
from hairloom.io.raw import Dropped, RawStrands, strands_from_raw
from hairloom.io.strands import Units, read_strands, read_strands_report, suffixes, write_strands
from hairloom.types import StrandSet

FILE_AXES = Units(1.0, "Z")  # leaves coordinates as they are


def make_strands(counts=(3, 3, 3, 3), seed: int = 0) -> StrandSet:
    rng = np.random.default_rng(seed)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    points = rng.normal(size=(offsets[-1], 3)).astype(np.float32)
    return StrandSet(
        points,
        offsets,
        {
            "radius": rng.random(len(points)).astype(np.float32),
            "transparency": rng.random(len(points)).astype(np.float32),
            "color": rng.random((len(points), 3)).astype(np.float32),
            "inverse_mass": rng.random(len(points)).astype(np.float32),
            "uv": rng.random((len(points), 2)).astype(np.float32),
        },
        {
            "surface_uv_coordinate": rng.random((len(counts), 2)).astype(np.float32),
            "hairloom_wisp": np.arange(len(counts), dtype=np.int32),
        },
    )


RAGGED, EQUAL = (5, 2, 3, 7), (3, 3, 3, 3)
KEPT = {
    ".hair": {"radius", "transparency", "color"},
    ".ply": {"radius", "color"},
    ".npz": set(make_strands().point_attributes),
}


@pytest.mark.parametrize("suffix", suffixes())
@pytest.mark.parametrize("counts", [RAGGED, EQUAL])
def test_round_trip(tmp_path, suffix, counts):
    strands = make_strands(counts)
    path = tmp_path / f"hair{suffix}"
    if suffix == ".ply" and counts is RAGGED:
        with pytest.raises(InputError, match="resample"):
            write_strands(path, strands)
        assert not path.exists()
        return
    write_strands(path, strands)
    back, report = read_strands_report(path)
    # the same bits: with metres, axes are exchanged and signs changed, which rounds nothing
    np.testing.assert_array_equal(back.points, strands.points)
    np.testing.assert_array_equal(back.offsets, strands.offsets)
    assert report.n_strands_in_file == 4 and report.dropped.n_empty == report.dropped.n_non_finite == 0
    for name in KEPT.get(suffix, set()):
        np.testing.assert_array_equal(back.point_attributes[name], strands.point_attributes[name])
    if suffix == ".npz":
        np.testing.assert_array_equal(back.strand_attributes["hairloom_wisp"], [0, 1, 2, 3])


@pytest.mark.parametrize("version", [2, 3, 4])
@pytest.mark.parametrize("counts", [RAGGED, EQUAL])
def test_round_trip_of_tfx_versions(tmp_path, version, counts):
    strands, path = make_strands(counts), tmp_path / "hair.tfx"
    if counts is RAGGED and version > 2:
        with pytest.raises(InputError, match="version 2"):
            write_strands(path, strands, tfx_version=version)
        return
    write_strands(path, strands, tfx_version=version)
    start = path.read_bytes()[:9]
    assert start == b"version 2" if version == 2 else struct.unpack("<f", start[:4]) == (version,)
    back = read_strands(path)
    np.testing.assert_array_equal(back.points, strands.points)
    np.testing.assert_array_equal(back.offsets, strands.offsets)
    if version == 4:
        for name in ("inverse_mass", "uv"):
            np.testing.assert_array_equal(back.point_attributes[name], strands.point_attributes[name])
        np.testing.assert_array_equal(back.point_attributes["color"][:, :3], strands.point_attributes["color"])
        uv = back.strand_attributes["surface_uv_coordinate"]
        np.testing.assert_array_equal(uv, strands.strand_attributes["surface_uv_coordinate"])


def test_tfx_picks_the_version_that_holds_the_strands(tmp_path):
    write_strands(tmp_path / "a.tfx", make_strands(RAGGED))
    assert (tmp_path / "a.tfx").read_bytes().startswith(b"version 2.0")
    with pytest.raises(InputError, match="tfx_version"):
        write_strands(tmp_path / "a.hair", make_strands(), tfx_version=4)
    with pytest.raises(InputError, match="version 5"):
        write_strands(tmp_path / "a.tfx", make_strands(), tfx_version=5)


@pytest.mark.parametrize("suffix", suffixes())
def test_units_are_written_and_read(tmp_path, suffix):
    strands, path, units = make_strands(), tmp_path / f"hair{suffix}", Units(0.01, "Y", "-Z")
    write_strands(path, strands, units=units)
    in_file = read_strands(path, units=FILE_AXES)
    x, y, z = 100.0 * strands.points.astype(np.float64).T
    # y up and face along -z: the file's axes are -x, z, y of the world; one rounding to float32
    np.testing.assert_allclose(in_file.points, np.stack([-x, z, y], axis=1), rtol=1e-6)
    back = read_strands(path, units=units)
    np.testing.assert_allclose(back.points, strands.points, rtol=2e-7)
    if "radius" in back.point_attributes:
        np.testing.assert_allclose(
            in_file.point_attributes["radius"], 100 * strands.point_attributes["radius"], rtol=1e-6
        )
        np.testing.assert_allclose(back.point_attributes["radius"], strands.point_attributes["radius"], rtol=2e-7)


@pytest.mark.parametrize("suffix", suffixes())
def test_no_strands_at_all(tmp_path, suffix):
    path = tmp_path / f"hair{suffix}"
    write_strands(path, StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32)))
    if suffix == ".obj":  # without lines nothing says that it is hair
        with pytest.raises(FileError, match="no strands"):
            read_strands(path)
    else:
        assert read_strands(path).n_strands == 0


def test_existing_files_are_kept_when_asked(tmp_path):
    path = tmp_path / "hair.data"
    path.write_bytes(b"old")
    with pytest.raises(FileError, match="exists"):
        write_strands(path, make_strands(), overwrite=False)
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == ["hair.data"]


@pytest.mark.parametrize("name", ["hair.abc", "hair", "hair.hair.gz"])
def test_unknown_suffixes_name_the_known_ones(tmp_path, name):
    for action in (lambda path: read_strands(path), lambda path: write_strands(path, make_strands())):
        with pytest.raises(FileError, match=r"\.tfx"):
            action(tmp_path / name)


# --- files written here byte by byte, as shared/spec/formats.md and the formats' authors describe them


def write_hair(path: Path, arrays: int = 31, n_strands: int = 2, n_points: int = 5, default_segments: int = 9) -> None:
    header = struct.pack("<4sIIII", b"HAIR", n_strands, n_points, arrays, default_segments)
    header += struct.pack("<5f", 0.5, 0.25, 0.1, 0.2, 0.3) + b"by hand".ljust(88, b"\0")
    body = b""
    if arrays & 1:
        body += struct.pack("<2H", 1, 2)
    for bit, channels in ((2, 3), (4, 1), (8, 1), (16, 3)):
        if arrays & bit:
            body += np.arange(n_points * channels, dtype="<f4").tobytes()
    path.write_bytes(header + body)


def test_hair_layout(tmp_path):
    path = tmp_path / "a.hair"
    write_hair(path)
    strands = read_strands(path)
    assert strands.offsets.tolist() == [0, 2, 5]
    np.testing.assert_array_equal(strands.points, np.arange(15).reshape(5, 3))
    np.testing.assert_array_equal(strands.point_attributes["radius"], np.arange(5) / 2)  # thickness is the diameter
    np.testing.assert_array_equal(strands.point_attributes["color"], np.arange(15).reshape(5, 3))
    write_hair(path, arrays=2, n_points=20)
    strands = read_strands(path)
    assert strands.offsets.tolist() == [0, 10, 20]
    np.testing.assert_allclose(strands.point_attributes["radius"], 0.25)
    np.testing.assert_allclose(strands.point_attributes["color"][7], [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"n_points": 6}, "states 6 points"),
        ({"arrays": 29}, "no points"),
        ({"arrays": 2, "default_segments": 3}, "states 5 points"),
        ({"arrays": 2, "n_strands": 10**9, "n_points": 10**9, "default_segments": 0}, "1000000000 strands"),
        ({"n_strands": 10**9}, "need 2000000000 bytes"),
    ],
)
def test_hair_headers_that_lie(tmp_path, change, reason):
    path = tmp_path / "a.hair"
    write_hair(path, **({"n_points": 5} | change) if change.get("n_points", 0) < 100 else {"n_points": 5})
    if change.get("n_points", 0) >= 100:
        data = bytearray(path.read_bytes())
        struct.pack_into("<4I", data, 4, change["n_strands"], change["n_points"], change["arrays"], 0)
        path.write_bytes(data)
    with pytest.raises(FileError, match=rf"a\.hair at byte \d+: .*{reason}"):
        read_strands(path)


def test_hair_refuses_strands_longer_than_its_counts(tmp_path):
    with pytest.raises(InputError, match="65536"):
        write_strands(tmp_path / "a.hair", make_strands((65_537,)))


def test_data_layout_with_empty_hairs(tmp_path):
    path = tmp_path / "a.data"
    points = np.arange(9, dtype="<f4")
    empty = struct.pack("<i3f", 1, 7, 7, 7)
    path.write_bytes(
        struct.pack("<i", 5)
        + (struct.pack("<i", 2) + points[:6].tobytes())
        + empty
        + struct.pack("<i", 0)
        + (struct.pack("<i", 1 + 1) + points[3:].tobytes())
        + empty
    )
    strands, report = read_strands_report(path, units=FILE_AXES)
    np.testing.assert_array_equal(strands.points, [[0, 1, 2], [3, 4, 5], [3, 4, 5], [6, 7, 8]])
    assert report.n_strands_in_file == 5 and report.dropped.n_empty == 3
    y_up = read_strands(path)
    np.testing.assert_array_equal(y_up.points[0], [0, -2, 1])  # (x, y, z) -> (x, -z, y)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([-1], "-1 strands"),
        ([10**9, 1], "1000000000 strands"),
        ([1, -3], "-3 points"),
        ([1, 2**31 - 1], "2147483647 points"),
        ([2, 0], "do not fit|ends before"),
        ([1, 1, 0, 0, 0, 9], "4 bytes longer"),
    ],
)
def test_data_counts_that_lie(tmp_path, words, reason):
    path = tmp_path / "a.data"
    path.write_bytes(np.array(words, dtype="<i4").tobytes())
    with pytest.raises(FileError, match=rf"a\.data at byte \d+: .*({reason})"):
        read_strands(path)


def test_ascii_tfx_of_other_exporters(tmp_path):
    """Header lines before the strands, words after the counts, Windows line ends, blank lines and exponents."""
    path = tmp_path / "a.tfx"
    path.write_bytes(
        b"version 2.0\r\nscale 1.0\r\nrotation 0 0 0\r\nnumStrands 2\r\n"
        b"strand 0 numVerts 2 texcoord 0.5 0.25\r\n1 2 3\r\n4e0 5.0 -6\r\n\r\n"
        b"strand 1 numVerts 3 texcoord 0 0\r\n0 0 0\r\n1 1 1\r\n2 2 2"
    )
    strands = read_strands(path, units=FILE_AXES)
    assert strands.offsets.tolist() == [0, 2, 5]
    np.testing.assert_array_equal(strands.points[:3], [[1, 2, 3], [4, 5, -6], [0, 0, 0]])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"version 9.0\nstrand 0 numVerts 1\n0 0 0\n", "version '9.0'"),
        (b"version 2.0\nstrand 0 numVerts 2\n0 0 0\n", "states 2 points but has 3 numbers"),
        (b"version 2.0\nstrand 0 numVerts 1\n0 0 0\n1 1 1\nstrand 1 numVerts 2\n0 0 0\n", "strand 0 states 1"),
        (b"version 2.0\nstrand 0 numVerts 999999999999\n0 0 0\n", "states 999999999999 points"),
        (b"version 2.0\nstrand 0 numVerts 1\n0 zero 0\n", "'zero' is no number"),
        (b"version 2.0\nstrand 0 numVerts 1\n0 0 \x00 0\n", "no number|numbers"),
    ],
)
def test_ascii_tfx_that_lies(tmp_path, text, reason):
    path = tmp_path / "a.tfx"
    path.write_bytes(text)
    with pytest.raises(FileError, match=reason):
        read_strands(path)


@pytest.mark.parametrize(
    "header",
    [
        struct.pack("<fII", 5.0, 1, 1),
        struct.pack("<fII", float("nan"), 1, 1),
        struct.pack("<fII", 3.0, 10**9, 64),
        struct.pack("<fII", 3.0, 2**32 - 1, 2**32 - 1),
        struct.pack("<fII", 3.0, 4, 0),
        struct.pack("<fIII", 4.0, 2, 2, 8),
        struct.pack("<fIII", 4.0, 2, 2, 10**9),
    ],
)
def test_binary_tfx_that_lies(tmp_path, header):
    path = tmp_path / "a.tfx"
    path.write_bytes(header.ljust(1000, b"\0"))
    with pytest.raises(FileError, match=r"a\.tfx at byte \d+"):
        read_strands(path)


def test_version_4_with_every_array(tmp_path):
    """Two strands of two points; the arrays lie in another order than the header names them."""
    path = tmp_path / "a.tfx"
    blocks = [
        np.arange(4, dtype="<f4") + 0.5,  # strand uv, at 160
        np.array([0.25, 0.5], dtype="<f4"),  # strand thickness, at 176
        np.arange(16, dtype="<f4"),  # points, at 184
        np.arange(16, dtype="<f4") / 16,  # colours, at 248
        np.arange(8, dtype="<f4"),  # point uv, at 312
    ]
    header = struct.pack("<f7I", 4.0, 2, 2, 184, 160, 312, 176, 248).ljust(160, b"\0")
    path.write_bytes(header + b"".join(block.tobytes() for block in blocks))
    strands = read_strands(path, units=Units(0.1))
    np.testing.assert_allclose(strands.points[1], [0.4, 0.5, 0.6])
    np.testing.assert_array_equal(strands.point_attributes["inverse_mass"], [3, 7, 11, 15])
    np.testing.assert_array_equal(strands.point_attributes["uv"][3], [6, 7])
    np.testing.assert_array_equal(strands.point_attributes["color"][1], [0.25, 0.3125, 0.375, 0.4375])
    np.testing.assert_array_equal(strands.strand_attributes["surface_uv_coordinate"][1], [2.5, 3.5])
    # half the thickness, in metres
    np.testing.assert_allclose(strands.strand_attributes["radius"], [0.0125, 0.025])
    write_strands(path, strands, units=Units(0.1))
    again = read_strands(path, units=Units(0.1))
    np.testing.assert_allclose(again.strand_attributes["radius"], [0.0125, 0.025])


@pytest.mark.parametrize(("bad_point", "strand"), [(0, 0), (1, 0), (2, 1), (4, 1), (5, 2)])
def test_the_strand_of_a_nan_is_the_one_that_goes(bad_point, strand):
    points = np.arange(18, dtype=np.float32).reshape(6, 3)
    points[bad_point, 1] = np.nan
    raw = RawStrands(points, np.array([2, 0, 3, 1]), strand_attributes={"name": np.array([0, 9, 1, 2])})
    strands, dropped = strands_from_raw(raw)
    assert dropped == Dropped(n_empty=1, n_non_finite=1)
    assert strands.strand_attributes["name"].tolist() == [name for name in (0, 1, 2) if name != strand]
    assert bad_point * 3 not in strands.points[:, 0]


def test_raw_strands_that_do_not_fit_together_are_refused():
    points = np.zeros((3, 3), dtype=np.float32)
    for counts in ([2], [4, -1], [2, 2]):
        with pytest.raises(InputError, match="counts"):
            strands_from_raw(RawStrands(points, np.array(counts)))
    with pytest.raises(InputError, match="shape"):
        strands_from_raw(RawStrands(points[:, :2], np.array([3])))


def test_strands_with_nan_are_set_aside_and_counted(tmp_path):
    path = tmp_path / "a.hair"
    write_hair(path)
    data = bytearray(path.read_bytes())
    struct.pack_into("<f", data, hair.HEADER.size + 4 + 12, float("nan"))  # x of the second point
    struct.pack_into("<f", data, hair.HEADER.size + 4 + 60 + 8, float("inf"))  # thickness of the third point
    path.write_bytes(data)
    strands, report = read_strands_report(path)
    assert strands.n_strands == 1 and report.dropped.n_non_finite == 1 and report.n_strands_in_file == 2
    np.testing.assert_array_equal(strands.points, np.arange(6, 15).reshape(3, 3))
    np.testing.assert_array_equal(strands.point_attributes["radius"], [0.0, 1.5, 2.0])
    struct.pack_into("<f", data, hair.HEADER.size + 4 + 12 * 4, float("-inf"))
    path.write_bytes(data)
    with pytest.raises(FileError, match="none of its 2 strands"):
        read_strands(path)


def test_points_beyond_float32_are_refused_on_writing(tmp_path):
    strands = StrandSet(np.full((2, 3), 1e38, np.float32), np.array([0, 2], np.int32))
    with pytest.raises(InputError, match="larger unit"):
        write_strands(tmp_path / "a.npz", strands, units=Units(0.001))
    assert not os.listdir(tmp_path)


# --- .obj and .npz


def test_obj_lines_in_all_their_forms(tmp_path):
    path = tmp_path / "a.obj"
    path.write_bytes(
        b"# strands\nmtllib none.mtl\no hair\nv 0 0 0\nv 1 0 0 1.0\r\nv 2 0 0 1 0.5 0.5\nvt 0 0\nvn 0 0 1\n"
        b"l 1 2 \\\n3\nv 5 5 5 # a comment\n  l -1/1 1/1\nusemtl x\nl 4"
    )
    strands = read_strands(path, units=FILE_AXES)
    assert strands.offsets.tolist() == [0, 3, 5, 6]
    np.testing.assert_array_equal(strands.points[:, 0], [0, 1, 2, 5, 0, 5])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "no strands"),
        (b"v 0 0 0\nv 0 0 1\nv 1 1 1\nf 1 2 3\n", "a mesh"),
        (b"v 0 0 0\nl 1 2\n", "names vertex 2, but there are 1"),
        (b"v 0 0 0\nl 1 -2\n", "names vertex -2"),
        (b"v 0 0 0\nl 0 1\n", "names vertex 0"),
        (b"l -1\nv 0 0 0\n", "names vertex -1"),
        (b"v 0 0\nl 1\n", "needs 3 numbers"),
        (b"v 0 0 x\nl 1\n", "'x' is no number"),
        (b"v 0 0 1.5abc\nl 1\n", "at byte 6: '1.5abc' is no number"),
        (b"v 0 0 0\nl 1.5\n", "no whole number"),
        (b"v 0 0 0\nl 1e300\n", "no whole number"),
        (b"v 0 0 0\nl 99999999999999999999\n", "whole number|names vertex"),
        (b"v 0 0 0\nl nan\n", "no whole number"),
        (b"v 0 0 0\nl\n", "needs 1"),
    ],
)
def test_obj_that_lies(tmp_path, text, reason):
    path = tmp_path / "a.obj"
    path.write_bytes(text)
    with pytest.raises(FileError, match=reason):
        read_strands(path)


def save_npz(path: Path, **changes: object) -> None:
    arrays: dict[str, object] = {
        "points": np.zeros((5, 3), np.float32),
        "offsets": np.array([0, 2, 5], np.int32),
        "meta": json.dumps({"format": "hairloom-strands", "version": 1}),
    }
    arrays |= changes
    np.savez_compressed(path, **{name: array for name, array in arrays.items() if array is not None})


def test_npz_by_numpy_with_plain_attribute_names(tmp_path):
    path = tmp_path / "a.npz"
    save_npz(
        path, radius=np.arange(5.0), wisp=np.array([1, 2]), points=np.asfortranarray(np.arange(15.0).reshape(5, 3))
    )
    strands = read_strands(path)
    assert set(strands.point_attributes) == {"radius"} and set(strands.strand_attributes) == {"wisp"}
    np.testing.assert_array_equal(strands.points, np.arange(15).reshape(5, 3))


@pytest.mark.parametrize(
    "changes",
    [
        {"points": None},
        {"offsets": None},
        {"meta": None},
        {"meta": "{"},
        {"meta": "[1]"},
        {"meta": json.dumps({"format": "hairloom-strands", "version": 2})},
        {"points": np.zeros((5, 2), np.float32)},
        {"points": np.zeros((5, 3), np.int32)},
        {"offsets": np.array([0, 4])},
        {"offsets": np.array([0, 4, 2, 5])},
        {"offsets": np.array([0.0, 5.0])},
        {"offsets": np.array([1, 5])},
        {"radius": np.zeros(4)},
        {"radius": np.float32(1)},
        {"radius": np.array([None] * 5)},
        {"radius": np.zeros(5, dtype="f4,i4")},
    ],
)
def test_npz_that_lies(tmp_path, changes):
    path = tmp_path / "a.npz"
    save_npz(path, **changes)
    with pytest.raises(FileError, match=r"a\.npz"):
        read_strands(path)


def test_npz_bombs_are_refused_before_they_unpack(tmp_path, monkeypatch):
    """40 MB of zeros in an archive of 40 kB, with less to spare than usual."""
    monkeypatch.setattr("hairloom.io.npz.SPARE", 2**20)
    path = tmp_path / "a.npz"
    save_npz(path, bomb=np.zeros(10_000_000, np.float32))
    with pytest.raises(FileError, match="200 times"):
        read_strands(path)
