"""io.ogawa, io.ogawa_read and io.alembic: what is written is read, equal samples are stored once, damage is said.

Blender reads the same files in tests/blender/test_bake.py.
"""

from __future__ import annotations

import errno
import struct

import numpy as np
import pytest
from hairloom.errors import FileError, HairloomError, InputError
from hairloom.io.alembic import UNREAL, Y_UP, AlembicWriter, GeomParam
from hairloom.io.ogawa import ArchiveWriter
from hairloom.io.ogawa_read import Archive, Property

COUNTS = np.array([4, 3, 5], np.int32)


def frames(n: int = 5, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, COUNTS.sum(), 3)).astype(np.float32)


def write(path, points, **options):
    params = options.pop("params", ())
    widths = options.pop("widths", np.full(COUNTS.sum(), 0.001, np.float32))
    with AlembicWriter(path, **options) as file:
        curves = file.add_curves("Hair", COUNTS, params=params)
        for frame in points:
            curves.write(frame, widths)


def geometry(path, name: str = "Hair") -> Property:
    return next(o for o in Archive(path).top.walk() if o.schema == "AbcGeom_Curve_v2" and o.name == name).properties[
        ".geom"
    ]


def test_positions_come_back_bit_by_bit(tmp_path):
    points = frames()
    write(tmp_path / "hair.abc", points)
    geom = geometry(tmp_path / "hair.abc")
    assert geom["P"].n_samples == 5
    for i, frame in enumerate(points):
        x, y, z = geom["P"].sample(i).T
        assert np.array_equal(np.stack([x, -z, y], axis=1), frame)
        box = np.concatenate([np.min([x, y, z], axis=1), np.max([x, y, z], axis=1)])
        assert np.array_equal(geom[".selfBnds"].sample(i), box)
    assert np.array_equal(geom["nVertices"].sample(4), COUNTS)
    assert np.array_equal(geom["curveBasisAndType"].sample(0), [1, 0, 0, 0])
    assert np.array_equal(geom["width"].sample(4), np.full(12, 0.001, np.float32))
    assert [geom[n].is_constant for n in ("P", "nVertices", "width")] == [False, True, True]


def test_samples_are_at_frames_of_the_animation(tmp_path):
    write(tmp_path / "hair.abc", frames(), fps=25.0, frame_start=11)
    archive = Archive(tmp_path / "hair.abc")
    sampling = archive.samplings[geometry(tmp_path / "hair.abc")["P"].sampling]
    assert sampling.n_samples == 5
    assert [sampling.time(i) for i in range(5)] == pytest.approx([11 / 25, 12 / 25, 13 / 25, 14 / 25, 15 / 25])


def test_static_curves_have_one_sample_and_no_time(tmp_path):
    with AlembicWriter(tmp_path / "hair.abc") as file:
        curves = file.add_curves("Hair", COUNTS, is_animated=False)
        curves.write(frames()[0])
        with pytest.raises(InputError, match="takes one sample"):
            curves.write(frames()[1])
    archive = Archive(tmp_path / "hair.abc")
    assert len(archive.samplings) == 1
    geom = geometry(tmp_path / "hair.abc")
    assert (geom["P"].n_samples, geom["P"].sampling, geom["P"].is_constant) == (1, 0, True)


def test_axes_of_unreal_are_centimetres_and_left_handed(tmp_path):
    points = frames(1)
    write(tmp_path / "hair.abc", points, axes=UNREAL)
    geom = geometry(tmp_path / "hair.abc")
    assert np.allclose(geom["P"].sample(0), points[0] * [100, -100, 100], rtol=1e-6)
    assert np.allclose(geom["width"].sample(0), 0.1, rtol=1e-6)
    assert np.array_equal(Y_UP.apply(np.float32([[1, 2, 3]])), [[1, 3, -2]])


