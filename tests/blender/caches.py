"""Small simulation caches built for the tests."""

from __future__ import annotations

import bpy
import numpy as np
import scenes

N_FRAMES = 6


def simulated(
    folder: object,
    hair: bpy.types.Object,
    *,
    frame_start: int = 1,
    fingerprint: str = "",
    shift: float = 0.01,
    n_planned: int = 0,
) -> np.ndarray:
    """A cache of the groom in which it moves by `shift` along x each frame; the first frame is the groom."""
    cache = scenes.module("backend.io.sim_cache")
    rest = scenes.module("playback").rest_positions(hair)
    rest = scenes.positions(hair) if rest is None else rest
    frames = rest + np.arange(N_FRAMES, dtype=np.float32)[:, None, None] * np.float32([shift, 0, 0])
    options = {"fps": 24, "frame_start": frame_start, "fingerprint": fingerprint, "n_planned": n_planned}
    with cache.CacheWriter.create(folder, len(rest), **options) as writer:
        for frame in frames:
            writer.append(frame)
    return frames
