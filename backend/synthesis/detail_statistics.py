"""Spectra of curls, waves and frizz over their wavelength: how much detail was kept or transferred."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from ..errors import require
from ..geometry.strands import from_dense, polyline_lengths, resample
from ..types import Float32, Float64, WispHierarchy
from ._detail_kernels import split_details
from .statistics import SMOOTHING
from .transfer import align_frames, point_frames

Complex128 = NDArray[np.complex128]
BINS_PER_OCTAVE = 3
SHORTEST, LONGEST = 0.02, 5.12  # head radii: 2 mm to the length of long hair
PADDING = 4  # zeros behind a strand before its Fourier transform, so that short strands have narrow bins too
STRANDS_AT_ONCE = 4096  # bounds the memory of a spectrum to some 60 MB


@dataclass(frozen=True, slots=True)
class DetailSpectrum:
    """How much strands bend and wind at which wavelength: root mean squares of each strand, mean over all hair length.

    Each strand counts by its amplitudes, not by their squares: one kinked strand in a hundred would else be all.

    edges : (B + 1,) float64, wavelengths in the unit of the points, ascending; longer ones count to the last bin.
    curvature : (B,) float64, 1 / unit: of the curvature vector carried along the strand without twist; a curl of any
        kind shows at its own wavelength, along the strand.
    torsion : (B,) float64, 1 / unit: of the torsion where the strand bends; a helix winds evenly, so it shows in the
        last bins, about the strand's length and above.
    """

    edges: Float64
    curvature: Float64
    torsion: Float64


def _edges(shortest: float, longest: float) -> Float64:
    n_bins = max(1, round(BINS_PER_OCTAVE * np.log2(longest / shortest)))
    return np.asarray(np.geomspace(shortest, longest, n_bins + 1), dtype=np.float64)


def _parallel_curvature(points: Float64) -> tuple[Complex128, Float64]:
    """Curvature vectors (S, M) as complex numbers, and torsion (S, M), at the inner points of even strands (S, N, 3).

    The complex curvature is kappa exp(i integral of tau) (Bishop 1975): its size is the curvature, its phase turns with
    the osculating plane, so planar waves and helices alike oscillate with their wavelength.
    """
    edges = np.diff(points, axis=1)
    step = np.maximum(np.linalg.norm(edges, axis=2), 1e-12)
    bends = np.cross(edges[:, :-1], edges[:, 1:])
    turning = np.arctan2(np.linalg.norm(bends, axis=2), np.einsum("sni,sni->sn", edges[:, :-1], edges[:, 1:]))
    middle = edges[:, 1:-1] / step[:, 1:-1, None]
    sines = np.einsum("sni,sni->sn", np.cross(bends[:, :-1], bends[:, 1:]), middle)
    twists = np.arctan2(sines, np.einsum("sni,sni->sn", bends[:, :-1], bends[:, 1:]))
    phases = np.zeros_like(turning)
    np.cumsum(twists, axis=1, out=phases[:, 1:])
    curvature = turning / (0.5 * (step[:, :-1] + step[:, 1:]))
    # a straight piece has no osculating plane: its torsion counts as little as it bends
    square = curvature[:, 1:] * curvature[:, :-1]
    typical = np.mean(curvature**2, axis=1, keepdims=True)
    torsion = twists / step[:, 1:-1] * square / np.maximum(square + typical, 1e-20)
    return curvature * np.exp(1j * phases), torsion


def _amplitudes(signal: Float64 | Complex128, step: Float64, edges: Float64) -> Float64:
    """(S, B) root mean square of each row of `signal` (S, M) in bins of wavelength; step (S,), unit of the edges."""
    count, n_bins = signal.shape[1], len(edges) - 1
    window = np.hanning(count + 2)[1:-1]
    window /= np.sqrt(np.mean(window**2))
    n_padded = PADDING * count
    power = np.abs(np.fft.fft(signal * window, n_padded, axis=1)) ** 2 / (n_padded * count)
    frequencies = np.abs(np.fft.fftfreq(n_padded))[None, :] / step[:, None]
    wavelengths = 1.0 / np.maximum(frequencies, 1e-12)
    bins = np.clip(np.searchsorted(edges, wavelengths, side="right") - 1, 0, n_bins - 1)
    bins += n_bins * np.arange(len(signal))[:, None]
    squares = np.bincount(bins.ravel(), power.ravel(), minlength=n_bins * len(signal))
    return np.asarray(np.sqrt(squares.reshape(-1, n_bins)), dtype=np.float64)


def detail_spectrum(points: Float32, *, shortest: float = SHORTEST, longest: float = LONGEST) -> DetailSpectrum:
    """Spectra of curvature and torsion of strands (S, N, 3) over wavelength, in the unit of the points.

    Strands are taken at even steps and smoothed by about one sample first, as the corners of polylines are no curls;
    wavelengths under 4 samples do not show therefore. Strands of no length are left out. Bins are thirds of octaves
    between `shortest` and `longest`; the defaults are for head radii.

    Raises
    ------
    InputError : strands of fewer than 8 points, or no strand has a length.
    """
    require(points.ndim == 3 and points.shape[1] >= 8, "a detail spectrum needs strands of 8 points or more")
    require(0 < shortest < longest, f"wavelengths {shortest}..{longest} are no range")
    edges = _edges(shortest, longest)
    sums = np.zeros((2, len(edges) - 1))
    total = 0.0
    for first in range(0, len(points), STRANDS_AT_ONCE):
        even = resample(from_dense(points[first : first + STRANDS_AT_ONCE]), points.shape[1]).astype(np.float64)
        smooth = convolve1d(even, SMOOTHING, axis=1, mode="nearest")[:, 2:-2]
        lengths = np.linalg.norm(np.diff(smooth, axis=1), axis=2).sum(axis=1)
        smooth, lengths = smooth[lengths > 0], lengths[lengths > 0]
        step = lengths / (smooth.shape[1] - 1)
        curvature, torsion = _parallel_curvature(smooth)
        sums += [lengths @ _amplitudes(signal, step, edges) for signal in (curvature, torsion)]
        total += float(lengths.sum())
    require(total > 0, "no strand has a length; choose a groom whose strands have one")
    return DetailSpectrum(edges, sums[0] / total, sums[1] / total)


def spectrum_distance(first: Float64, second: Float64) -> float:
    """Share of two spectra (B,) that they do not have in common: 0 if equal, 1 if nothing overlaps."""
    total = float(first.sum() + second.sum())
    return float(np.abs(first - second).sum()) / total if total > 0 else 0.0


def compare_details(first: Float32, second: Float32) -> dict[str, float]:
    """Distances `curvature` and `torsion`, 0..1, between the detail spectra of two sets of strands (S, N, 3)."""
    a, b = detail_spectrum(first), detail_spectrum(second)
    return {
        "curvature": spectrum_distance(a.curvature, b.curvature),
        "torsion": spectrum_distance(a.torsion, b.torsion),
    }


def finer_spectrum(hierarchy: WispHierarchy, *, max_strands: int = 4000) -> Float64:
    """(B,) float64: how far hairs turn away from their coarsest center, over wavelength along it; bins as above.

    Root mean square slope of the displacement across the center strand, in the frames along it (eq. 6): what the finer
    levels add, whatever the coarsest one does. At most `max_strands` hairs, evenly chosen, are looked at.
    """
    top, hair = hierarchy.levels[-1], hierarchy.levels[0]
    wisps = hierarchy.labels[0]
    for labels in hierarchy.labels[1:]:
        wisps = labels[wisps]
    chosen = np.arange(0, hair.n_strands, -(-hair.n_strands // max_strands), dtype=np.int32)
    centers = top.in_head_space()
    frames = point_frames(centers, align_frames(top)[0])
    still = np.eye(hair.n_points, dtype=np.float32)
    details, _ = split_details(hair.in_head_space(), chosen, wisps, centers, frames, still)
    lengths = polyline_lengths(centers)[wisps[chosen]]
    across = (details[:, 0] + 1j * details[:, 1]).astype(np.complex128)[lengths > 0]
    lengths = lengths[lengths > 0]
    require(len(lengths) > 0, "no center strand has a length; choose a groom whose strands have one")
    step = lengths / (hair.n_points - 1)
    amplitudes = _amplitudes(np.diff(across, axis=1) / step[:, None], step, _edges(SHORTEST, LONGEST))
    return np.asarray(lengths @ amplitudes / lengths.sum(), dtype=np.float64)
