"""Sequential importance sampling of the joint angles under a stochastic motion model (section
"RMT-based particle filtering"), for any arm and any measurement.

The motion model is the proposal (Doucet, de Freitas & Gordon 2001). The state lives in D_q, within
the joint limits and clear of singular poses, where no motion model is defined: a particle that
leaves it has weight zero, so that the posterior is the one of the paths that stay inside.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import SINGULAR_SINE, PlanarChain
from pipeline.arm.interface import Chain
from pipeline.core.errors import DegenerateFilterError, ModelDomainError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.resampling import SCHEMES
from pipeline.filtering.sampling import Domain, sequential_importance_sampling
from pipeline.models.draws import block_for, space_of
from pipeline.models.model import Commands, MotionModel


@dataclass(frozen=True)
class FilterOptions:
    """Number and resampling of particles."""

    particles: int = 1000
    resampling: str = "systematic"  # one of SCHEMES
    threshold: float = 0.5  # share of the particles below which the effective sample size resamples


@dataclass(frozen=True)
class Start:
    """The normal law of the first pose, as the training takes have it; it is restricted to D_q."""

    mean: np.ndarray  # (n,) rad
    covariance: np.ndarray  # (n, n) rad², singular allowed


@dataclass(frozen=True)
class Posterior:
    """Moments of p(q_k | y up to t_k), Eq. (posterior-expectation), on the grid k = 0 … M, before
    resampling; and the course of the filter.
    """

    mean: np.ndarray  # (M+1, n) rad
    covariance: np.ndarray  # (M+1, n, n) rad², about the posterior mean
    ess: np.ndarray  # (M+1,) effective sample size
    resampled: np.ndarray  # (M+1,) bool: the step ended in resampling
    clipped: np.ndarray  # (M+1,) int: particles whose noise covariance the model clipped
    # (M+1,) int: particles that left D_q in the step; at k = 0 rejected draws of the first pose
    outside: np.ndarray
    measured: np.ndarray  # (M+1,) bool: at least one measurement entered
    left_out: int  # measurements before the start or after the end of the motion
    # logarithm of the unbiased estimate of p(all measurements, path inside D_q)
    log_evidence: float


def particle_filter(
    model: MotionModel,
    chain: Chain,
    commands: Commands,
    dt: float,
    start: Start,
    measurements: Measurements,
    options: FilterOptions,
    rng: np.random.Generator,
) -> Posterior:
    """Return the posterior of the joint angles of one take: Eq. (posterior-expectation) of q_k and
    of its square about the mean.

    ``commands`` are of M steps of ``dt`` (s), in an open or in a closed loop; all random numbers
    come from ``rng``, in the order of the particles. Raises DegenerateFilterError where all weights
    vanish and ModelDomainError for a covariance that is none, with take and step.
    """
    if measurements.tip and isinstance(chain, PlanarChain):
        message = "a pose of the tip weighs particles of an arm in space, not of one in a plane"
        raise ModelDomainError(message, take=measurements.take)
    frames = measurements.frames(len(commands.v), dt)
    poses, rejected = initial_particles(start, chain, options.particles, rng, measurements.take)
    rows = [np.array(each, dtype=float, order="C") for each in commands[:2]]
    record, log_evidence, vanished = sequential_importance_sampling(
        model.law(chain),
        chain.numbers(),
        space_of(chain),
        block_for(chain),
        domain_of(chain),
        Commands(*rows, float(commands.share)),
        frames,
        SCHEMES.index(options.resampling),
        # no effective sample size is below a threshold of 0
        float(options.threshold) if options.resampling != "none" else 0.0,
        np.array(poses.T, order="C"),
        rng,
    )
    if vanished >= 0:
        raise DegenerateFilterError(
            f"all {options.particles} weights vanished: every particle has left the joint limits "
            "or is not finite; use more particles, or compare the model's noise and the start pose "
            "with the recording",
            take=measurements.take,
            step=vanished,
            time=round(vanished * dt, 6),
        )
    record[-1][0] = rejected
    left_out = len(measurements.t) - len(frames.share)
    return Posterior(*record, np.diff(frames.first) > 0, left_out, log_evidence)


def domain_of(chain: Chain) -> Domain:
    """D_q of ``chain``."""
    planar = isinstance(chain, PlanarChain)
    straight, clearance = (chain.straight, np.arcsin(SINGULAR_SINE)) if planar else (0.0, 0.0)
    lower, upper = (np.array(each, dtype=float) for each in (chain.lower, chain.upper))
    return Domain(lower, upper, straight, float(clearance))


def initial_particles(
    start: Start, chain: Chain, count: int, rng: np.random.Generator, take: str
) -> tuple[np.ndarray, int]:
    """Return (count, n) draws of the start's law within D_q, and the number of rejected ones.

    Raises ModelDomainError for moments that no normal law has, and DegenerateFilterError where
    ``count`` draws in a row lie outside.
    """
    if not np.isfinite(start.covariance).all():
        message = "the covariance of the start poses is not finite; give two training takes"
        raise ModelDomainError(message, take=take)
    variances, axes = np.linalg.eigh(start.covariance)
    # rounding leaves the zero eigenvalues of a singular covariance slightly negative
    root, poses, rejected = axes * np.sqrt(np.maximum(variances, 0.0)), start.mean[None][:0], 0
    while len(poses) < count:
        normals = rng.standard_normal((count, len(variances)))
        draws = start.mean + (root * normals[:, None]).sum(axis=-1)
        inside = draws[chain.within_limits(draws) & ~chain.singular(draws)]
        if len(inside) == 0:
            raise DegenerateFilterError(
                f"none of {count} start poses lies within the joint limits; compare the training "
                "takes' start with the URDF's limits",
                take=take,
                step=0,
                mean=start.mean.round(4).tolist(),
            )
        rejected += count - len(inside)
        poses = np.concatenate([poses, inside])[:count]
    return poses, rejected
