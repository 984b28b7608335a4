"""The command line as a pipeline person meets it: results, exit status, one line for bad input, no half files."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hairloom.cli import main
from hairloom.geometry.strands import from_dense
from hairloom.io.bundle import read_bundle
from hairloom.io.strands import read_strands, write_strands


@pytest.fixture(scope="module")
def groom(tmp_path_factory):
    """300 strands on Hairloom's own head, as a file."""
    from hairloom.geometry.head import default_head
    from hairloom.geometry.roots import scatter_roots

    head = default_head()
    roots = scatter_roots(head, head.scalp, 300, 0).points
    middle = roots.mean(axis=0) - [0, 0, 0.05]
    out = (roots - middle) / np.linalg.norm(roots - middle, axis=1, keepdims=True)
    t = np.linspace(0, 1, 12)[None, :, None]
    path = tmp_path_factory.mktemp("groom") / "groom.npz"
    points = roots[:, None] + 0.1 * t * out[:, None] - 0.05 * t**2 * np.array([0.0, 0.2, 1.0])
    write_strands(path, from_dense(points.astype(np.float32)))
    return path


def run_json(capsys, *arguments):
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_info(groom, capsys):
    report = run_json(capsys, "info", groom)
    assert report["strands"] == 300 and report["points_per_strand"] == [12, 12]
    assert report["peak_memory_mb"] > 10 and report["seconds"]["read"] >= 0


def test_convert_there_and_back(groom, tmp_path, capsys):
    run_json(capsys, "convert", groom, tmp_path / "a.hair")
    run_json(capsys, "convert", tmp_path / "a.hair", tmp_path / "b.npz")
    np.testing.assert_allclose(read_strands(tmp_path / "b.npz").points, read_strands(groom).points, atol=1e-6)


def test_cluster(groom, tmp_path, capsys):
    report = run_json(capsys, "cluster", groom, tmp_path / "wisps.npz", "--k0", 20, "--levels", 3)
    hierarchy = read_bundle(tmp_path / "wisps.npz")["hierarchy"]
    assert [level.n_strands for level in hierarchy.levels[1:]] == report["wisps"]
    assert report["largest_error"] <= 0.2


def test_synthesize_with_count_seed_and_region(groom, tmp_path, capsys):
    from hairloom.geometry.head import default_head

    head = default_head()
    left = head.scalp & (head.vertices[head.triangles].mean(axis=1)[:, 0] > 0)
    np.savez(tmp_path / "left.npz", mask=left)
    out = tmp_path / "new.npz"
    report = run_json(
        capsys, "synthesize", groom, out, "--strands", 120, "--k0", 20, "--levels", 2, "--region",
        tmp_path / "left.npz", "--compare",
    )  # fmt: skip
    made = read_strands(out)
    assert made.n_strands == report["strands"] == 120
    assert (made.roots[:, 0] > -1e-3).all()
    assert {"cluster", "texture", "transfer", "write"} <= set(report["seconds"])
    assert 0 <= report["style"]["copied_share"] <= 1
    run_json(capsys, "synthesize", groom, tmp_path / "again.npz", "--strands", 120, "--k0", 20, "--levels", 2,
             "--region", tmp_path / "left.npz")  # fmt: skip
    assert read_strands(tmp_path / "again.npz").points.tobytes() == made.points.tobytes()


SMALL_WISPS = ("--k0", 20)


@pytest.fixture(scope="module")
def wavy_groom(groom):
    """The groom's roots with 200 strands that are longer and wavy."""
    strands = read_strands(groom)
    points = strands.points.reshape(300, 12, 3)[:200]
    t = np.linspace(0, 1, 12)[None, :, None]
    path = groom.with_name("wavy.npz")
    made = points[:, :1] + 1.5 * (points - points[:, :1]) + 0.004 * t * np.sin(14 * t) * np.array([1.0, -1.0, 0.0])
    write_strands(path, from_dense(made.astype(np.float32), {"group": np.arange(200, dtype=np.int32)}))
    return path


