"""What is minimised where the perturbations are held back by definiteness, and its slopes
(:mod:`.bound`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Problems:
    """N problems, each in the frame of its e and in units of δ; a place is u = (x, d), (...,
    N, m).
    """

    noise: np.ndarray  # (N, n) ω
    matrix: np.ndarray  # (N, n, m) A
    ratio: float  # λ

    @property
    def zero(self) -> np.ndarray:
        """(m,) u of y = 0."""
        return np.eye(self.matrix.shape[-1])[0]

    def subset(self, chosen: np.ndarray) -> Problems:
        """Those of the problems ``chosen``, by number."""
        return Problems(self.noise[chosen], self.matrix[chosen], self.ratio)

    def terms(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """ω − Ay (..., N, n) and z (..., N, m + 1)."""
        y, x, d = u - self.zero, u[..., 0], u[..., 1:]
        c = np.maximum(np.vecdot(d, d) / np.where(x > 0, 2 * x, np.inf) - 1, 0.0)
        return self.noise - np.matvec(self.matrix, y), np.concatenate([y, c[..., None]], axis=-1)

    def __call__(self, u: np.ndarray) -> np.ndarray:
        """F (..., N); infinite where no C would do."""
        rest, z = self.terms(u)
        feasible = (u[..., 0] > 0) | ~np.any(u, axis=-1)
        return np.where(feasible, norm(rest) + self.ratio * norm(z), np.inf)

    def along(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slopes of Ay (N, n, m) and of z (N, m + 1, m) by (τ, η), which move x and d by τx and
        τd + η.

        Along τ, ‖d‖²/2x has no curvature, and along η that of 1/x: so nothing cancels near the
        apex, where x is as small as d².
        """
        x, d, m = u[:, 0], u[:, 1:], u.shape[1]
        across = np.broadcast_to(np.eye(m)[:, 1:], (len(u), m, m - 1))
        y_slopes = np.concatenate([u[:, :, None], across], axis=2)
        cone = np.vecdot(d, d) / (2 * x)
        c_slopes = np.where(
            cone[:, None] > 1, np.concatenate([cone[:, None], d / x[:, None]], axis=1), 0.0
        )
        return self.matrix @ y_slopes, np.concatenate([y_slopes, c_slopes[:, None]], axis=1)

    def slopes(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (N, m) and Hessian (N, m, m) of F by (τ, η)."""
        rest, z = self.terms(u)
        fit_slopes, z_slopes = self.along(u)
        fit, fit_curvature = norm_slopes(rest, -fit_slopes)
        size, curvature = norm_slopes(z, z_slopes)
        across = np.arange(1, u.shape[1])
        curvature[:, across, across] += (z[:, -1] / (norm(z) * u[:, 0]))[:, None]
        return fit + self.ratio * size, fit_curvature + self.ratio * curvature


def norm(vectors: np.ndarray) -> np.ndarray:
    """(...,) of ``vectors`` (..., k)."""
    return np.sqrt(np.vecdot(vectors, vectors))


def norm_slopes(vectors: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (N, m) and Hessian (N, m, m) of the norm of ``vectors`` (N, k) that change by the
    constant ``slopes`` (N, k, m).
    """
    length = norm(vectors)[:, None]
    gradient = np.vecmat(vectors / length, slopes)
    return gradient, (
        np.swapaxes(slopes, 1, 2) @ slopes - gradient[:, :, None] * gradient[:, None, :]
    ) / length[..., None]


def moved(u: np.ndarray, move: np.ndarray) -> np.ndarray:
    """The places ``u`` (N, m) moved by (τ, η) = ``move`` (..., N, m)."""
    result = u * (1 + move[..., :1])
    result[..., 1:] += move[..., 1:]
    return result
