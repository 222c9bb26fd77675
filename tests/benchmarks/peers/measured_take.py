"""One take of the robot arm as a user of another library would write it down, in NumPy: how the
Wishart model moves particles, and what the measurements say of them. Joint limits and singular
poses are left out, to the peers' advantage.
"""

from __future__ import annotations

import numpy as np


class Take:
    """A motion of M steps of n joints; arguments are what `scenario.Take.told` tells of it. Who
    inherits says how particles ``move(q, command)``.
    """

    def __init__(self, steps, start_mean, start_covariance, seen, y, covariance) -> None:
        self.steps = np.array(steps)  # (M, m), or (M, m + n) of more joints than task rows
        self.start_mean, self.start_covariance = np.array(start_mean), np.array(start_covariance)
        self.y = dict(zip(seen, np.array(y), strict=True))  # by the step that a frame falls on
        self.precision = np.linalg.inv(covariance)
        self.rng = np.random.default_rng(1)

    def start(self, count: int) -> np.ndarray:
        """(P, n) particles before the first step."""
        return self.rng.multivariate_normal(self.start_mean, self.start_covariance, count)

    def step(self, k: int, q: np.ndarray) -> np.ndarray:
        """(P, n) particles after step k = 1 … M, from those before."""
        return self.move(q, self.steps[k - 1])

    def log_likelihood(self, k: int, q: np.ndarray) -> np.ndarray:
        """(P,) logarithm of the normal density, its constant left out, of the frame that falls on
        step k.
        """
        error = self.y[k] - q
        return -0.5 * np.einsum("pi,pi->p", error @ self.precision, error)
