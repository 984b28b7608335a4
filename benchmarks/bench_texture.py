"""Texture optimisation of a 100 x 100 x 16 map, beside the plain method: one scale and window, all candidates compared.

The energies are of one function: sum over the 8 x 8 patches of a grid of the distance to the nearest patch of the
example, to the power 0.8.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from hairloom.synthesis.texture import TextureParams, synthesize_texture
from hairloom.types import FeatureMap
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter

WINDOW = 8
EXPONENT = 0.8


def smooth_example(side: int, n_channels: int) -> FeatureMap:
    """Smoothed noise; each channel has 0.7 times the amplitude of the one before, much as features of hair."""
    rng = np.random.default_rng(0)
    channels = [gaussian_filter(rng.normal(size=(side, side)), 3.0, mode="wrap") * 0.7**c for c in range(n_channels)]
    values = np.stack(channels, axis=2) / channels[0].std()
    return FeatureMap(values.astype(np.float32), np.ones((side, side), np.bool_), np.zeros(2), 0.02)


def patches_of(image: np.ndarray, step: int) -> np.ndarray:
    """Patches every `step` cells as rows, each cell times the square root of its weight."""
    falloff = np.exp(-0.5 * ((np.arange(WINDOW) - 0.5 * (WINDOW - 1)) / (WINDOW / 3)) ** 2)
    root = np.sqrt(np.multiply.outer(falloff, falloff)).astype(np.float32)
    views = sliding_window_view(image, (WINDOW, WINDOW), axis=(0, 1))[::step, ::step]
    return (views * root).reshape(views.shape[0] * views.shape[1], -1)


def nearest(patches: np.ndarray, candidates: np.ndarray, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest candidate of each patch and its squared distance, by comparing all."""
    distances = squares - 2.0 * (patches @ candidates.T)
    chosen = distances.argmin(axis=1)
    return chosen, ((patches - candidates[chosen]) ** 2).sum(axis=1)


def energy(image: np.ndarray, example: np.ndarray) -> float:
    """The energy of a map at the plain method's window."""
    candidates = patches_of(example, 1)
    _, costs = nearest(patches_of(image, WINDOW // 4), candidates, (candidates**2).sum(axis=1))
    return float((costs.astype(np.float64) ** (EXPONENT / 2)).sum())


def plain(example: np.ndarray, seed: int, n_iterations: int = 20) -> np.ndarray:
    """Kwatra et al. 2005 at one scale and window, in numpy."""
    rng = np.random.default_rng(seed)
    candidates = patches_of(example, 1)
    squares = (candidates**2).sum(axis=1)
    n_places = example.shape[1] - WINDOW + 1
    falloff = np.exp(-0.5 * ((np.arange(WINDOW) - 0.5 * (WINDOW - 1)) / (WINDOW / 3)) ** 2)
    weights = np.multiply.outer(falloff, falloff)[..., None].astype(np.float32)
    starts = range(0, n_places, WINDOW // 4)
    corners = [(i, j) for i in starts for j in starts]
    chosen, strengths = rng.integers(len(candidates), size=len(corners)), np.ones(len(corners), np.float32)
    for _ in range(n_iterations):
        sums, total = np.zeros_like(example), np.zeros((*example.shape[:2], 1), np.float32)
        for (i, j), source, strength in zip(corners, chosen, strengths):
            y, x = divmod(int(source), n_places)
            here = np.s_[i : i + WINDOW, j : j + WINDOW]
            sums[here] += strength * weights * example[y : y + WINDOW, x : x + WINDOW]
            total[here] += strength * weights
        image = np.where(total > 0, sums / np.maximum(total, 1e-30), 0.0).astype(np.float32)
        before = chosen
        chosen, costs = nearest(patches_of(image, WINDOW // 4), candidates, squares)
        strengths = np.maximum(costs, 1e-6).astype(np.float32) ** (EXPONENT / 2 - 1)
        if (before == chosen).all():
            break
    return image


def run(*, quick: bool = False) -> list[dict[str, Any]]:
    """Rows for `hairloom bench texture`."""
    side = 48 if quick else 100
    example = smooth_example(side, 16)
    out_mask = np.ones((side, side), np.bool_)
    size = f"{side}x{side}x16"
    params = TextureParams(seed=1)
    seconds = []
    for _ in range(3 if quick else 7):
        since = time.perf_counter()
        result = synthesize_texture(example, out_mask, params)
        seconds.append(time.perf_counter() - since)
    since = time.perf_counter()
    reference = plain(example.values, params.seed)
    plain_seconds = time.perf_counter() - since
    others = [synthesize_texture(example, out_mask, TextureParams(seed=seed)) for seed in (2, 3)]
    ours = max(energy(each.map.values, example.values) for each in (result, *others))
    theirs = energy(reference, example.values)
    target = None if quick else 1.5
    scales = (
        f"3 scales x windows {params.window_sizes}, {len(result.energies)} steps, energy {ours:.0f} (worst of 3 seeds)"
    )
    peer = f"1 scale, window 8, up to 20 steps, energy {theirs:.0f}"
    return [
        {"size": size, "who": "hairloom", "seconds": min(seconds), "target": target, "note": scales},
        {"size": size, "who": "numpy, all compared", "seconds": plain_seconds, "target": None, "note": peer},
    ]
