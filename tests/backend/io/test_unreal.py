"""io.unreal: names, types and scopes of Unreal's groom schema, closest guides, and that a cache keeps the order."""

from __future__ import annotations

import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.io.alembic import Y_UP
from hairloom.io.ogawa_read import Archive
from hairloom.io.unreal import UnrealGroom, closest_guides, write_unreal

N_STRANDS = 30


def example(seed: int = 0) -> tuple[UnrealGroom, np.ndarray]:
    rng = np.random.default_rng(seed)
    counts = rng.integers(2, 6, N_STRANDS).astype(np.int32)
    n_points = int(counts.sum())
    is_guide = np.zeros(N_STRANDS, np.bool_)
    is_guide[::5] = True
    groom = UnrealGroom(
        counts,
        rng.random(n_points).astype(np.float32) * 1e-4,
        is_guide,
        (np.arange(N_STRANDS) >= 20).astype(np.int32) * 7,
        group_names={0: "scalp"},
        root_uv=rng.random((N_STRANDS, 2)).astype(np.float32),
        color=rng.random((n_points, 3)).astype(np.float32),
        properties="young=3.9e9",
    )
    return groom, rng.normal(size=(n_points, 3)).astype(np.float32)


def read(path) -> dict[str, object]:
    return {o.path: o.properties for o in Archive(path).top.walk()}


def test_names_types_and_scopes(tmp_path):
    groom, rest = example()
    write_unreal(tmp_path / "groom.abc", groom, rest, tool="Hairloom 1")
    objects = read(tmp_path / "groom.abc")
    assert list(objects) == ["", "/groom", *(f"/groom/{n}" for n in ("guides_0", "strands_0", "guides_7", "strands_7"))]
    noted = objects["/groom"][".xform"][".userProperties"]
    assert {n: noted[n].sample()[0] for n in noted.names()} == {
        "groom_version_major": 1,
        "groom_version_minor": 5,
        "groom_tool": "Hairloom 1",
        "groom_properties": "young=3.9e9",
    }
    wanted = {  # name: (pod, extent, scope)
        "groom_guide": (4, 1, "con"),
        "groom_group_id": (6, 1, "con"),
        "groom_group_name": (12, 1, "con"),
        "groom_id": (6, 1, "uni"),
        "groom_root_uv": (10, 2, "uni"),
        "groom_color": (10, 3, "vtx"),
        "groom_width": (10, 1, "vtx"),
        "groom_closest_guides": (6, 3, "uni"),
        "groom_guide_weights": (10, 3, "uni"),
    }
    params = objects["/groom/strands_7"][".geom"][".arbGeomParams"]
    assert {p.name: (p.pod, p.extent, p.metadata["geoScope"]) for p in params.properties()} == wanted
    assert all(p.kind == 2 for p in params.properties())  # scalar properties are not taken as attributes
    guides = objects["/groom/guides_7"][".geom"][".arbGeomParams"]
    assert set(wanted) - set(guides.names()) == {"groom_closest_guides", "groom_guide_weights"}
    assert [p["groom_guide"].sample()[0] for p in (guides, params)] == [1, 0]
    assert [p["groom_group_id"].sample()[0] for p in (guides, params)] == [7, 7]
    assert params["groom_group_name"].sample() == ["group_7"]
    assert objects["/groom/strands_0"][".geom"][".arbGeomParams"]["groom_group_name"].sample() == ["scalp"]


def test_values_belong_to_their_strands(tmp_path):
    groom, rest = example()
    write_unreal(tmp_path / "groom.abc", groom, rest)
    objects = read(tmp_path / "groom.abc")
    starts = np.concatenate([[0], np.cumsum(groom.counts)])
    guides = np.flatnonzero(groom.is_guide)
    for group in (0, 7):
        for kind, strands in (
            ("strands", np.flatnonzero(groom.groups == group)),
            ("guides", guides[groom.groups[guides] == group]),
        ):
            geom = objects[f"/groom/{kind}_{group}"][".geom"]
            params = geom[".arbGeomParams"]
            points = np.concatenate([np.arange(starts[s], starts[s + 1]) for s in strands])
            assert np.array_equal(geom["nVertices"].sample(), groom.counts[strands])
            # centimetres, y to the other side
            assert np.allclose(geom["P"].sample(), rest[points] * [100, -100, 100], rtol=1e-6)
            assert np.allclose(geom["width"].sample(), groom.widths[points] * 100, rtol=1e-6)
            assert np.array_equal(params["groom_width"].sample(), geom["width"].sample())
            assert np.array_equal(params["groom_root_uv"].sample(), groom.root_uv[strands])
            assert np.array_equal(params["groom_color"].sample(), groom.color[points])


