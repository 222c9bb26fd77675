"""The paper's algorithms as printed, which the exact laws are tested against."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from pipeline.randommatrix import wishart


def algorithm_1(chain, q, v, sigma_b, decomposition, size, rng) -> np.ndarray:
    """(size, 3) draws of q_{k+1}, line by line after the paper."""
    d = wishart.degrees_of_freedom(sigma_b, 3)
    b = wishart.sample(d, np.eye(3) / d, (size,), rng)
    jacobian = chain.jacobian(q)
    j1, j2 = linalg.lu(jacobian, permute_l=True) if decomposition == "lu" else linalg.qr(jacobian)
    return q + np.linalg.solve(j1 @ b @ j2, v)