def test_transfer_from_a_groom_and_from_its_saved_detail(groom, wavy_groom, tmp_path, capsys):
    out = tmp_path / "out.npz"
    report = run_json(capsys, "transfer", groom, wavy_groom, out, *SMALL_WISPS, "--hierarchy-levels", 2, "--seed", 1)
    made, base = read_strands(out), read_strands(wavy_groom)
    assert made.n_strands == report["strands"] == 200
    np.testing.assert_allclose(made.roots, base.roots, atol=1e-6)
    assert (made.strand_attributes["group"] == np.arange(200)).all()
    assert {"cluster detail", "cluster base", "transfer", "write"} <= set(report["seconds"])
    assert all(0 <= report[key]["curvature"] <= 1 for key in ("distance_before", "distance_after"))
    saved = tmp_path / "detail.npz"
    said = run_json(capsys, "detail", groom, saved, *SMALL_WISPS, "--levels", 2, "--seed", 1, "--strands", 0)
    assert said["levels"][0] == 300
    run_json(capsys, "transfer", saved, wavy_groom, tmp_path / "again.npz", *SMALL_WISPS, "--seed", 1)
    assert read_strands(tmp_path / "again.npz").points.tobytes() == made.points.tobytes()


def test_transfer_of_nothing_gives_the_base_back(groom, wavy_groom, tmp_path, capsys):
    for index, nothing in enumerate((("--strength", 0), ("--levels",))):
        out = tmp_path / f"{index}.npz"
        run_json(capsys, "transfer", groom, wavy_groom, out, *SMALL_WISPS, *nothing)
        made, base = read_strands(out), read_strands(wavy_groom)
        tips = base.offsets[1:] - 1
        np.testing.assert_allclose(made.points[made.offsets[1:] - 1], base.points[tips], atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["info", "no-such-file.hair"], "no-such-file.hair"),
        (["info", "{groom}", "--units", "furlong"], "furlong"),
        (["convert", "{groom}", "{tmp}/out.xyz"], "xyz"),
        (["convert", "{groom}", "{tmp}/no/such/folder/out.hair"], "folder"),
        (["cluster", "{groom}", "{tmp}/o.npz", "--k0", "5000"], "5000"),
        (["cluster", "{groom}", "{tmp}/o.npz", "--epsilon", "-1"], "-1"),
        (["cluster", "{groom}", "{tmp}/o.npz", "--levels", "9"], "9"),
        (["synthesize", "{groom}", "{tmp}/o.npz", "--head", "missing.obj"], "missing.obj"),
        (["synthesize", "{groom}", "{tmp}/o.npz", "--strands", "-4"], "-4"),
        (["transfer", "{groom}", "{groom}", "{tmp}/o.npz", "--strength", "3"], "strength is 3"),
        (["transfer", "{groom}", "{groom}", "{tmp}/o.npz", "--levels", "5"], "levels is (5,)"),
        (["transfer", "none.npz", "{groom}", "{tmp}/o.npz"], "none.npz"),
        (["transfer", "{groom}", "{groom}", "{tmp}/o.npz", "--head-detail", "missing.obj"], "missing.obj"),
        (["detail", "{groom}", "{tmp}/o.npz", "--k0", "5000"], "5000"),
        (["bench", "no-such-job"], "no-such-job"),
    ],
)
def test_bad_input_is_one_line_and_status_2(groom, tmp_path, capsys, arguments, words):
    filled = [a.format(groom=groom, tmp=tmp_path) for a in arguments]
    assert main(filled) == 2
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == 1 and "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_a_region_that_does_not_fit_is_refused(groom, tmp_path, capsys):
    np.savez(tmp_path / "r.npz", triangles=np.array([10**7]))
    assert (
        main(["synthesize", str(groom), str(tmp_path / "o.npz"), "--k0", "20", "--region", str(tmp_path / "r.npz")])
        == 2
    )
    assert "10000000" in capsys.readouterr().err
    assert not (tmp_path / "o.npz").exists()


def test_python_m_hairloom(groom):
    done = subprocess.run(
        [sys.executable, "-m", "hairloom", "info", str(groom), "--json"], capture_output=True, text=True, check=True
    )
    assert json.loads(done.stdout)["strands"] == 300
