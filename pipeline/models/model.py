"""The interface that all motion models share: the law of one step q_{k+1} | q_k."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from pipeline.arm.interface import Chain, Mechanism


class Law(NamedTuple):
    """A step for compiled code (:mod:`pipeline.models.law`)."""

    step: Callable  # makes of random numbers the next poses
    parameters: np.ndarray  # (K,) for it
    # that a pose takes: of all poses of a block one set after the other, and how many in a set
    normals: tuple[int, int]
    degrees: tuple[float, ...] = ()  # of freedom of the χ² variates that a pose takes


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
