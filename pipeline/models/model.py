"""The interface that all motion models share: the law of one step q_{k+1} | q_k."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from pipeline.arm.interface import Chain, Mechanism
from pipeline.core.errors import ModelDomainError

# kinds of compiled laws (pipeline.models.kernel); from WISHART on a is acted on by B⁻¹
SCALED_LAW, GAUSSIAN_LAW, QR_LAW, GIVEN_LAW, PIVOTED_LU_LAW, QR_TRANSPOSED_LAW = range(6)
WISHART = QR_LAW


class Law(NamedTuple):
    """A step for compiled code (:mod:`pipeline.models.kernel`)."""

    kind: int  # one of those above
    parameters: np.ndarray  # (K,) of the law
    sets: int  # of normal variates that a pose takes, drawn one after the other for all poses
    each: int  # normal variates of a pose in a set
    degrees: np.ndarray = np.empty(0)  # of freedom of the χ² variates that a pose takes


def row_by_row(matrix: np.ndarray, size: int) -> np.ndarray:
    """(size·size,) ``matrix`` (size, size) as the parameters of a law hold it.

    Raises ModelDomainError for a matrix of another size than the arm's joints or task rows.
    """
    if matrix.shape != (size, size):
        raise ModelDomainError(
            f"the model's matrix is not one of the {size} joints or task rows of this arm; run "
            "the stage fit for it",
            shape=matrix.shape,
        )
    return matrix.ravel()


class MotionModel(Protocol):
    """p(q_{k+1} | q_k) for the commanded step v = ẋᵈ_kΔt.

    In every method ``q`` (..., n) are joint angles in rad and ``v`` (m,) or (..., m) or longer is a
    command (:mod:`pipeline.models.commands`). All raise SingularJacobianError where J(q) has no
    inverse, the moments ModelDomainError where they do not exist.
    """

    def law(self, chain: Chain) -> Law:
        """A step of the arm ``chain`` for compiled code, and for
        :func:`pipeline.models.draws.draw_steps`.
        """

    def mean(self, chain: Mechanism, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n) E[q_{k+1} | q_k = q] in rad."""

    def covariance(self, chain: Mechanism, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., n, n) Cov(q_{k+1} | q_k = q) in rad²."""

    def with_trace(
        self, chain: Mechanism, q: np.ndarray, v: np.ndarray, trace: float
    ) -> MotionModel:
        """The same model whose own level (σ_B, α, a factor on a covariance) gives the covariance of
        the steps a mean trace of ``trace`` > 0 in rad².

        Raises ModelDomainError where no level does.
        """

    def sample(
        self, chain: Chain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """(..., n) a draw of q_{k+1} for each of the poses, by NumPy alone: where there is a
        compiler :func:`pipeline.models.draws.draw_steps` draws the same law many times as fast.
        """

    def log_density(
        self,
        chain: Mechanism,
        q: np.ndarray,
        v: np.ndarray,
        q_next: np.ndarray,
        measurement: np.ndarray | None = None,
    ) -> np.ndarray:
        """(...,) ln p(q_{k+1} = q_next | q_k = q), of a density in rad⁻ⁿ, for ``q_next`` (..., n)
        in rad.

        With ``measurement`` (n, n), in rad², of the next pose as it is measured: the step plus N(0,
        measurement), which has a density at every step. Without it, ModelDomainError where the step
        has none: for the matrix models at rest, where they have no noise, and wherever a covariance
        is singular.
        """
