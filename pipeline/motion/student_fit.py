"""Maximum-likelihood fit of the Student noise to steps that carry measurement noise of known covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.errors import ModelDomainError
from pipeline.motion.additive_fit import fit_additive, second_moment
from pipeline.motion.density import principal_axes
from pipeline.motion.semidefinite import minimise
from pipeline.motion.student_density import mean_slopes

DEGREES = (0.5, 1e4)  # interval of ν: from tails heavier than Cauchy's to a Gaussian to four digits
# variance of Λ and of the measurement together, as a share of the noise's, that is singular but for rounding
SINGULAR = 1e-12


@dataclass(frozen=True)
class StudentFit:
    """Maximum of the likelihood; log likelihoods are means per step in nats, of densities in rad⁻³."""

    nu: float
    scale: np.ndarray  # (3, 3) Λ, rad²
    at_end: bool  # ν at an end of its interval: as good as Gaussian above, below most of the noise is nothing beside the rest
    log_likelihood: float
    additive_log_likelihood: float  # of the additive model fitted to the same noise


def fit_student(noise: np.ndarray, measurement: np.ndarray, near: StudentFit | None = None) -> StudentFit:
    """ν and Λ ⪰ 0 of greatest likelihood for ``noise`` ω (..., 3) in rad, ω ~ t_ν(0, Λ) + N(0, Σ_m), Σ_m = ``measurement`` (3, 3) in rad².

    ω is taken as it is, not about its mean: no model of the step has a mean of its own. The search is in Λ and 1/ν, in which the
    likelihood of nearly Gaussian noise is a straight line, so that it ends where ν does; the likelihood and its slopes are exact to
    1e-10 (:mod:`pipeline.motion.student_density`). Λ may be singular at the maximum. It starts at the fit ``near``, that of like noise,
    where there is one.

    Raises ModelDomainError where the likelihood has no bound: where the ω that have no measurement noise lie in one plane, or a share of
    them of (ν+d)/(ν+3) or more in a space of d dimensions (Kent and Tyler 1991), ν the least of its interval, which is tested for ω = 0
    and for ω_j = 0 of each joint. Raises SolverError where the search does not end at an optimum.
    """
    _ = principal_axes(measurement)  # refuses what is not a covariance
    _ = second_moment(noise, measurement)  # refuses noise in a plane
    sizes, least = np.abs(noise.reshape(-1, 3)), DEGREES[0]
    # each joint in units of its usual noise, as a search needs it
    units = np.sqrt(np.quantile(sizes, (least + 2) / (least + 3), axis=0) ** 2 + np.diag(measurement))
    zero = float(np.mean(~np.any(sizes, axis=-1)))
    if not np.all(units > 0) or (not np.any(measurement) and zero >= least / (least + 3)):
        raise ModelDomainError("too much of the noise is exactly zero: the likelihood of a Student law has no bound", share=zero)
    outer = np.outer(units, units)
    w, added = noise.reshape(-1, 3) / units, measurement / outer

    def loss(matrices: list[np.ndarray], numbers: np.ndarray) -> tuple[float, list[np.ndarray], np.ndarray]:
        (scale,), nu = matrices, 1 / numbers[0]
        if np.linalg.eigvalsh(scale + added)[0] < SINGULAR:
            return np.inf, [np.zeros((3, 3))], np.zeros(1)
        found = mean_slopes(w, nu, scale, added)
        return -found.mean, [-found.by_scale], np.array([nu**2 * found.by_nu])

    interval = 1 / np.array(DEGREES[::-1])
    start = (np.eye(3), 0.1) if near is None else (near.scale / outer, 1 / near.nu)
    found = minimise(loss, [start[0]], [start[1]], [tuple(interval)])
    tail = found.numbers[0]
    at_end = bool(np.min(np.abs(np.log(interval / tail))) < 1e-3)
    additive = fit_additive(noise, measurement).log_likelihood
    return StudentFit(float(1 / tail), found.matrices[0] * outer, at_end, float(-found.value - np.log(units).sum()), additive)