def test_closest_guides_are_ids_of_the_nearest(tmp_path):
    groom, rest = example()
    write_unreal(tmp_path / "groom.abc", groom, rest, axes=Y_UP)
    objects = read(tmp_path / "groom.abc")
    roots = rest[np.cumsum(groom.counts) - groom.counts]
    id_of_guide = {}
    for group in (0, 7):
        params = objects[f"/groom/guides_{group}"][".geom"][".arbGeomParams"]
        strands = [s for s in np.flatnonzero(groom.is_guide) if groom.groups[s] == group]
        id_of_guide |= dict(zip(params["groom_id"].sample().tolist(), strands))
    ids = set(id_of_guide)
    for group in (0, 7):
        params = objects[f"/groom/strands_{group}"][".geom"][".arbGeomParams"]
        ids |= set(params["groom_id"].sample().tolist())
        assert "groom_width" not in params.names()
        for strand, closest, weights in zip(
            np.flatnonzero(groom.groups == group),
            params["groom_closest_guides"].sample(),
            params["groom_guide_weights"].sample(),
        ):
            by_distance = sorted(id_of_guide, key=lambda i: np.linalg.norm(roots[id_of_guide[i]] - roots[strand]))
            assert closest.tolist() == by_distance[:3]
            assert weights.sum() == pytest.approx(1.0, abs=1e-6)
            assert (np.diff(weights) <= 0).all()
    assert len(ids) == N_STRANDS + groom.is_guide.sum()  # no id twice


def test_the_strands_own_guide_is_among_the_three():
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(50, 3)).astype(np.float32)
    guides = np.arange(0, 50, 5, dtype=np.int32)
    own = guides[rng.integers(0, len(guides), 50)]
    closest, weights = closest_guides(roots, guides, own)
    assert (guides[closest] == own[:, None]).any(axis=1).all()
    assert (weights > 0).all()
    nearest, _ = closest_guides(roots, guides)
    assert not (guides[nearest] == own[:, None]).any(axis=1).all()


def test_weights_fall_with_the_square_of_the_distance():
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(40, 3)).astype(np.float32)
    guides = np.arange(0, 40, 4, dtype=np.int32)
    closest, weights = closest_guides(roots, guides)
    for strand in range(1, 40, 4):  # those that are no guides
        distance = np.linalg.norm(roots[guides[closest[strand]]].astype(np.float64) - roots[strand], axis=1)
        wanted = distance**-2.0 / (distance**-2.0).sum()
        assert np.allclose(weights[strand], wanted, rtol=1e-5)
    assert np.allclose(weights[guides, 0], 1.0, atol=1e-4)


@pytest.mark.parametrize("n_guides", [1, 2])
def test_few_guides_are_filled_up_without_weight(n_guides):
    roots = np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32)
    closest, weights = closest_guides(roots, np.arange(n_guides, dtype=np.int32))
    assert closest.shape == weights.shape == (9, 3)
    assert (weights[:, n_guides:] == 0).all()
    assert (closest < n_guides).all()


def test_a_cache_has_the_same_strands_in_the_same_order(tmp_path):
    groom, rest = example()
    moved = [rest + np.float32(0.1 * i) for i in range(4)]
    write_unreal(tmp_path / "groom.abc", groom, rest)
    write_unreal(tmp_path / "cache.abc", groom, rest, iter(moved), fps=30, frame_start=5)
    write_unreal(tmp_path / "guides.abc", groom, rest, iter(moved), guides_only=True)
    still, cache, guides = (read(tmp_path / f"{n}.abc") for n in ("groom", "cache", "guides"))
    assert list(still) == list(cache)
    assert [n for n in guides if "_" in n] == ["/groom/guides_0", "/groom/guides_7"]
    for path in list(still)[2:]:
        a, b = still[path][".geom"], cache[path][".geom"]
        assert np.array_equal(a["nVertices"].sample(), b["nVertices"].sample())
        assert np.array_equal(a[".arbGeomParams"]["groom_id"].sample(), b[".arbGeomParams"]["groom_id"].sample())
        assert (b["P"].n_samples, b["nVertices"].is_constant, b["width"].is_constant) == (4, True, True)
        assert np.array_equal(a["P"].sample(), b["P"].sample(0))
        assert np.allclose(b["P"].sample(3) - b["P"].sample(0), [30, -30, 30], atol=1e-3)
    # the first sampling after the default one is what Unreal takes the frame rate from
    assert Archive(tmp_path / "cache.abc").samplings[1].step == pytest.approx(1 / 30)


def test_without_guides(tmp_path):
    groom, rest = example()
    bare = UnrealGroom(groom.counts, groom.widths, np.zeros(N_STRANDS, np.bool_), np.zeros(N_STRANDS, np.int32))
    write_unreal(tmp_path / "groom.abc", bare, rest)
    assert [n for n in read(tmp_path / "groom.abc") if "_" in n] == ["/groom/strands_0"]
    with pytest.raises(InputError, match="no guides to export; make guides first"):
        write_unreal(tmp_path / "guides.abc", bare, rest, guides_only=True)
    assert not (tmp_path / "guides.abc").exists()


def test_what_does_not_fit_is_refused(tmp_path):
    groom, rest = example()
    with pytest.raises(InputError, match="rest must have shape"):
        write_unreal(tmp_path / "a.abc", groom, rest[:-1])
    with pytest.raises(InputError, match="a frame must have shape"):
        write_unreal(tmp_path / "a.abc", groom, rest, [rest, rest[:-1]])
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="group numbers"):
        UnrealGroom(groom.counts, groom.widths, groom.is_guide, groom.groups - 1)
    with pytest.raises(InputError, match="no guide"):
        UnrealGroom(groom.counts, groom.widths, groom.is_guide, groom.groups, own_guide=np.ones(N_STRANDS, np.int32))
