"""The interface that the three motion models share: the law of one step q_{k+1} | q_k."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from pipeline.arm.chain import PlanarChain


class Law(NamedTuple):
    """:meth:`MotionModel.sample` for compiled code (:mod:`pipeline.motion.compiled.law`)."""

    step: Callable  # makes of random numbers the next poses
    parameters: np.ndarray  # (K,) for it
    normals: tuple[int, int]  # that a particle takes: of all particles one set after the other, and how many of each in a set
    degrees: float = 0.0  # of freedom of the one χ² variate that a particle takes; 0 for none


class MotionModel(Protocol):
    """p(q_{k+1} | q_k) for the commanded step v = ẋᵈ_kΔt.

    In every method ``q`` (..., 3) are joint angles in rad and ``v`` (3,) or (..., 3) is in m, m, rad. All raise
    SingularJacobianError where J(q) has no inverse, the moments ModelDomainError where they do not exist.
    """

    def sample(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, int]:
        """(..., 3) one draw of q_{k+1} for each q, and for how many of them the noise had to be clipped at zero."""

    def law(self) -> Law:
        """:meth:`sample` for compiled code."""

    def mean(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3) E[q_{k+1} | q_k = q] in rad."""

    def covariance(self, chain: PlanarChain, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(..., 3, 3) Cov(q_{k+1} | q_k = q) in rad²."""

    def log_density(
        self, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray | None = None
    ) -> np.ndarray:
        """(...,) ln p(q_{k+1} = q_next | q_k = q), of a density in rad⁻³, for ``q_next`` (..., 3) in rad.

        With ``measurement`` (3, 3), in rad², of the next pose as it is measured: the step plus N(0, measurement), which has a density
        at every step. Without it, ModelDomainError where the step has none: for the matrix models at rest, where they have no noise,
        and wherever a covariance is singular.
        """