@pytest.mark.parametrize("pattern", ["a", "ab", "aaaa", "aabbb", "abbba", "abcab", "aaabcc"])
def test_repeated_samples_are_stored_once_and_read_in_order(tmp_path, pattern):
    points = dict(zip("abc", frames(3)))
    write(tmp_path / "hair.abc", [points[letter] for letter in pattern])
    property_ = geometry(tmp_path / "hair.abc")["P"]
    assert property_.n_samples == len(pattern)
    for i, letter in enumerate(pattern):
        assert np.array_equal(property_.sample(i)[:, 0], points[letter][:, 0])
    content = (tmp_path / "hair.abc").read_bytes()
    for letter in set(pattern):
        assert content.count(Y_UP.apply(points[letter]).tobytes()) == 1


def test_a_long_animation_of_still_hair_is_small(tmp_path):
    write(tmp_path / "short.abc", [frames(1)[0]] * 2)
    write(tmp_path / "long.abc", [frames(1)[0]] * 300)
    assert (tmp_path / "long.abc").stat().st_size - (tmp_path / "short.abc").stat().st_size < 50


@pytest.mark.parametrize("n_samples", [254, 255, 256, 300])
def test_many_samples_need_wider_numbers(tmp_path, n_samples):
    moving = frames(1) + np.arange(n_samples, dtype=np.float32)[:, None, None]
    write(tmp_path / "hair.abc", moving)
    geom = geometry(tmp_path / "hair.abc")
    assert geom["P"].n_samples == n_samples
    assert np.array_equal(geom["P"].sample(n_samples - 1)[:, 0], moving[-1, :, 0])
    assert geom.names() == [".selfBnds", "P", "nVertices", "curveBasisAndType", "width"]


def test_attributes_of_each_scope_and_type(tmp_path):
    rng = np.random.default_rng(0)
    params = [
        GeomParam("groom_guide", "con", np.array([1], np.int16)),
        GeomParam("groom_name", "con", ["Fäden"]),
        GeomParam("names", "uni", ["a", "", "ccc"]),
        GeomParam("groom_uv", "uni", rng.random((3, 2)).astype(np.float32), "vector"),
        GeomParam("ids", "uni", np.array([3, 2**31 - 1, 0], np.int32)),
        GeomParam("groom_color", "vtx", rng.random((12, 3)).astype(np.float32), "rgb"),
        GeomParam("exact", "vtx", rng.random(12)),
        GeomParam("flags", "vtx", rng.random(12) > 0.5),
    ]
    write(tmp_path / "hair.abc", frames(2), params=params)
    found = geometry(tmp_path / "hair.abc")[".arbGeomParams"]
    assert found.names() == [param.name for param in params]
    for param in params:
        values = found[param.name].sample()
        same = values == list(param.values) if isinstance(values, list) else np.array_equal(values, param.values)
        assert same, param.name
        assert found[param.name].metadata["geoScope"] == param.scope
        assert found[param.name].metadata["isGeomParam"] == "true"
    assert found["groom_guide"].metadata["podName"] == "int16_t"
    assert (found["groom_uv"].metadata["podExtent"], found["groom_uv"].extent) == ("2", 2)
    assert found["groom_color"].metadata["interpretation"] == "rgb"
    assert found["flags"].metadata["podName"] == "bool_t"


def test_velocities_and_widths_that_change(tmp_path):
    points, widths = frames(3), np.random.default_rng(1).random((3, 12)).astype(np.float32)
    with AlembicWriter(tmp_path / "hair.abc", axes=UNREAL) as file:
        curves = file.add_curves("Hair", COUNTS, is_linear=False)
        for i in range(3):
            curves.write(points[i], widths[i] if i != 1 else None, velocities=points[i])
    geom = geometry(tmp_path / "hair.abc")
    assert np.allclose(geom[".velocities"].sample(2), points[2] * [100, -100, 100], rtol=1e-6)
    assert np.allclose(geom["width"].sample(1), widths[0] * 100, rtol=1e-6)
    assert np.allclose(geom["width"].sample(2), widths[2] * 100, rtol=1e-6)
    assert np.array_equal(geom["curveBasisAndType"].sample(0), [0, 0, 3, 3])


