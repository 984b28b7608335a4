"""The real grooms and heads load with the counts that their README states."""

from __future__ import annotations

import numpy as np
import pytest
from hairloom.geometry.cleanup import CleanUpParams, CleanUpReport, clean_up
from hairloom.geometry.head import HeadSurface, find_scalp, read_head, sphere_head
from hairloom.geometry.strands import join_strands, strand_lengths
from hairloom.io.mesh import read_mesh_file
from hairloom.io.strands import Units, read_strands, read_strands_report, write_strands

# name, strands, points a strand (shared/data/README.md)
GROOMS = [
    ("ponytail/front_top.tfx", 876, 16),
    ("ponytail/side.tfx", 3066, 16),
    ("ponytail/back.tfx", 517, 16),
    ("ponytail/tail.tfx", 474, 16),
    ("sintel/hair.tfx", 11_400, 16),
    ("sintel_lite/guides.tfx", 228, 32),
    ("ratboy/Ratboy_mohawk.tfx", 2_228, 32),
    ("fur/bear.tfx", 48_113, 4),
    ("fur/TestHair1.tfx", 10_027, 4),
]
PONYTAIL = Units(0.0035, "Y", "-Z")  # the head is about 70 units high
MESHES = [
    ("makehuman/base.obj", 19_158, 18_486),
    ("sintel/head.obj", 3_046, 5_952),
    ("ponytail/head.obj", 6_654, 6_584),
    ("ict_facekit/head.obj", 26_719, 26_384),
]


@pytest.mark.parametrize(("name", "n_strands", "n_points"), GROOMS)
def test_grooms_have_their_strands(data_dir, name, n_strands, n_points):
    strands, report = read_strands_report(data_dir / name)
    assert strands.n_strands == report.n_strands_in_file == n_strands
    assert (strands.point_counts == n_points).all()
    assert report.dropped.n_empty == report.dropped.n_non_finite == 0


@pytest.mark.parametrize(("name", "n_vertices", "n_polygons"), MESHES)
def test_meshes_have_their_vertices_and_polygons(data_dir, name, n_vertices, n_polygons):
    mesh = read_mesh_file(data_dir / name)
    assert len(mesh.vertices) == n_vertices and mesh.polygon_in_file.max() + 1 == n_polygons


def test_every_makehuman_hairstyle_loads(data_dir):
    for path in sorted((data_dir / "makehuman" / "hair").glob("*.obj")):
        mesh = read_mesh_file(path, Units(0.1, "Y"))
        assert len(mesh.triangles) > 500 and mesh.corner_uv is not None


def test_the_makehuman_scalp_region_names_polygons_of_the_body(data_dir):
    """The region's polygons use its vertices and no others: polygon and vertex numbers are the file's."""
    body = read_mesh_file(data_dir / "makehuman" / "base.obj", Units(0.1, "Y"), "body")
    with np.load(data_dir / "makehuman" / "scalp_region.npz", allow_pickle=False) as region:
        on_scalp = np.isin(body.polygon_in_file, region["poly_idx"])
        used = np.unique(body.vertex_in_file[body.triangles[on_scalp]])
        np.testing.assert_array_equal(used, np.sort(region["vert_idx"]))
    assert body.vertices[body.triangles[on_scalp]][..., 2].min() > 0.5  # the head is on top: metres, z up


@pytest.mark.parametrize(
    ("head", "hair", "units", "median"),
    [
        ("sintel/head.obj", "sintel/hair.tfx", Units(1.0, "Y"), 0.0004),
        ("sintel_lite/head.obj", "sintel_lite/guides.tfx", Units(0.1, "Y"), 0.005),
        ("ponytail/head.obj", "ponytail/side.tfx", PONYTAIL, 0.08 * 0.0035),
    ],
)
def test_grooms_sit_on_their_heads(data_dir, head, hair, units, median):
    surface = HeadSurface(read_head(data_dir / head, units))
    roots = read_strands(data_dir / hair, units=units).roots
    distance = np.linalg.norm(surface.closest_points(roots)[0] - roots, axis=1)
    assert np.median(distance) < 1.3 * median  # the README rounds to one digit


def test_the_pinned_points_of_version_4_are_the_roots(data_dir):
    strands = read_strands(data_dir / "sintel" / "hair.tfx")
    assert (strands.point_attributes["inverse_mass"][strands.offsets[:-1]] == 0).all()


@pytest.mark.parametrize("suffix", [".hair", ".data", ".tfx", ".ply", ".obj", ".npz"])
def test_a_real_groom_survives_every_format(data_dir, tmp_path, suffix):
    strands = read_strands(data_dir / "sintel_lite" / "guides.tfx", units=Units(0.1, "Y"))
    path = tmp_path / f"guides{suffix}"
    write_strands(path, strands)
    np.testing.assert_array_equal(read_strands(path).points, strands.points)


def test_clean_up_of_sintel_keeps_nearly_all(data_dir):
    units = Units(1.0, "Y")
    strands = read_strands(data_dir / "sintel" / "hair.tfx", units=units)
    head = find_scalp(read_head(data_dir / "sintel" / "head.obj", units), strands.roots)
    left, report = clean_up(strands, head)
    assert left.n_strands > 0.99 * strands.n_strands and report.n_dropped == strands.n_strands - left.n_strands
    surface = HeadSurface(head)
    assert np.abs(surface.signed_distance(left.roots)).max() < 1e-6  # on the scalp, up to float32 at 1.6 m
    assert surface.signed_distance(left.points).min() > -1.01e-4  # the tolerance of CleanUpParams, and rounding
    assert clean_up(left, head)[1] == CleanUpReport()


def test_clean_up_of_the_ponytail_drops_the_tail_that_starts_in_the_air(data_dir):
    parts = [
        read_strands(data_dir / "ponytail" / f"{name}.tfx", units=PONYTAIL) for name in ("front_top", "side", "tail")
    ]
    strands = join_strands(parts)
    head = find_scalp(read_head(data_dir / "ponytail" / "head.obj", PONYTAIL), strands.roots[: 876 + 3066])
    left, report = clean_up(strands, head)
    assert report.n_far_from_scalp >= 400 and left.n_strands > 0.95 * (876 + 3066)


def test_clean_up_drops_the_stubs_of_ratboy(data_dir):
    """Its two strands of under a tenth of a millimetre; it has no head, so one far off stands in."""
    strands = read_strands(data_dir / "ratboy" / "Ratboy_mohawk.tfx")
    params = CleanUpParams(max_root_distance=10.0, snap_roots=False, push_out=False, max_inside_share=1.0)
    left, report = clean_up(strands, sphere_head(0.1, (0.0, 0.0, 5.0)), params)
    assert report.n_too_short == 2 == (strand_lengths(strands) < params.min_length).sum()
    assert left.n_strands == 2_226 - report.n_duplicates
