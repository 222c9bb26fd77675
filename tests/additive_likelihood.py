"""The likelihood of additive noise at its maximum, in closed form: what the search for noise that
grows with speed is held against.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from pipeline.models.normal import principal_axes
from pipeline.models.scaled.fit import second_moment


@dataclass(frozen=True)
class AdditiveFit:
    """Maximum of the likelihood; the log likelihood is the mean per step in nats, of a density in
    rad⁻³.
    """

    covariance: np.ndarray  # (3, 3) Σ_ω, rad²
    quiet: int  # axes along which Σ_ω is zero: the noise there is no greater than the measurement's
    log_likelihood: float


def fit_additive(noise: np.ndarray, measurement: np.ndarray) -> AdditiveFit:
    """Σ_ω ⪰ 0 of greatest likelihood for ``noise`` ω (..., 3) in rad, ω ~ N(0, Σ_ω + Σ_m), Σ_m =
    ``measurement`` (3, 3) in rad².

    With C = mean(ωωᵀ), about zero and not about its mean, and the axes in which C = diag(c), Σ_m =
    diag(m) and c + m = 1, the maximum is Σ_ω + Σ_m = diag(max(c, m)): the likelihood is concave in
    (Σ_ω + Σ_m)⁻¹, and this meets its first-order condition on the convex set (Σ_ω + Σ_m)⁻¹ ⪯ Σ_m⁻¹.
    Raises ModelDomainError where C + Σ_m is singular or not finite.
    """
    _ = principal_axes(measurement)  # refuses what is not a covariance
    both = second_moment(noise, measurement) + measurement
    shares, axes = eigh(measurement, both)
    m, c = np.maximum(shares, 0.0), np.maximum(1 - shares, 0.0)
    total, back = np.maximum(c, m), both @ axes
    log_likelihood = -0.5 * (
        3 * np.log(2 * np.pi) + np.linalg.slogdet(both)[1] + np.sum(np.log(total) + c / total)
    )
    return AdditiveFit(
        (back * (total - m)) @ back.T, int(np.count_nonzero(c <= m)), float(log_likelihood)
    )
