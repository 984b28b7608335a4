"""The jobs `transfer_details` and `save_detail` as the add-on calls them: caches, attributes, reports."""

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.geometry.head import default_head
from hairloom.geometry.roots import scatter_roots
from hairloom.geometry.scalp_space import fit_scalp_space, unroot_strands
from hairloom.registry import run_job
from hairloom.synthesis.details import read_detail
from hairloom.synthesis.pipeline import place_roots
from hairloom.types import Head, StrandSet

ANALYSIS = {"n_samples": 24, "hierarchy": {"n_levels": 2, "wisps": {"n_wisps": 20, "error_threshold": 0.05}}}
DETAIL = {"levels": [0], "max_subdivision": 1}


def groom(head, n_strands, length, wave, seed):
    space = fit_scalp_space(head)
    placed = place_roots(space, scatter_roots(head, head.scalp, n_strands, seed), 24)
    t = np.linspace(0, 1, 24)[None, :, None]
    wisp = np.floor(placed.uv * 5).sum(axis=1)[:, None, None]
    points = length * t * np.array([0.3, 0.8, 0.1]) + wave * t * np.sin(15 * t + wisp) * np.array([0.2, 0.0, 1.0])
    strands = unroot_strands(placed.with_points(points.astype(np.float32)), space)
    radius = np.tile(np.linspace(1, 0, 24, dtype=np.float32), n_strands)
    return StrandSet(strands.points, strands.offsets, {"radius": radius}, {"id": np.arange(n_strands, dtype=np.int32)})


@pytest.fixture(scope="module")
def inputs():
    head = default_head()
    wide = Head(head.vertices * np.float32(1.5), head.triangles, head.scalp, head.corner_uv)
    return {
        "detail_strands": groom(wide, 250, 0.5, 0.05, 0),
        "detail_head": wide,
        "base_strands": groom(head, 200, 1.0, 0.0, 1),
        "base_head": head,
    }


@pytest.fixture(scope="module")
def outputs(inputs):
    return run_job("transfer_details", inputs, {"analysis": ANALYSIS, "detail": DETAIL})


def test_strands_keep_their_roots_order_and_attributes(inputs, outputs):
    made, base = outputs["strands"], inputs["base_strands"]
    np.testing.assert_allclose(made.roots, base.roots, atol=1e-6)
    assert (made.strand_attributes["id"] == base.strand_attributes["id"]).all()
    assert (made.point_counts == 24).all()
    np.testing.assert_allclose(made.point_attributes["radius"], base.point_attributes["radius"], atol=1e-5)
    report = outputs["report"]
    assert report["strands"] == 200 and report["points"] == 24
    for measure in ("details", "curvature"):
        assert report["distance_after"][measure] < 0.75 * report["distance_before"][measure]


def test_cached_hierarchies_give_the_same_and_need_no_heads(inputs, outputs):
    cached = {name: outputs[name] for name in ("detail_hierarchy", "base_hierarchy", "base_space")}
    params = {"analysis": ANALYSIS, "detail": DETAIL, "compare": False}
    again = run_job("transfer_details", cached | {"base_strands": inputs["base_strands"]}, params)
    assert again["strands"].points.tobytes() == outputs["strands"].points.tobytes()
    assert "distance_after" not in again["report"]


def test_a_base_is_clustered_to_fit_a_saved_detail(inputs, outputs, tmp_path):
    path = tmp_path / "detail.npz"
    saved = run_job(
        "save_detail",
        {"hierarchy": outputs["detail_hierarchy"]},
        {"path": str(path), "name": "Waves", "n_strands": 100},
    )
    detail = read_detail(path)
    assert detail.name == "Waves" and saved["report"]["levels"] == [h.n_strands for h in detail.hierarchy.levels]
    three = {"n_samples": 64, "hierarchy": {"n_levels": 3, "wisps": {"n_wisps": 20}}}
    base = {name: inputs[name] for name in ("base_strands", "base_head")}
    made = run_job("transfer_details", base | {"detail_hierarchy": detail.hierarchy}, {"analysis": three})
    assert made["base_hierarchy"].n_levels == 2 and made["base_hierarchy"].levels[0].n_points == 24


def test_save_detail_clusters_strands_that_are_not(inputs):
    small = run_job(
        "save_detail",
        {"strands": inputs["detail_strands"], "head": inputs["detail_head"]},
        {"analysis": ANALYSIS, "n_strands": 80},
    )
    assert small["hierarchy"].levels[0].n_strands <= 80


def test_bad_input_is_refused(inputs, outputs):
    cached = {name: outputs[name] for name in ("detail_hierarchy", "base_hierarchy", "base_space")}
    with pytest.raises(InputError, match="'base_strands' is missing"):
        run_job("transfer_details", cached, {})
    with pytest.raises(InputError, match="'detail_strands' is missing"):
        run_job("transfer_details", {"base_strands": inputs["base_strands"]}, {})
    with pytest.raises(InputError, match="has 250 strands, its hierarchy 200"):
        run_job("transfer_details", cached | {"base_strands": inputs["detail_strands"]}, {})
    with pytest.raises(InputError, match="needs a hierarchy"):
        run_job("save_detail", {}, {})
    with pytest.raises(InputError, match="strength is 9"):
        run_job("transfer_details", inputs, {"detail": {"strength": 9.0}})
