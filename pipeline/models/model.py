"""The interface of all motion models: the law of one step q_{k+1} | q_k under a command.

The command of a step is the task step v (m,) or, of an arm with more joints than task rows, v and a
step w (n,) of the joints whose part in the null space of J is made: one row (m + n,). The arm rests
where all of it is zero.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.interface import Chain, Mechanism
from pipeline.core.errors import ModelDomainError

# kinds of compiled laws (pipeline.models.kernel); from WISHART on B⁻¹ acts on a
SCALED_LAW, GAUSSIAN_LAW, QR_LAW, GIVEN_LAW, PIVOTED_LU_LAW, QR_TRANSPOSED_LAW = range(6)
WISHART = QR_LAW


class Law(NamedTuple):
    """A step for compiled code (:mod:`pipeline.models.kernel`)."""

    kind: int  # one of those above
    parameters: ndarray  # (K,) of the law
    sets: int  # of normal variates that a pose takes, drawn one after the other for all poses
    each: int  # normal variates of a pose in a set
    degrees: ndarray = np.empty(0)  # of freedom of the χ² variates that a pose takes


class Commands(NamedTuple):
    """Commands of M steps of m task rows: v_k + κ(x*_k − x(q_k)) of the pose q_k before a step."""

    v: ndarray  # (M, m) or (M, m + n)
    path: ndarray  # (M, p) x* before each step, as the chain has a pose
    share: float  # κ, of the deviation from the path that a step corrects; 0 of an open loop


def open_loop(v: ndarray) -> Commands:
    """Commands ``v`` (M, m) or longer, whatever the pose."""
    return Commands(v, np.zeros_like(v), 0.0)


def task_step(chain: Mechanism, command: ndarray) -> ndarray:
    """(..., m) v of the ``command`` (..., m) or (..., m + n)."""
    return command[..., : len(chain.task)]


def frobenius(matrix: ndarray) -> ndarray:
    """(...,) Frobenius norm of ``matrix`` (..., n, n), the paper's norm of a matrix."""
    return np.sqrt(np.einsum("...ij,...ij->...", matrix, matrix))


class MotionModel(Protocol):
    """p(q_{k+1} | q_k) for the commanded step v = ẋᵈ_kΔt.

    ``q`` (..., n) are joint angles in rad, ``v`` (m,), (..., m) or longer is a command. All methods
    raise SingularJacobianError where J(q) has no inverse, missing moments ModelDomainError.
    """

    def law(self, chain: Chain) -> Law:
        """Law of a compiled step of the arm ``chain``."""

    def mean(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n) E[q_{k+1} | q_k = q] in rad."""

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n, n) Cov(q_{k+1} | q_k = q) in rad²."""

    def with_trace(self, chain: Mechanism, q: ndarray, v: ndarray, trace: float) -> "MotionModel":
        """Model whose own level (σ_B, α, a factor on a covariance) gives the covariances of the
        steps a mean trace of ``trace`` > 0 in rad²; raises ModelDomainError where no level does.
        """

    def sample(self, chain: Chain, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        """(..., n) a draw of q_{k+1} for each pose, by NumPy alone; the compiled
        :func:`pipeline.models.draws.draw_steps` is many times as fast.
        """

    def log_density(
        self, chain: Mechanism, q: ndarray, v: ndarray, q_next: ndarray, measurement=None
    ) -> ndarray:
        """(...,) ln p(q_{k+1} = q_next | q_k = q) in rad⁻ⁿ, of the step plus N(0, ``measurement``)
        (n, n) in rad² where that is given. Raises ModelDomainError where the covariance is
        singular, as of a matrix model at rest without it.
        """


def row_by_row(matrix: ndarray, size: int) -> ndarray:
    """(size·size,) ``matrix`` (size, size) row by row; ModelDomainError for another size than the
    arm's joints or task rows.
    """
    if matrix.shape != (size, size):
        raise ModelDomainError(
            f"the model's matrix must have a row for each of the {size} joints or task rows of "
            "this arm; run the stage fit for it",
            shape=matrix.shape,
        )
    return matrix.ravel()
