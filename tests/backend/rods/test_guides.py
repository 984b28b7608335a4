"""Guides: one strand of each wisp, the nearest to its mean; the job that clusters and chooses; bad input."""

from __future__ import annotations

import numpy as np
import pytest
from follower_hair import CENTRE, RADIUS, as_strands, hair_on_sphere
from hairloom.errors import InputError
from hairloom.geometry.analytic_heads import sphere_head
from hairloom.geometry.strands import from_dense, resample, select_strands
from hairloom.registry import run_job
from hairloom.rods.guides import GuideParams, choose_guides
from hairloom.types import StrandSet


def choose_naive(strands, labels):
    points = resample(strands, 16).astype(float)
    guides = []
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        offsets = points[members] - points[members].mean(axis=0)
        guides.append(members[(offsets**2).sum(axis=(1, 2)).argmin()])
    return np.array(guides)


@pytest.fixture(scope="module")
def hair():
    return as_strands(hair_on_sphere(400, seed=3), 20)


def test_the_strand_nearest_to_the_mean(hair):
    labels = np.random.default_rng(0).integers(0, 30, 400).astype(np.int32)
    guides, wisps = choose_guides(hair, labels)
    assert np.array_equal(guides, choose_naive(hair, labels))
    assert np.array_equal(wisps, labels) and guides.dtype == wisps.dtype == np.int32


def test_numbers_of_wisps_may_be_left_out(hair):
    labels = np.random.default_rng(0).integers(0, 30, 400).astype(np.int32)
    expected = choose_guides(hair, labels)
    guides, wisps = choose_guides(hair, labels * np.int32(7) + np.int32(5))
    assert np.array_equal(guides, expected[0]) and np.array_equal(wisps, expected[1])


def test_the_order_of_the_strands_does_not_matter(hair):
    labels = np.random.default_rng(0).integers(0, 30, 400).astype(np.int32)
    order = np.random.default_rng(1).permutation(400)
    guides, wisps = choose_guides(select_strands(hair, order), labels[order])
    expected, wisps_before = choose_guides(hair, labels)
    assert np.array_equal(order[guides], expected) and np.array_equal(wisps, wisps_before[order])


def test_strands_without_length_are_no_guides():
    points = np.zeros((5, 3, 3), np.float32)
    points[..., 0] = np.arange(5)[:, None]
    points[[0, 2], :, 2] = [0.0, 0.05, 0.1]  # the others are points
    guides, wisps = choose_guides(from_dense(points), np.array([0, 0, 1, 1, 2], np.int32))
    assert guides.tolist() == [0, 2]
    assert wisps.tolist() == [0, 0, 1, 1, 1]  # the last wisp has no guide: the nearest one's


def test_the_job(hair):
    head = sphere_head(RADIUS, tuple(CENTRE))
    made = run_job("make_guides", {"strands": hair, "head": head}, {"n_guides": 25})
    guides, wisps = made["guides"], made["wisps"]
    assert guides.shape == (25,) and wisps.shape == (400,)
    assert np.array_equal(wisps[guides], np.arange(25)) and np.array_equal(np.unique(wisps), np.arange(25))
    # strands are nearer to their own guide than to any other guide's, on the average: wisps are alike
    points = resample(hair, 16).reshape(400, -1)
    distances = np.linalg.norm(points[:, None] - points[guides][None], axis=2)
    assert distances[np.arange(400), wisps].mean() < 0.4 * distances.mean()
    assert made["report"]["guides"] == 25 and made["report"]["strands"] == 400
    again = run_job("make_guides", {"strands": hair, "head": head}, {"n_guides": 25})
    assert np.array_equal(again["guides"], guides) and np.array_equal(again["wisps"], wisps)


def test_the_job_with_more_guides_than_strands_and_with_wisps_given(hair):
    head = sphere_head(RADIUS, tuple(CENTRE))
    made = run_job("make_guides", {"strands": hair, "head": head}, {})
    assert np.array_equal(made["guides"], np.arange(400)) and np.array_equal(made["wisps"], np.arange(400))
    labels = np.arange(400, dtype=np.int32) // 40
    assert np.array_equal(run_job("make_guides", {"strands": hair, "labels": labels}, {})["wisps"], labels)


def test_bad_input(hair):
    empty = StrandSet(np.zeros((0, 3), np.float32), np.zeros(1, np.int32))
    for strands, labels, message in (
        (empty, np.zeros(0, np.int32), "no strands"),
        (hair, np.zeros(3, np.int32), "labels must have shape"),
        (hair, np.full(400, -1, np.int32), "below 0"),
        (from_dense(np.zeros((2, 3, 3), np.float32)), np.zeros(2, np.int32), "shorter than 0.1 mm"),
    ):
        with pytest.raises(InputError, match=message):
            choose_guides(strands, labels)
    with pytest.raises(InputError, match="no strands"):
        run_job("make_guides", {"strands": empty, "head": None}, {})
    with pytest.raises(InputError, match="needs a head"):
        run_job("make_guides", {"strands": hair}, {})
    for settings in ({"n_guides": 0}, {"n_samples": 1}, {"max_iterations": 0}, {"seeds_per_wisp": 0}):
        with pytest.raises(InputError, match=next(iter(settings))):
            GuideParams(**settings)
