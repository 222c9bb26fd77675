"""Interface of all motion models: the law of one step q_{k+1} | q_k under a command.

A command is the task step v (m,). For an arm with more joints than task rows it may also hold a
joint step w (n,), of which the arm makes the part in the null space of J: one row (m + n,). The arm
is at rest where the whole command is zero.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.interface import Chain, Mechanism
from pipeline.core.errors import ModelDomainError

# kinds of compiled laws (pipeline.models.kernel); those from WISHART on apply B⁻¹ to a = J₁⁻¹v
SCALED_LAW, GAUSSIAN_LAW, QR_LAW, GIVEN_LAW, PIVOTED_LU_LAW, QR_TRANSPOSED_LAW = range(6)
WISHART = QR_LAW


class Law(NamedTuple):
    """Law of a step for compiled code (:mod:`pipeline.models.kernel`)."""

    kind: int  # one of the constants above
    parameters: ndarray  # (K,) of the law
    sets: int  # sets of normal variates a pose; all poses draw one set before the next
    each: int  # normal variates of a pose in a set
    degrees: ndarray = np.empty(0)  # degrees of freedom of the χ² variates of a pose


class Commands(NamedTuple):
    """Commands v_k + κ(x*_k − x(q_k)) of M steps of m task rows, q_k the pose before the step."""

    v: ndarray  # (M, m) or (M, m + n)
    path: ndarray  # (M, p) x* before each step, a pose as the chain returns it
    share: float  # κ, share of the deviation from the path that a step corrects; 0: open loop


def open_loop(v: ndarray) -> Commands:
    """Commands ``v`` (M, m) or (M, m + n) that do not depend on the pose."""
    return Commands(v, np.zeros_like(v), 0.0)


def task_step(chain: Mechanism, command: ndarray) -> ndarray:
    """(..., m) v of the ``command`` (..., m) or (..., m + n)."""
    return command[..., : len(chain.task)]


def frobenius(matrix: ndarray) -> ndarray:
    """(...,) Frobenius norm of ``matrix`` (..., n, m), the paper's norm of a matrix."""
    return np.sqrt(np.einsum("...ij,...ij->...", matrix, matrix))


class MotionModel(Protocol):
    """p(q_{k+1} | q_k) for the commanded step v = ẋᵈ_kΔt.

    ``q`` (..., n) are joint angles in rad, ``v`` (m,), (..., m) or (..., m + n) is a command. All
    methods raise SingularJacobianError at a singular pose, ModelDomainError for a missing moment.
    """

    def law(self, chain: Chain) -> Law:
        """Return the law of a compiled step of the arm ``chain``."""

    def mean(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n) E[q_{k+1} | q_k = q] in rad."""

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n, n) Cov(q_{k+1} | q_k = q) in rad²."""

    def with_trace(self, chain: Mechanism, q: ndarray, v: ndarray, trace: float) -> "MotionModel":
        """Return the model whose noise level (σ_B, α or a factor on a covariance) gives the steps'
        covariances the mean ``trace`` > 0 in rad². Raises ModelDomainError where no level does.
        """

    def sample(self, chain: Chain, q: ndarray, v: ndarray, rng: Generator) -> ndarray:
        """(..., n) a draw of q_{k+1} for each pose, by NumPy alone; the compiled
        :func:`pipeline.models.draws.draw_steps` is many times as fast.
        """

    def log_density(
        self, chain: Mechanism, q: ndarray, v: ndarray, q_next: ndarray, measurement=None
    ) -> ndarray:
        """(...,) ln p(q_{k+1} = q_next | q_k = q) in rad⁻ⁿ, of the step plus N(0, ``measurement``)
        (n, n) in rad² if given. Raises ModelDomainError for a singular covariance, as a matrix
        model has at rest without ``measurement``.
        """


def row_by_row(matrix: ndarray, size: int) -> ndarray:
    """(size·size,) entries of ``matrix`` (size, size), row by row; raises ModelDomainError for any
    other shape.
    """
    if matrix.shape != (size, size):
        raise ModelDomainError(
            f"the model's matrix must have a row for each of the {size} joints or task rows of "
            "this arm; run the stage fit for it",
            shape=matrix.shape,
        )
    return matrix.ravel()
