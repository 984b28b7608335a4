"""The .obj mesh reader."""

from __future__ import annotations

import numpy as np
import pytest
from hairloom.errors import FileError
from hairloom.io.mesh import read_mesh, read_mesh_file
from hairloom.io.units import Units

AS_IS = Units()
MESH = b"""# two groups
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0.5 2 0
vt 0 0
vt 1 0 0
vt 1 1
vt 0 1
g quad first
f 1/1/1 2/2/1 3/3/1 4/4/1
g pentagon
f -5 -4//1 -3 -1 -2
o other
v 9 9 9
v 8 8 8
f 6 7 1
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.obj"
    path.write_bytes(MESH)
    return path


def test_polygons_become_fans(path):
    mesh = read_mesh_file(path, AS_IS)
    expected = [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 4], [0, 4, 3], [5, 6, 0]]
    assert mesh.triangles.tolist() == expected and mesh.polygon_in_file.tolist() == [0, 0, 1, 1, 1, 2]
    assert mesh.vertices.dtype == np.float32 and mesh.triangles.dtype == np.int32 and mesh.corner_uv is None
    np.testing.assert_array_equal(mesh.vertices[6], [8, 8, 8])


def test_a_group_brings_its_own_vertices_and_uv(path):
    mesh = read_mesh_file(path, AS_IS, "first")
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]] and len(mesh.vertices) == 4
    np.testing.assert_array_equal(mesh.corner_uv, [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]])
    other = read_mesh_file(path, AS_IS, "other")
    assert other.vertex_in_file.tolist() == [0, 5, 6] and other.polygon_in_file.tolist() == [2]
    np.testing.assert_array_equal(other.vertices[other.triangles[0]], [[9, 9, 9], [8, 8, 8], [0, 0, 0]])
    with pytest.raises(FileError, match=r"'nose'.*first, other, pentagon, quad"):
        read_mesh(path, AS_IS, "nose")


def test_units_default_to_y_up(path):
    vertices, _, _ = read_mesh(path)
    np.testing.assert_array_equal(vertices[4], [0.5, 0, 2])
    vertices, _, _ = read_mesh(path, Units(0.01, "Y"))
    np.testing.assert_allclose(vertices[4], [0.005, 0, 0.02])


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b"f 6 7 1", b"f 6 7 8", "names vertex 8, but there are 7"),
        (b"f 6 7 1", b"f 6 7 0", "names vertex 0"),
        (b"f 6 7 1", b"f 6 7", "needs 3 vertices"),
        (b"f 6 7 1", b"f 6 7 1.5", "whole number"),
        (b"f 6 7 1", b"f 6 7 /1", "stray|no number|whole"),
        (b"f 6 7 1", b"f 6 7 one", "no number"),
        (b"f -5", b"f -8", "names vertex -8"),
        (b"v 9 9 9", b"v 9 9", "needs 3 numbers"),
        (b"v 9 9 9", b"v 9 nan 9", "NaN"),
        (b"v 9 9 9", b"v 9 1e39 9", "too far"),
        (b"f", b"#", "no faces"),
    ],
)
def test_damaged_meshes_are_refused(path, old, new, reason):
    path.write_bytes(MESH.replace(old, new))
    with pytest.raises(FileError, match=rf"a\.obj.*({reason})"):
        read_mesh(path, AS_IS)


def test_bad_texture_coordinates_are_refused(path):
    quad = MESH[: MESH.index(b"g pentagon")]
    path.write_bytes(quad.replace(b"4/4/1", b"4/5/1"))
    with pytest.raises(FileError, match="texture coordinate 5"):
        read_mesh(path, AS_IS)
    path.write_bytes(quad.replace(b"4/4/1", b"4/-1/1"))
    np.testing.assert_array_equal(read_mesh(path, AS_IS)[2][1, 2], [0, 1])


def test_other_suffixes_are_refused(tmp_path):
    with pytest.raises(FileError, match=r"\.obj"):
        read_mesh(tmp_path / "a.fbx")
