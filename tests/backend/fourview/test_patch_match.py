import numba
import numpy as np
import pytest
from hairloom.errors import InputError
from hairloom.fourview._planar_kernels import LANES, rows_distance, vote_flat
from hairloom.fourview.patch_match import FillParams, PatchMatchParams, fill_hole, match_patches

SIZE = 7


def picture(shape, seed):
    """Smooth noise with some structure at every scale."""
    rng = np.random.default_rng(seed)
    total = np.zeros((*shape, 3))
    for step in (1, 2, 4, 8, 16):
        coarse = rng.normal(size=(-(-shape[0] // step), -(-shape[1] // step), 3))
        total += step**0.5 * coarse.repeat(step, axis=0).repeat(step, axis=1)[: shape[0], : shape[1]]
    return np.clip(128 + 20 * total, 0, 255).astype(np.uint8)


def distance(a, b, at, place, size=SIZE):
    """Squared distance of the patch of a at (row, column) and that of b at (column, row)."""
    first = a[at[0] : at[0] + size, at[1] : at[1] + size].astype(int)
    second = b[place[1] : place[1] + size, place[0] : place[0] + size].astype(int)
    return int(((first - second) ** 2).sum())


def patch_match_naive(a, b, n_iterations, seed):
    """Plain PatchMatch (Barnes et al. 2009): one scan over the whole image, two neighbours, halving search."""
    rng = np.random.default_rng(seed)
    height, width = a.shape[0] - SIZE + 1, a.shape[1] - SIZE + 1
    rows, columns = b.shape[0] - SIZE + 1, b.shape[1] - SIZE + 1
    place = np.stack([rng.integers(0, columns, (height, width)), rng.integers(0, rows, (height, width))], axis=2)
    cost = np.array([[distance(a, b, (y, x), place[y, x]) for x in range(width)] for y in range(height)])
    for iteration in range(n_iterations):
        step = 1 if iteration % 2 == 0 else -1
        for y in range(height)[::step]:
            for x in range(width)[::step]:
                tried = []
                if 0 <= x - step < width:
                    tried.append(place[y, x - step] + (step, 0))
                if 0 <= y - step < height:
                    tried.append(place[y - step, x] + (0, step))
                for candidate in tried:
                    if 0 <= candidate[0] < columns and 0 <= candidate[1] < rows:
                        error = distance(a, b, (y, x), candidate)
                        if error < cost[y, x]:
                            cost[y, x], place[y, x] = error, candidate
                reach = max(rows, columns)
                while reach >= 1:
                    low = np.maximum(place[y, x] - reach, 0)
                    high = np.minimum(place[y, x] + reach + 1, (columns, rows))
                    candidate = rng.integers(low, high)
                    error = distance(a, b, (y, x), candidate)
                    if error < cost[y, x]:
                        cost[y, x], place[y, x] = error, candidate
                    reach //= 2
    return cost


@numba.njit
def _rows(a, i, a_step, b, j, b_step, count, mask):
    return rows_distance(a, i, a_step, b, j, b_step, count, mask)


def test_vector_arithmetic_of_rows():
    rng = np.random.default_rng(3)
    a, b = rng.integers(0, 256, (2, 900)).astype(np.uint8)
    a[:400], b[:400] = 255, 0  # the greatest differences
    for n_bytes in (3, 21, 30):
        mask = np.zeros(LANES, np.uint8)
        mask[:n_bytes] = 255
        for i, j in ((0, 0), (5, 11), (410, 402)):
            for count in (1, 2, 3, 4, 5, 10):
                first = np.stack([a[i + 40 * k : i + 40 * k + n_bytes] for k in range(count)])
                second = np.stack([b[j + 35 * k : j + 35 * k + n_bytes] for k in range(count)])
                truth = ((first.astype(int) - second) ** 2).sum()
                assert _rows(a, i, 40, b, j, 35, count, mask) == truth
    assert _rows(a, 0, 40, b, 0, 35, 0, mask) == 0


@pytest.mark.parametrize("size", [1, 2, 3, 7, 10])
def test_distances_are_those_of_the_matches(size):
    a, b = picture((70, 50), 0), picture((60, 90), 1)
    found = match_patches(a, b, PatchMatchParams(patch_size=size))
    assert found.place.shape == (71 - size, 51 - size, 2)
    for y, x in ((0, 0), (70 - size, 50 - size), (20, 30), (31, 7)):
        assert found.distance[y, x] == distance(a, b, (y, x), found.place[y, x], size)


def test_error_is_not_above_that_of_plain_patch_match():
    a, b = picture((40, 36), 2), picture((44, 48), 3)
    ours = match_patches(a, b, PatchMatchParams(n_iterations=3)).distance.mean()
    # two draws of random numbers differ by half a per cent or so on 1000 patches
    assert ours <= 1.01 * patch_match_naive(a, b, 3, 5).mean()


def test_a_shifted_image_is_found():
    b = picture((120, 130), 4)
    found = match_patches(b[20:90, 30:110], b)
    exact = found.distance == 0
    assert exact.mean() > 0.95  # propagation has to reach nearly all from the few that chance found
    rows, columns = np.nonzero(exact)
    assert np.array_equal(found.place[exact], np.stack([columns + 30, rows + 20], axis=1))


def test_same_for_any_number_of_threads():
    a, b = picture((160, 60), 5), picture((80, 80), 6)
    before = numba.get_num_threads()
    results = []
    try:
        for n_threads in (1, before):
            numba.set_num_threads(n_threads)
            results.append(match_patches(a, b))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(results[0].place, results[1].place)
    other = match_patches(a, b, PatchMatchParams(seed=1))
    assert not np.array_equal(results[0].place, other.place)


def test_a_vote_is_the_weighted_mean_of_what_the_matches_show():
    rng = np.random.default_rng(8)
    image = rng.integers(0, 256, (30, 40, 3)).astype(np.uint8)
    matches = np.stack([rng.integers(0, 34, (9, 12)), rng.integers(0, 24, (9, 12))], axis=2).astype(np.int32)
    weights = np.where(rng.random((9, 12)) < 0.3, 0, rng.random((9, 12))).astype(np.float32)
    out = np.full((15, 18, 3), 7, np.uint8)
    vote_flat(image, matches, weights, SIZE, out)
    sums, totals = np.zeros((15, 18, 3)), np.zeros((15, 18, 1))
    for i, j in np.ndindex(9, 12):
        column, line = matches[i, j]
        sums[i : i + SIZE, j : j + SIZE] += weights[i, j] * image[line : line + SIZE, column : column + SIZE].astype(
            float
        )
        totals[i : i + SIZE, j : j + SIZE] += weights[i, j]
    truth = np.where(totals > 0, sums / np.maximum(totals, 1e-9), 7)
    # rounding to whole colours, and float32 sums of 49 numbers
    assert np.abs(out - truth).max() <= 0.501


def test_a_hole_in_stripes_is_filled_with_stripes():
    y, x = np.mgrid[:96, :96]
    wave = 128 + 90 * np.sin((x + 0.5 * y) * 0.6)
    image = np.stack([wave, 0.7 * wave, 0.5 * wave], axis=2).astype(np.uint8)
    hole = np.zeros((96, 96), np.bool_)
    hole[38:58, 36:60] = True
    broken = image.copy()
    broken[hole] = (255, 0, 255)
    result = fill_hole(broken, hole)
    assert np.array_equal(result[~hole], image[~hole])
    error = np.abs(result[hole].astype(int) - image[hole]).mean()
    # the mean colour would be wrong by 42 on average; a period and a half of stripes is hidden
    assert error < 12
    assert np.array_equal(result, fill_hole(broken, hole))


def test_bad_input():
    small, good = np.zeros((5, 9, 3), np.uint8), np.zeros((20, 20, 3), np.uint8)
    with pytest.raises(InputError, match="first image is 9 x 5"):
        match_patches(small, good)
    with pytest.raises(InputError, match="uint8"):
        match_patches(good.astype(np.float32), good)
    with pytest.raises(InputError, match="no patch of the image"):
        fill_hole(good, np.ones((20, 20), np.bool_))
    with pytest.raises(InputError, match="shape"):
        fill_hole(good, np.ones((20, 21), np.bool_))
    with pytest.raises(InputError, match="patch_size"):
        PatchMatchParams(patch_size=11)
    with pytest.raises(InputError, match="coarsest"):
        FillParams(coarsest=8)
    assert np.array_equal(fill_hole(good, np.zeros((20, 20), np.bool_)), good)
