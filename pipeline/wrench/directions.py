"""Random directions of cables: the von Mises–Fisher law on the unit sphere of R^p.

Its density is proportional to exp(κ·eᵀe̲) (Mardia & Jupp, Directional Statistics, 2000, ch. 9). For
p = 2 it is the von Mises law of an angle, whose concentration κ the paper writes σ_θ.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ive

# beyond it the series in 1/κ is exact in double precision, and the Bessel functions fail at 1e9
LARGE = 1e6


def mean_resultant_length(concentration: np.ndarray, dimension: int) -> np.ndarray:
    """A(κ) = I_{p/2}(κ)/I_{p/2−1}(κ) = E[eᵀe̲], any shape; ``dimension`` p.

    That is I₁/I₀ in the plane and coth κ − 1/κ in space. The exponential scaling cancels in the
    ratio; without it I₀ overflows a double beyond κ = 713.
    """
    bounded = np.minimum(concentration, LARGE)
    ratio = ive(dimension / 2, bounded) / ive(dimension / 2 - 1, bounded)
    x, q = 1 / np.maximum(concentration, LARGE), dimension - 1
    return np.where(concentration > LARGE, 1 - q * x / 2 + q * (q - 2) * x**2 / 8, ratio)


def sample_directions(
    mean: np.ndarray, concentration: np.ndarray, samples: int, rng: np.random.Generator
) -> np.ndarray:
    """``samples`` independent sets of unit vectors, (samples, m, p), of cables with the ``mean``
    directions e̲ (m, p) and ``concentration`` κ (m,): Eq. (vMis), and its counterpart in space.
    """
    from scipy.stats import vonmises_fisher

    drawn = [
        vonmises_fisher(mu, kappa).rvs(samples, random_state=rng)
        for mu, kappa in zip(mean, concentration, strict=True)
    ]
    return np.stack(drawn, axis=1)