@pytest.mark.parametrize(("n_widths", "scope"), [(1, "con"), (3, "uni"), (12, "vtx")])
def test_scope_of_widths(tmp_path, n_widths, scope):
    write(tmp_path / "hair.abc", frames(1), widths=np.ones(n_widths, np.float32))
    assert geometry(tmp_path / "hair.abc")["width"].metadata["geoScope"] == scope


def test_objects_below_one_transform(tmp_path):
    with AlembicWriter(tmp_path / "hair.abc") as file:
        top = file.add_transform("groom", {"major": np.int16(1), "tool": "Hairloom 0.1", "note": ""})
        for name in ("a", "b", "a"):
            file.add_curves(name, COUNTS, below=top).write(frames(1)[0])
    objects = list(Archive(tmp_path / "hair.abc").top.walk())
    assert [o.path for o in objects] == ["", "/groom", "/groom/a", "/groom/b", "/groom/a_1"]
    noted = objects[1].properties[".xform"][".userProperties"]
    assert [noted[n].sample()[0] for n in ("major", "tool", "note")] == [1, "Hairloom 0.1", ""]


def test_the_same_content_gives_the_same_bytes(tmp_path):
    write(tmp_path / "a.abc", frames())
    write(tmp_path / "b.abc", frames())
    assert (tmp_path / "a.abc").read_bytes() == (tmp_path / "b.abc").read_bytes()


class FullDisk:
    def __init__(self, stream, room: int) -> None:
        self.stream, self.room = stream, room

    def write(self, data):
        self.room -= len(data)
        if self.room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self.stream.write(data)

    def __getattr__(self, name):
        return getattr(self.stream, name)


@pytest.mark.parametrize("room", [10, 300, 1900])
def test_a_full_disk_leaves_the_old_file(tmp_path, room):
    path = tmp_path / "hair.abc"
    path.write_bytes(b"old")
    with pytest.raises(FileError, match="disk is full; choose another place"), AlembicWriter(path) as file:
        file._archive._stream = FullDisk(file._stream, room)
        curves = file.add_curves("Hair", COUNTS)
        for frame in frames():
            curves.write(frame)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_leaves_no_file(tmp_path):
    points, path = frames(1)[0], tmp_path / "hair.abc"
    nan = np.full_like(points, np.nan)
    cases = [
        (lambda f: f.add_curves("Hair", COUNTS).write(points[:-1]), "points must be float32"),
        (lambda f: f.add_curves("Hair", COUNTS).write(points.astype(np.float64)), "points must be float32"),
        (lambda f: f.add_curves("Hair", COUNTS).write(nan), "NaN"),
        (lambda f: f.add_curves("Hair", COUNTS).write(points, np.ones(5, np.float32)), "one a strand or one a point"),
        (lambda f: f.add_curves("Hair", COUNTS).write(points, -np.ones(12, np.float32)), "0 or more"),
        (lambda f: f.add_curves("Hair", np.array([3, 0], np.int32)), "must have a point"),
        (lambda f: f.add_curves("Hair", np.array([3, -7], np.int32)), "must have a point"),
        (lambda f: f.add_curves("Hair", np.full(2, 2**31 - 1, np.int32)), "too many"),
        (lambda f: f.add_curves("a/b", COUNTS), "no name"),
        (lambda f: f.add_curves("", COUNTS), "no name"),
        (lambda f: f.add_curves("H", COUNTS, params=[GeomParam("a", "uni", np.ones(2))]), "needs 3 values"),
        (lambda f: f.add_curves("H", COUNTS, params=[GeomParam("a", "con", [1j])]), "text must not|type"),
        (lambda f: f.add_curves("H", COUNTS, params=[GeomParam("a", "con", ["b\0c"])]), "NUL"),
        (lambda f: f.add_curves("H", COUNTS, params=[GeomParam("a", "face", ["b"])]), "con, uni or vtx"),
        (lambda f: f.add_curves("H", COUNTS, params=[GeomParam("a", "con", np.array([np.inf]))]), "NaN"),
        (lambda f: f.add_curves("H", COUNTS, params=[GeomParam("a", "con", np.array([1j]))]), "no type complex"),
    ]
    for act, words in cases:
        with pytest.raises((HairloomError, TypeError), match=words), AlembicWriter(path) as file:
            act(file)
        assert list(tmp_path.iterdir()) == []
    for options in ({"fps": 0.0}, {"fps": float("nan")}, {"frame_start": float("inf")}):
        with pytest.raises(InputError):
            AlembicWriter(path, **options)


