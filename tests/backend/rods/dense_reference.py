"""The rods' mechanics as the equations say it, dense and slow: what the linear-time code is compared with.

One rod at a time. The Jacobian comes from its integral (M-25), J_{i,Q}(s) = int n_i(x) x (r(s) - r(x)) dx over
element Q up to s, by a fine quadrature; frames from matrix exponentials. Nothing is shared with the package.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

NODES = 0.5 * np.polynomial.legendre.leggauss(3)[0] + 0.5
WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(3)[1]
FINE_NODES = 0.5 * np.polynomial.legendre.leggauss(24)[0] + 0.5
FINE_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(24)[1]


def cross_matrix(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def helix(q: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frames (n, 3, 3) and offsets (n, 3) at s (n,) in the element's own axes: exponentials of the 4 x 4 twist."""
    twist = np.zeros((4, 4))
    twist[:3, :3] = cross_matrix(q)
    twist[0, 3] = 1.0
    poses = expm(twist * np.atleast_1d(s)[:, None, None])
    return poses[:, :3, :3], poses[:, :3, 3]


class DenseRod:
    """A rod of N elements on a root pose: lengths (N,), curvatures (N, 3)."""

    def __init__(self, root: np.ndarray, frame: np.ndarray, lengths: np.ndarray, curvatures: np.ndarray) -> None:
        self.lengths, self.curvatures = lengths, curvatures
        self.bases = [(np.asarray(root), np.asarray(frame))]
        for q, length in zip(curvatures, lengths):
            at, turned = self.bases[-1]
            rotation, offset = helix(q, length)
            self.bases.append((at + turned @ offset[0], turned @ rotation[0]))
        self._whole = [self._fine(e, length) for e, length in enumerate(lengths)]

    @property
    def n_elements(self) -> int:
        return len(self.lengths)

    def place(self, element: int, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) and frame (3, 3), world."""
        at, turned = self.bases[element]
        rotation, offset = helix(self.curvatures[element], s)
        return at + turned @ offset[0], turned @ rotation[0]

    def _fine(self, element: int, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, frames and weights of a quadrature from the element's start to `reach`."""
        at, turned = self.bases[element]
        rotations, offsets = helix(self.curvatures[element], FINE_NODES * reach)
        return at + offsets @ turned.T, turned @ rotations, FINE_WEIGHTS * reach

    def jacobian(self, element: int, s: float) -> np.ndarray:
        """(3, 3N): d r(element, s) / d q."""
        here = self.place(element, s)[0]
        result = np.zeros((3, 3 * self.n_elements))
        for lower in range(element + 1):
            points, frames, weights = self._whole[lower] if lower < element else self._fine(element, s)
            for i in range(3):
                result[:, 3 * lower + i] = weights @ np.cross(frames[:, :, i], here - points)
        return result

    def quadrature(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (3N, 3), shares of length (3N,) and Jacobians (3N, 3, 3N) of the material points."""
        places = [
            (e, x * self.lengths[e], w * self.lengths[e])
            for e in range(self.n_elements)
            for x, w in zip(NODES, WEIGHTS)
        ]
        points = np.array([self.place(e, s)[0] for e, s, _ in places])
        return points, np.array([w for *_, w in places]), np.array([self.jacobian(e, s) for e, s, _ in places])


def step(
    rod: DenseRod,
    *,
    mass: np.ndarray,
    drag: np.ndarray,
    stiffness: np.ndarray,
    rest: np.ndarray,
    damping: float,
    old_velocities: np.ndarray,
    drift: np.ndarray,
    dt: float,
    gravity: np.ndarray,
    wind: np.ndarray,
    impulse: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Solve the step's normal equations with the dense matrix (N, 3 per element arrays; old and drift (3N, 3)).

    Returns rates (N, 3), velocities (3N, 3), the root's impulse (3,) from the momentum balance, and the matrix Mhat.
    `impulse` (3N,) is H^T lambda; its momentum is left to the caller.
    """
    _, shares, jacobians = rod.quadrature()
    m, nu, air = shares * np.repeat(mass, 3), shares * np.repeat(drag, 3), np.repeat(wind, 3, axis=0)
    a = (rod.lengths[:, None] * stiffness).ravel()
    matrix = np.einsum("p,pik,pil->kl", m + dt * nu, jacobians, jacobians) + np.diag(a * dt * (damping + dt))
    pulled = m[:, None] * (old_velocities - drift + dt * gravity) + dt * nu[:, None] * (air - drift)
    right = np.einsum("pik,pi->k", jacobians, pulled) - dt * a * (rod.curvatures - rest).ravel()
    rates = np.linalg.solve(matrix, right if impulse is None else right + impulse)
    velocities = drift + jacobians @ rates
    change = m[:, None] * (velocities - old_velocities - dt * gravity) + dt * nu[:, None] * (velocities - air)
    return rates.reshape(-1, 3), velocities, change.sum(axis=0), matrix
