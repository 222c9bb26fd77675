"""What the exact laws are tested against: the paper's Algorithm 1 as printed, and the action of an
inverse Wishart matrix from two gammas.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from pipeline.models.wishart.decomposition import factors
from pipeline.randommatrix import wishart


def algorithm_1(chain, q, v, sigma_b, decomposition, size, rng) -> np.ndarray:
    """(size, 3) draws of q_{k+1}, line by line after the paper."""
    d = wishart.degrees_of_freedom(sigma_b, 3)
    b = wishart.sample(d, np.eye(3) / d, (size,), rng)
    jacobian = chain.jacobian(q)
    j1, j2 = linalg.lu(jacobian, permute_l=True) if decomposition == "lu" else linalg.qr(jacobian)
    return q + np.linalg.solve(j1 @ b @ j2, v)


def sample_inverse_action(a: np.ndarray, d: float, rng: np.random.Generator) -> np.ndarray:
    """(..., n) one draw of B⁻¹a for each ``a`` (..., n), B ~ W_n(d, I/d) independent each time;
    zero where a is zero.

    R is the Householder reflection of the first axis to a/r up to its sign, which the symmetric law
    of T cannot tell.
    """
    n = a.shape[-1]
    z = d / rng.chisquare(d - n + 1, a.shape[:-1])
    tangent = np.zeros(a.shape)
    tangent[..., 1:] = rng.standard_normal((*a.shape[:-1], n - 1))
    tangent /= np.sqrt(rng.chisquare(d - n + 2, a.shape[:-1]))[..., None]
    r = np.sqrt(np.vecdot(a, a))
    mirror = a.copy()
    mirror[..., 0] += np.copysign(r, a[..., 0])
    # ‖mirror‖² = 2r(r + |a₁|), so that r·(I − 2mmᵀ/‖m‖²)·[0, T] divides by r + |a₁| alone
    reach = r + np.abs(a[..., 0])
    along = np.vecdot(mirror, tangent) / np.where(reach > 0, reach, 1.0)
    return z[..., None] * (a + r[..., None] * tangent - along[..., None] * mirror)


def inverse_action_steps(chain, q, v, sigma_b, decomposition, rng) -> np.ndarray:
    """(..., 3) draws of q_{k+1} after ``q`` (..., 3) by :func:`sample_inverse_action`."""
    a, back = factors(chain, q, v, decomposition)
    d = wishart.degrees_of_freedom(sigma_b, 3)
    return q + np.matvec(back, sample_inverse_action(a, d, rng))
