"""The flow of a real groom, bent strongly: lengths, roots and curls of the hair stay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hairloom.editing.flow import Flow, FlowBinding, apply_flow, extract_flow
from hairloom.geometry.strands import from_dense
from hairloom.io.strands import read_strands
from hairloom.io.units import Units
from hairloom.types import StrandSet
from scipy.cluster.vq import kmeans2
from scipy.spatial.transform import Rotation

N_WISPS = 60


@pytest.fixture(scope="module")
def groom(data_dir: Path) -> tuple[StrandSet, Flow, FlowBinding]:
    strands = read_strands(data_dir / "sintel" / "hair.tfx", units=Units.parse("m,y-up"))
    tips = strands.points[strands.offsets[1:] - 1]
    where = np.concatenate([strands.roots, tips], axis=1).astype(np.float64)
    labels = kmeans2(where, N_WISPS, seed=np.random.default_rng(0), minit="++")[1].astype(np.int32)
    return strands, *extract_flow(strands, labels)


def bent(flow: Flow, degrees: float) -> Flow:
    """Each flow strand turned about x through its root, more and more towards the tip."""
    points = flow.strands.points.reshape(flow.strands.n_strands, -1, 3).astype(np.float64)
    angles = np.radians(degrees) * np.linspace(0, 1, points.shape[1])
    turns = Rotation.from_rotvec(angles[:, None] * [1.0, 0.0, 0.0]).as_matrix()
    root = points[:, :1]
    strands = from_dense(root + np.einsum("nij,knj->kni", turns, points - root))
    return Flow(strands, flow.ids, flow.normals, flow.tangents, flow.widths, flow.lengths)


def segments(strands: StrandSet) -> np.ndarray:
    lengths = np.linalg.norm(np.diff(strands.points.astype(np.float64), axis=0), axis=1)
    return np.delete(lengths, strands.offsets[1:-1] - 1)


def turning(strands: StrandSet) -> np.ndarray:
    """The angle at each inner point, radians."""
    steps = np.diff(strands.points.astype(np.float64), axis=0)
    steps /= np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1e-12)
    cosine = np.einsum("ic,ic->i", steps[1:], steps[:-1])
    inner = np.ones(len(strands.points), bool)
    inner[strands.offsets[:-1]] = inner[strands.offsets[1:] - 1] = False
    return np.arccos(np.clip(cosine[inner[1:-1]], -1.0, 1.0))


def test_hair_of_an_unchanged_flow_stays(groom) -> None:
    strands, flow, binding = groom
    found = apply_flow(strands, binding, flow)
    # 1e-6 of the head's radius of about 0.1 m
    np.testing.assert_allclose(found.points, strands.points, rtol=0, atol=1.2e-7)


@pytest.mark.parametrize("degrees", [60.0, 120.0])
def test_lengths_roots_and_curls_survive_a_strong_bend(groom, degrees) -> None:
    strands, flow, binding = groom
    found = apply_flow(strands, binding, bent(flow, degrees))
    moved = np.linalg.norm(found.points - strands.points, axis=1)
    assert np.median(moved) > 0.01
    np.testing.assert_allclose(found.roots, strands.roots, rtol=0, atol=1.2e-7)
    before = segments(strands)
    long = before > 1e-5  # shorter ones are rounding of float32 coordinates
    assert np.abs(segments(found)[long] / before[long] - 1.0).max() < 5e-3
    # turning positions more and more turns tangents twice as far: the bend's own share at each point of a strand
    old, new = turning(strands), turning(found)
    extra = 2.0 * np.radians(degrees) / strands.point_counts.mean()
    assert abs(np.median(new) - np.median(old)) < extra + 0.1 * np.median(old)
    assert np.percentile(new, 99.9) < 2.0 * np.percentile(old, 99.9) + 4 * extra
