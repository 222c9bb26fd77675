"""Additive Gaussian model: q_{k+1} = q_k + J(q_k)⁺ẋᵈ_kΔt + ω_{k+1}, ω ~ N(0, Σ_ω) (Eq.
InvDiffRndm): the speed-scaled law without the noise that grows with speed.
"""

from typing import Any

import numpy as np

from pipeline.models.scaled.law import ScaledModel


def build(parameters: dict[str, Any]) -> ScaledModel:
    """Build the model of Eq. (InvDiffRndm) from its ``noise_covariance`` Σ_ω in rad²."""
    return ScaledModel(np.array(parameters["noise_covariance"]))
