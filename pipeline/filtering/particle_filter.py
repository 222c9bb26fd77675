"""Sequential importance sampling of the joint angles under a stochastic motion model (section
"RMT-based particle filtering").

Particles are moved by the motion model itself (the prior as proposal), weighted by the depth
sensor's likelihood and resampled when few of them carry the weight (Doucet, de Freitas & Gordon
2001). The state lives in D_q, the set within the joint limits and clear of singular poses, where no
motion model is defined: a particle that leaves it has weight zero, so that the posterior is that of
the paths that stay inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.arm.interface import Chain
from pipeline.core.errors import ConfigError, DegenerateFilterError, ModelDomainError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.resampling import SCHEMES
from pipeline.filtering.sampling import sequential_importance_sampling
from pipeline.filtering.start import Start, domain_of, initial_particles
from pipeline.filtering.state import Frames, Particles, Record
from pipeline.filtering.weights import NEAR
from pipeline.models.draws import block_for, space_of
from pipeline.models.model import Commands, MotionModel


@dataclass(frozen=True)
class FilterOptions:
    """How many particles, and when and how they are resampled; ConfigError for a value that does
    not exist.
    """

    particles: int = 1000
    resampling: str = "systematic"
    # share of the particles below which the effective sample size calls for resampling
    threshold: float = 0.5

    def __post_init__(self) -> None:
        if self.particles < 1:
            raise ConfigError(
                "filter.particles: at least one particle is needed", value=self.particles
            )
        if self.resampling not in SCHEMES:
            raise ConfigError(
                f"filter.resampling: no scheme {self.resampling!r}; there are {sorted(SCHEMES)}"
            )
        if not 0.0 <= self.threshold <= 1.0:
            raise ConfigError(
                "filter.threshold: a share of the particles, between 0 and 1", value=self.threshold
            )


@dataclass(frozen=True)
class Posterior:
    """Moments of p(q_k | y up to t_k), Eq. (posterior-expectation), on the grid k = 0 … M, before
    resampling; how the filter fared.
    """

    mean: np.ndarray  # (M+1, n) rad
    covariance: np.ndarray  # (M+1, n, n) rad², about the posterior mean
    ess: np.ndarray  # (M+1,) effective sample size
    resampled: np.ndarray  # (M+1,) bool: the step ended in resampling
    measured: np.ndarray  # (M+1,) bool: at least one measurement entered
    clipped: np.ndarray  # (M+1,) int: particles whose noise covariance the model clipped
    # (M+1,) int: particles that left D_q in the step, and at k = 0 draws rejected because they lay
    # outside
    outside: np.ndarray
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
    """Posterior of the joint angles of one take: Eq. (posterior-expectation) of q_k and of its
    square about the mean.

    Raises DegenerateFilterError where all weights vanish and ModelDomainError for a covariance that
    is none, with take and step. No singular pose meets the model: it is outside D_q. The loop over
    the steps is compiled and lets other threads run; everything random comes from ``rng``, in the
    order of the particles.

    Args:
        model: the motion model that moves the particles.
        chain: the arm, of n joints.
        commands: of M steps, in an open or in a closed loop.
        dt: Δt in s.
        start: law of the first pose.
        measurements: of the take.
        options: how many particles, and how they are resampled.
        rng: of everything random.
    """
    if measurements.tip and isinstance(chain, PlanarChain):
        raise ModelDomainError(
            "a pose of the tip weighs particles of an arm in space, not of one in a plane",
            take=measurements.take,
        )
    frames, left_out = due_frames(measurements, len(commands.v), dt)
    start_poses, rejected = initial_particles(
        start, chain, options.particles, rng, take=measurements.take
    )
    record = empty_record(len(commands.v) + 1, start_poses.shape[-1])
    log_evidence, vanished = sequential_importance_sampling(
        model.law(chain),
        chain.numbers(),
        space_of(chain),
        block_for(chain),
        domain_of(chain),
        Commands(
            *(np.array(rows, dtype=float, order="C") for rows in commands[:2]),
            float(commands.share),
        ),
        frames,
        SCHEMES.index(options.resampling),
        # no effective sample size is below a threshold of 0
        float(options.threshold) if options.resampling != "none" else 0.0,
        particles_at(start_poses),
        record,
        rng,
    )
    if vanished >= 0:
        raise DegenerateFilterError(
            f"all {options.particles} weights vanished: every particle has left the joint limits "
            "or is not finite; "
            "use more particles, resample, or compare the model's noise and the start pose with "
            "the recording",
            take=measurements.take,
            step=vanished,
            time=round(vanished * dt, 6),
        )
    record.outside[0] = rejected
    measured = np.diff(frames.first) > 0
    return Posterior(
        **record._asdict(), measured=measured, left_out=left_out, log_evidence=log_evidence
    )


def particles_at(poses: np.ndarray) -> Particles:
    """The particles at their first ``poses`` (P, n) in rad, where they were before, too."""
    count, n = poses.shape
    q = np.array(poses.T, order="C")
    weights, log_weights = np.empty((2, count))
    chosen, scratch = np.empty(count, dtype=np.int64), np.empty((n + 2, max(count, NEAR)))
    return Particles(q, q.copy(), weights, log_weights, chosen, scratch)


def empty_record(grid: int, n: int) -> Record:
    """For ``grid`` times and n joints: nothing has happened in any of them."""
    clipped, outside = np.zeros((2, grid), dtype=int)
    return Record(
        np.empty((grid, n)),
        np.empty((grid, n, n)),
        np.empty(grid),
        np.zeros(grid, dtype=bool),
        clipped,
        outside,
    )


def due_frames(measurements: Measurements, steps: int, dt: float) -> tuple[Frames, int]:
    """The measurements in the order in which they enter over ``steps`` steps of ``dt`` (s), and how
    many are left out.

    Raises ModelDomainError for an R that is no covariance.
    """
    due, left_out = measurements.schedule(steps, dt)
    order = [(frame, share) for k in sorted(due) for frame, share in due[k]]
    chosen = np.array([frame for frame, _ in order], dtype=int)
    empty = np.empty((0, *measurements.covariance.shape[1:]))
    whitening, log_norm = measurements.whitening if order else (empty, np.empty(0))
    first = np.cumsum([0, *(len(due.get(k, ())) for k in range(steps + 1))])
    share = np.array([share for _, share in order], dtype=float)
    unbiased = measurements.unbiased[chosen]
    frames = Frames(first, share, unbiased, whitening[chosen], log_norm[chosen], measurements.tip)
    return frames, left_out
