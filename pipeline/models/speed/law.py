"""Speed law: the noise of a joint depends on its commanded step alone, with no Jacobian. It is a
control of the models whose noise depends on the Jacobian (Harris and Wolpert, Nature 394, 1998).
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError
from pipeline.models.model import MotionModel, Traits, trace_factor


@dataclass(frozen=True)
class SpeedModel(MotionModel):
    """Model ω_j ~ N(0, a_j + b_j Δ_j²) of independent joints; Δ_j (rad) is the commanded step of
    joint j, ``rest`` a (n,) in rad², ``growth`` b (n,). Raises ModelDomainError for a negative one.
    """

    traits: ClassVar = Traits(noisy_at_rest=True, needs_jacobian=False, compiled=False)
    rest: ndarray
    growth: ndarray

    def __post_init__(self) -> None:
        numbers = np.concatenate([self.rest, self.growth])
        if not np.all(np.isfinite(numbers) & (numbers >= 0)):
            message = "variances at rest and their growth must be finite and >= 0"
            raise ModelDomainError(message, numbers=numbers.tolist())

    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        return diagonal(self.variances(chain.nominal_step(q, v)))

    def variances(self, steps: ndarray) -> ndarray:
        """(..., n) variances of ω in rad² at the commanded ``steps`` (..., n) in rad."""
        return self.rest + self.growth * steps**2

    def with_trace(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        trace: float,
    ) -> "SpeedModel":
        """Return the model with both variances times a factor; ModelDomainError for no noise."""
        factor = trace_factor(self.covariance(chain, q, v), trace)
        return SpeedModel(factor * self.rest, factor * self.growth)


def diagonal(variances: ndarray) -> ndarray:
    """(..., n, n) covariances of independent joints with ``variances`` (..., n)."""
    return variances[..., None] * np.eye(variances.shape[-1])


def build(parameters: dict[str, Any]) -> SpeedModel:
    """Build the model from ``rest_variance`` in rad² and ``growth``, a number for each joint."""
    rest = np.array(parameters["rest_variance"], float)
    return SpeedModel(rest, np.array(parameters["growth"], float))
