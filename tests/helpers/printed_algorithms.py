"""Routes to the exact laws' tests: Algorithm 1 of the paper as printed; a test of two laws."""

import numpy as np
import pytest
from scipy import linalg, stats

from pipeline.models.wishart.decomposition import Decomposition
from pipeline.randommatrix.wishart import degrees_of_freedom

# every decomposition
READINGS = {
    "pivoted_lu": Decomposition("pivoted_lu"),
    "qr": Decomposition("qr"),
    "qr_transposed": Decomposition("qr_transposed"),
}
every_reading = pytest.mark.parametrize(
    "decomposition",
    READINGS.values(),
    ids=READINGS,
)


def algorithm_1(chain, q, v, sigma_b, decomposition, size, rng) -> np.ndarray:
    """(size, n) draws of q_{k+1}, line by line after the paper, under the command ``v``."""
    jacobian = chain.jacobian(q)
    m, n = jacobian.shape
    j1 = first_factor(jacobian, decomposition)
    j2 = np.linalg.solve(j1, jacobian)
    d = degrees_of_freedom(sigma_b, m)
    law = stats.wishart(d, np.eye(m) / d)
    b = law.rvs(size, random_state=rng).reshape(size, m, m)

    random = j1 @ b @ j2
    inverse = np.linalg.inv(random) if m == n else np.linalg.pinv(random)
    step = np.matvec(inverse, v[..., :m])
    return q + chain.null_step(q, v) + step


def first_factor(jacobian: np.ndarray, decomposition: Decomposition) -> np.ndarray:
    """(m, m) J₁ of one J (m, n), by LAPACK."""
    match decomposition:
        case Decomposition("pivoted_lu"):
            permutation, lower, _ = linalg.lu(jacobian)
            return permutation @ lower
        case Decomposition("qr"):
            return linalg.qr(jacobian, mode="economic")[0]
        case _:
            return linalg.qr(jacobian.T, mode="economic")[1].T


def least_p_value(sample: np.ndarray, reference: np.ndarray) -> float:
    """Least p-value of two-sample Kolmogorov–Smirnov tests of each of three coordinates, of sums of
    them and of the distance from the common middle: eight views.
    """
    sums = np.random.default_rng(3).normal(size=(3, 4))
    axes = np.concatenate([np.eye(3), sums], axis=1)
    middle = np.median(reference, axis=0)

    def views(x: np.ndarray) -> np.ndarray:
        """(8, N) the coordinates, sums and distances of draws (N, 3)."""
        return np.vstack([(x @ axes).T, np.linalg.norm(x - middle, axis=1)])

    p_values = []
    for pair in zip(views(sample), views(reference), strict=True):
        p_values.append(stats.ks_2samp(*pair).pvalue)
    return min(p_values)
