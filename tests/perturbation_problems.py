"""Perturbation problems given by A and e instead of J₂⁺ and a, and what is read off their S."""

from __future__ import annotations

import numpy as np

from pipeline.models.wishart.perturbation import Perturbations, fit_perturbations


def fit(
    noise: np.ndarray, e: np.ndarray, matrix: np.ndarray, ratio: float, floor: float
) -> Perturbations:
    """Of ω (N, n), e (N, m), A (N, n, m), λ and ε; the objective is ‖ω − Ay‖ + λ‖S‖ over 1 + λ."""
    root = np.sqrt(2)
    back = root * matrix + (1 - root) * np.matvec(matrix, e)[:, :, None] * e[:, None, :]
    return fit_perturbations(noise, e, back, (1 / (1 + ratio), ratio / (1 + ratio)), floor)


def parts(s: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """y (N, m) and c (N,) of S (N, m, m)."""
    image = np.matvec(s, e)
    along = np.vecdot(e, image)
    y = np.sqrt(2) * image + (1 - np.sqrt(2)) * along[:, None] * e
    return y, np.trace(s, axis1=1, axis2=2) - along


def free_optimum(noise: np.ndarray, matrix: np.ndarray, ratio: float) -> np.ndarray:
    """(N, m) argmin over y of ‖ω − Ay‖ + λ‖y‖ for A (N, n, m): by LAPACK's singular values and
    halvings of its secular equation.
    """
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    c, square = np.vecmat(noise, left), singular**2
    rest = noise - np.matvec(left, c)
    n, m = matrix.shape[-2:]
    outside = np.vecdot(rest, rest)[:, None] * (n > m)
    # μ = scale·t/(1 − t): t = 0 is the exact fit, t = 1 is y = 0
    scale = square[:, :1]
    low, high = np.zeros_like(scale), np.ones_like(scale)

    def beyond(t: np.ndarray) -> np.ndarray:
        weights = (c / ((1 - t) * square + t * scale)) ** 2
        inside = (weights * (square - ratio**2)).sum(axis=-1, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.where(outside > 0, ratio**2 * outside / (t * scale) ** 2, 0.0)
        return inside >= across

    exact, zero = beyond(low), ~beyond(high)
    for _ in range(80):
        middle = (low + high) / 2
        above = beyond(middle)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    t = np.where(exact, 0.0, np.where(zero, 1.0, high))
    shares = (1 - t) * singular * c / ((1 - t) * square + t * scale)
    return np.vecmat(shares, right)
