"""Measurements of takes with noise of one covariance."""

import numpy as np

from pipeline.filtering.measurement import Measurements


def noisy_frames(
    takes: np.ndarray,
    k: np.ndarray,
    dt: float,
    covariance: np.ndarray,
    rng: np.random.Generator,
) -> list[Measurements]:
    """Measurements of ``takes`` (T, M + 1, n) rad at the steps ``k`` of ``dt`` s, whose noise has
    the ``covariance`` (n, n) rad² and no bias.
    """
    true = takes[:, k]
    zero = np.zeros(true.shape[1:])
    errors = rng.multivariate_normal(zero[0], covariance, true.shape[:2])
    noise = np.tile(covariance, (len(k), 1, 1))
    return [Measurements("take", dt * k, y, zero, noise) for y in true + errors]
