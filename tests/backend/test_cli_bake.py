"""`hairloom bake`: a cache becomes an Alembic file."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hairloom.cli import main
from hairloom.io.ogawa_read import Archive
from hairloom.io.sim_cache import CacheWriter
from hairloom.io.strands import write_strands
from hairloom.types import StrandSet


@pytest.fixture
def hair(tmp_path):
    points = np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32)
    strands = StrandSet(points, np.array([0, 4, 9], np.int32), {"radius": np.full(9, 0.001, np.float32)})
    write_strands(tmp_path / "hair.npz", strands)
    with CacheWriter.create(tmp_path / "cache", 9, fps=30, frame_start=3) as writer:
        for shift in range(4):
            writer.append(points + np.float32(shift))
    return points


def test_frames_of_the_cache_are_in_the_file(hair, tmp_path, capsys):
    command = ["bake", str(tmp_path / "hair.npz"), str(tmp_path / "cache"), str(tmp_path / "hair.abc"), "--json"]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 4
    archive = Archive(tmp_path / "hair.abc")
    geom = next(o for o in archive.top.walk() if o.path == "/hair/hair").properties[".geom"]
    assert np.array_equal(geom["nVertices"].sample(), [4, 5])
    assert np.array_equal(geom["width"].sample(), np.full(9, 0.002, np.float32))
    assert archive.samplings[1].time(0) == pytest.approx(0.1)
    for number in range(4):
        x, y, z = geom["P"].sample(number).T
        assert np.array_equal(np.stack([x, -z, y], axis=1), hair + np.float32(number))


def test_a_cache_of_other_hair_is_refused(hair, tmp_path, capsys):
    CacheWriter.create(tmp_path / "other", 7, fps=30).close()
    command = ["bake", str(tmp_path / "hair.npz"), str(tmp_path / "other"), str(tmp_path / "hair.abc")]
    assert main(command) == 2
    assert "the cache has 7 points" in capsys.readouterr().err
    assert main([*command[:2], str(tmp_path / "nowhere"), command[3]]) == 2
    assert "no simulation cache" in capsys.readouterr().err
    assert not (tmp_path / "hair.abc").exists()
