"""Sequential importance sampling of the joint angles under a stochastic motion model (section "RMT-based particle filtering").

Particles are moved by the motion model itself (the prior as proposal), weighted by the depth sensor's likelihood and resampled when few
of them carry the weight (Doucet, de Freitas & Gordon 2001). The state lives in D_q, the set within the joint limits and clear of
singular poses, where no motion model is defined: a particle that leaves it has weight zero, so that the posterior is that of the
paths that stay inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ConfigError, DegenerateFilterError, ModelDomainError, SingularJacobianError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.resampling import SCHEMES, effective_sample_size
from pipeline.motion.model import MotionModel


@dataclass(frozen=True)
class FilterOptions:
    """How many particles, and when and how they are resampled; ConfigError for a value that does not exist."""

    particles: int = 1000
    resampling: str = "systematic"
    threshold: float = 0.5  # share of the particles below which the effective sample size calls for resampling

    def __post_init__(self) -> None:
        if self.particles < 1:
            raise ConfigError("filter.particles: at least one particle is needed", found=self.particles)
        if self.resampling not in SCHEMES:
            raise ConfigError(f"filter.resampling: no scheme {self.resampling!r}; there are {sorted(SCHEMES)}")
        if not 0.0 <= self.threshold <= 1.0:
            raise ConfigError("filter.threshold: a share of the particles, between 0 and 1", found=self.threshold)


@dataclass(frozen=True)
class Start:
    """The normal law of the first pose, as the training takes have it; it is restricted to D_q."""

    mean: np.ndarray  # (3,) rad
    covariance: np.ndarray  # (3, 3) rad², singular allowed


@dataclass(frozen=True)
class Posterior:
    """Moments of p(q_k | y up to t_k) on the grid k = 0 … M, formed before resampling, and how the filter fared."""

    mean: np.ndarray  # (M+1, 3) rad
    covariance: np.ndarray  # (M+1, 3, 3) rad², about the posterior mean
    ess: np.ndarray  # (M+1,) effective sample size
    resampled: np.ndarray  # (M+1,) bool: the step ended in resampling
    measured: np.ndarray  # (M+1,) bool: at least one measurement entered
    clipped: np.ndarray  # (M+1,) int: particles whose noise covariance the model clipped
    outside: np.ndarray  # (M+1,) int: particles that left D_q in the step, and at k = 0 draws rejected because they lay outside
    left_out: int  # measurements before the start or after the end of the motion
    log_evidence: float  # logarithm of the unbiased estimate of p(all measurements, path inside D_q)


def particle_filter(
    model: MotionModel,
    chain: PlanarChain,
    steps: np.ndarray,
    dt: float,
    start: Start,
    measurements: Measurements,
    options: FilterOptions,
    rng: np.random.Generator,
) -> Posterior:
    """Posterior of the joint angles of one take.

    ``steps`` (M, 3) are the commanded task-space steps ẋᵈ_kΔt (m, m, rad), ``dt`` is Δt in s. Raises DegenerateFilterError where all
    weights vanish, ModelDomainError for a covariance that is none, and the model's SingularJacobianError, with take and step.
    """
    grid, count = len(steps) + 1, options.particles
    resample = SCHEMES[options.resampling]
    due, left_out = measurements.schedule(len(steps), dt)
    mean, covariance, ess = np.empty((grid, 3)), np.empty((grid, 3, 3)), np.empty(grid)
    resampled, measured = np.zeros((2, grid), dtype=bool)
    clipped, outside = np.zeros((2, grid), dtype=int)
    log_evidence = 0.0

    uniform = np.full(count, 1.0 / count)
    log_uniform = np.log(uniform)
    weights, log_weights = uniform, log_uniform
    q, outside[0] = initial_particles(start, chain, count, rng, take=measurements.take)
    before = q
    for k in range(grid):
        if k > 0:
            before = q
            try:
                q, clipped[k] = model.sample(chain, before, steps[k - 1], rng)
            except SingularJacobianError as error:
                raise SingularJacobianError(error.message, **error.evidence | {"take": measurements.take, "step": k}) from None
            gone = ~chain.within_limits(q) | chain.singular(q)
            if gone.any():
                outside[k] = np.sum(gone & (log_weights > -np.inf))
                log_weights = np.where(gone, -np.inf, log_weights)
                # of weight zero, they wait inside D_q: the model is not asked about poses that the arm cannot take
                q = np.where(gone[:, None], before, q)

        frames = due.get(k, ())
        measured[k] = len(frames) > 0
        for frame, share in frames:
            log_weights = log_weights + measurements.log_likelihood(frame, before + share * (q - before))
        if frames or outside[k]:
            weights, log_weights, log_total = _normalised(log_weights, take=measurements.take, step=k, time=k * dt)
            log_evidence += log_total

        mean[k], covariance[k] = weighted_moments(weights, q)
        ess[k] = effective_sample_size(weights)
        if resample is not None and ess[k] < options.threshold * count:
            q = q[resample(weights, rng)]
            weights, log_weights = uniform, log_uniform
            resampled[k] = True
    return Posterior(mean, covariance, ess, resampled, measured, clipped, outside, left_out, log_evidence)


def initial_particles(start: Start, chain: PlanarChain, count: int, rng: np.random.Generator, *, take: str) -> tuple[np.ndarray, int]:
    """(count, 3) draws of the start's normal law within the joint limits, and how many draws were rejected.

    Raises ModelDomainError for moments that no normal law has, and DegenerateFilterError where ``count`` draws in a row lie outside.
    """
    if not (np.isfinite(start.mean).all() and np.isfinite(start.covariance).all()):
        raise ModelDomainError("the mean or covariance of the start poses is not finite; give at least two training takes", take=take)
    variances, axes = np.linalg.eigh(start.covariance)
    # rounding leaves the zero eigenvalues of a singular covariance slightly negative
    if variances[0] < -1e-9 * variances[-1]:
        raise ModelDomainError("the covariance of the start poses has a negative eigenvalue", take=take, eigenvalue=float(variances[0]))
    root = axes * np.sqrt(np.maximum(variances, 0.0))
    found, rejected = np.empty((0, 3)), 0
    while len(found) < count:
        draws = start.mean + rng.standard_normal((count, 3)) @ root.T
        inside = chain.within_limits(draws) & ~chain.singular(draws)
        if not inside.any():
            raise DegenerateFilterError(
                f"none of {count} start poses lies within the joint limits; compare the training takes' start with the URDF's limits",
                take=take, step=0, mean=start.mean.round(4).tolist(),
            )  # fmt: skip
        rejected += int(np.sum(~inside))
        found = np.concatenate([found, draws[inside]])
    return found[:count], rejected


def weighted_moments(weights: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(3,) mean and (3, 3) covariance about that mean of particles ``q`` (P, 3) under normalised ``weights`` (P,)."""
    mean = weights @ q
    centred = q - mean
    return mean, (weights * centred.T) @ centred


def _normalised(log_weights: np.ndarray, *, take: str, step: int, time: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Weights, log-weights and log-sum of unnormalised ``log_weights`` (P,), by log-sum-exp."""
    peak = log_weights.max()
    if not np.isfinite(peak):
        raise DegenerateFilterError(
            f"all {len(log_weights)} weights vanished: every particle has left the joint limits or is not finite; "
            "use more particles, resample, or compare the model's noise and the start pose with the recording",
            take=take, step=step, time=round(time, 6),
        )  # fmt: skip
    weights = np.exp(log_weights - peak)
    total = weights.sum()
    log_total = peak + np.log(total)
    return weights / total, log_weights - log_total, float(log_total)