# --- damaged and hostile files -----------------------------------------------------------------------------------


def read_all(path) -> int:
    """Look at everything in a file; how many properties it has."""
    count, waiting = 0, []
    for found in Archive(path).top.walk():
        waiting = [found.properties]
        while waiting:
            owner = waiting.pop()
            for item in owner.properties():
                count += 1
                if item.is_compound:
                    waiting.append(item)
                elif item.n_samples:
                    item.sample(0)
                    item.sample(item.n_samples - 1)
    return count


def test_any_damage_is_a_file_error(tmp_path):
    write(tmp_path / "hair.abc", frames(2), params=[GeomParam("name", "con", ["text"])])
    content = (tmp_path / "hair.abc").read_bytes()
    assert read_all(tmp_path / "hair.abc") == 10
    rng, path, n_refused = np.random.default_rng(0), tmp_path / "bad.abc", 0
    for _ in range(400):
        bad = bytearray(content)
        for place in rng.integers(0, len(bad), rng.integers(1, 4)):
            bad[place] = rng.integers(0, 256)
        path.write_bytes(bad if rng.random() < 0.7 else bad[: rng.integers(0, len(bad))])
        try:
            read_all(path)
        except FileError as error:
            n_refused += 1
            assert "bad.abc" in str(error)
            assert "\n" not in str(error)
    assert n_refused > 50


@pytest.mark.parametrize("size", [0, 2**40, 2**62, 2**63 - 1])
def test_absurd_sizes_take_no_memory(tmp_path, size):
    path = tmp_path / "bad.abc"
    body = struct.pack("<QQQ", 6, *(2 * (16 + 56 | 1 << 63,))) + bytes(32)
    path.write_bytes(b"Ogawa\xff\x00\x01" + struct.pack("<Q", 16) + body + struct.pack("<Q", size) + bytes(64))
    with pytest.raises(FileError):
        read_all(path)
    path.write_bytes(b"Ogawa\xff\x00\x01" + struct.pack("<QQ", 16, size) + bytes(64))
    with pytest.raises(FileError):
        read_all(path)


def test_an_object_that_is_its_own_child_is_refused(tmp_path):
    with (tmp_path / "ring.abc").open("wb") as stream:
        writer = ArchiveWriter(stream)
        node = writer.top.child("a", {})
        node.children.append(writer.top.child("b", {}))
        writer.finish({})
    content = bytearray((tmp_path / "ring.abc").read_bytes())
    # the place of b's group, wherever a group names it, becomes that of a's
    groups = {}
    archive = Archive(tmp_path / "ring.abc")
    a = archive.top.children()[0]
    b_place = a._places[1]
    a_place = archive.top._places[1]
    for at in range(16, len(content) - 8):
        if struct.unpack_from("<Q", content, at)[0] == b_place:
            groups[at] = a_place
    for at, place in groups.items():
        struct.pack_into("<Q", content, at, place)
    (tmp_path / "ring.abc").write_bytes(content)
    with pytest.raises(FileError, match=r"nested too deep|form a ring"):
        read_all(tmp_path / "ring.abc")


def test_files_of_other_kinds(tmp_path):
    path = tmp_path / "other.abc"
    for content, words in (
        (b"", "no Alembic"),
        (b"\x89HDF\r\n\x1a\n" + bytes(64), "HDF5"),
        (b"Ogawa\0\0\1" + bytes(8), "to its end"),
    ):
        path.write_bytes(content)
        with pytest.raises(FileError, match=words):
            Archive(path)
    with pytest.raises(FileError, match="no such file"):
        Archive(tmp_path / "missing.abc")
