"""The synthetic force rig: mobile robots that pull a force/torque transducer by cables tied to one
point.

Each wheeled robot loses and regains traction: slips arrive at random, each takes an exponential
amount off the tension, which then comes back exponentially. Each cable's direction wanders as an
Ornstein–Uhlenbeck process. A cable cannot push. So tensions are skewed, correlated in time and
bounded below; of a normal law they have the first two moments alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.special import i0e, i1e

from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import Robots, Transducer


@dataclass(frozen=True)
class ForceRecord:
    """One record as the transducer gave it, and what it stood for."""

    time: np.ndarray  # (N,) s
    force: np.ndarray  # (N, 3) N, with bias, drift and noise
    torque: np.ndarray  # (N, 3) N·m, likewise
    tension: np.ndarray  # (N, m) N, true; 0 in the tare interval
    direction: np.ndarray  # (N, m) rad, true
    slack: int  # samples of a loaded cable whose tension would have been negative


def _autoregressive(innovation: np.ndarray, decay: float, start: np.ndarray) -> np.ndarray:
    """x_k = decay·x_{k−1} + innovation_k, from x_{−1} = ``start`` (m,); all (N, m)."""
    return lfilter([1.0], [1.0, -decay], innovation, axis=0, zi=decay * start[None])[0]


def wander(
    sd: np.ndarray, correlation_time: float, samples: int, rate: float, rng: np.random.Generator
) -> np.ndarray:
    """Stationary Ornstein–Uhlenbeck paths of standard deviation ``sd`` (m,), exact at the sampling
    instants, (samples, m).

    ``correlation_time`` in s, ``rate`` in Hz; the result has the unit of ``sd``.
    """
    decay = np.exp(-1 / (rate * correlation_time))
    innovation = rng.standard_normal((samples, len(sd))) * sd * np.sqrt(1 - decay**2)
    return _autoregressive(innovation, decay, rng.standard_normal(len(sd)) * sd)


def slipping(
    sd: np.ndarray,
    slip_rate: float,
    recovery: float,
    samples: int,
    rate: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Tension lost and regained by wheel slip about its mean, N, (samples, m): of zero mean and
    standard deviation ``sd`` (m,) in N.

    Slips of exponential size (mean d) arrive at ``slip_rate`` (1/s) and decay with ``recovery``
    (s): shot noise whose stationary law is Gamma(ν, d) with ν = slip_rate·recovery, so d = sd/√ν,
    and whose skewness −2/√ν the tension carries. The process is exact at the sampling instants of
    ``rate`` (Hz): each slip has decayed since the instant it came.
    """
    nu = slip_rate * recovery
    size = sd / np.sqrt(nu)
    lost = np.zeros((samples, len(sd)))
    for robot in range(len(sd)):
        step = np.repeat(np.arange(samples), rng.poisson(slip_rate / rate, samples))
        decayed = rng.exponential(size=len(step)) * np.exp(
            -rng.uniform(size=len(step)) / (rate * recovery)
        )
        lost[:, robot] = np.bincount(step, decayed, samples)
    paths = _autoregressive(lost, np.exp(-1 / (rate * recovery)), rng.gamma(nu, size=len(sd)))
    return size * (nu - paths)


def record_force(
    tension: np.ndarray,
    direction: np.ndarray,
    robots: Robots,
    transducer: Transducer,
    tare: float,
    duration: float,
    rng: np.random.Generator,
) -> ForceRecord:
    """A record of ``tare`` seconds without load and ``duration`` seconds in which the robots pull
    with mean ``tension`` (m,) in N.

    ``direction`` (m,) in rad are the cables' mean directions in the transducer's x–y plane. A
    normal angle of variance s² has the mean resultant length exp(−s²/2); s is chosen so that it is
    the von Mises law's, I₁(κ)/I₀(κ). Raises ConfigError where robots, tensions and directions
    differ in number, or for times that make no record.
    """
    tension, direction = np.asarray(tension, dtype=float), np.asarray(direction, dtype=float)
    if not len(tension) == len(direction) == len(robots.tension_sd):
        raise ConfigError(
            f"laboratory.force: {len(robots.tension_sd)} robots, {len(tension)} tensions and "
            f"{len(direction)} directions; one each is needed"
        )
    if tare < 0 or duration <= 0:
        raise ConfigError(
            f"laboratory.force: a tare interval of {tare} s and a load of {duration} s make no "
            "record",
            key="duration",
        )
    samples = round((tare + duration) * transducer.rate)
    time = np.arange(samples) / transducer.rate
    unloaded = time < tare
    concentration = np.asarray(robots.concentration)
    direction_sd = np.sqrt(-2 * np.log(i1e(concentration) / i0e(concentration)))
    directions = direction + wander(direction_sd, robots.wander_time, samples, transducer.rate, rng)
    pull = tension + slipping(
        np.asarray(robots.tension_sd),
        robots.slip_rate,
        robots.slip_recovery,
        samples,
        transducer.rate,
        rng,
    )
    pull[unloaded] = 0.0
    slack = int(np.sum(pull < 0))
    pull = np.maximum(pull, 0.0)
    force = np.stack(
        [
            np.sum(pull * np.cos(directions), axis=1),
            np.sum(pull * np.sin(directions), axis=1),
            np.zeros(samples),
        ],
        axis=1,
    )
    channels = (force, np.cross(transducer.lever, force))
    measured = [
        true
        + rng.normal(0.0, transducer.bias[i], 3)
        + rng.normal(0.0, transducer.drift[i], 3) * time[:, None]
        + rng.normal(0.0, transducer.noise[i], true.shape)
        for i, true in enumerate(channels)
    ]
    return ForceRecord(time, *measured, pull, directions, slack)
