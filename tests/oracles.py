"""What the exact laws are tested against: the paper's Algorithm 1 as printed, and the action of an
inverse Wishart matrix from two gammas.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from pipeline.models.wishart.decomposition import Decomposition, factors
from pipeline.randommatrix import wishart

# every decomposition
READINGS = {
    "pivoted_lu": Decomposition("pivoted_lu"),
    "qr": Decomposition("qr"),
    "qr_transposed": Decomposition("qr_transposed"),
    "given": Decomposition("given", left=[[0.15, 0.02, 0.0], [0.0, 0.15, 0.0], [0.0, 0.1, 1.0]]),
}
every_reading = pytest.mark.parametrize("decomposition", READINGS.values(), ids=READINGS)


def algorithm_1(chain, q, v, sigma_b, decomposition, size, rng) -> np.ndarray:
    """(size, n) draws of q_{k+1}, line by line after the paper, under the command ``v``."""
    jacobian = chain.jacobian(q)
    j1 = first_factor(jacobian, decomposition)
    return q + chain.null_step(q, v) + _steps(jacobian, j1, v, sigma_b, size, rng)


def algorithm_1_steps(chain, q, v, sigma_b, decomposition, rng) -> np.ndarray:
    """(N, n) one draw of q_{k+1} after each of the poses ``q`` (N, n) likewise."""
    jacobian = chain.jacobian(q)
    j1 = np.array([first_factor(each, decomposition) for each in jacobian])
    return q + chain.null_step(q, v) + _steps(jacobian, j1, v, sigma_b, len(q), rng)


def _steps(jacobian, j1, v, sigma_b, size, rng) -> np.ndarray:
    m, n = jacobian.shape[-2:]
    d = wishart.degrees_of_freedom(sigma_b, m)
    b = wishart.sample(d, np.eye(m) / d, (size,), rng)
    random = j1 @ b @ np.linalg.solve(j1, jacobian)
    inverse = np.linalg.inv(random) if m == n else np.linalg.pinv(random)
    return np.matvec(inverse, v[..., :m])


def first_factor(jacobian: np.ndarray, decomposition: Decomposition) -> np.ndarray:
    """(m, m) J₁ of one J (m, n), by LAPACK."""
    match decomposition:
        case Decomposition("pivoted_lu"):
            permutation, lower, _ = linalg.lu(jacobian)
            return permutation @ lower
        case Decomposition("qr"):
            return linalg.qr(jacobian, mode="economic")[0]
        case Decomposition("qr_transposed"):
            return linalg.qr(jacobian.T, mode="economic")[1].T
        case Decomposition(left=left):
            return np.array(left)


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
    """(..., n) draws of q_{k+1} after ``q`` (..., n) by :func:`sample_inverse_action`."""
    a, back, _ = factors(chain, q, v, decomposition)
    d = wishart.degrees_of_freedom(sigma_b, len(chain.task))
    return q + chain.null_step(q, v) + np.matvec(back, sample_inverse_action(a, d, rng))
