"""The synthetic force rig: mobile robots that pull a force/torque transducer by cables tied to one point.

Each wheeled robot loses and regains traction: slips arrive at random, each takes an exponential amount off the tension, which then comes
back exponentially. Each cable's direction wanders as an Ornstein–Uhlenbeck process. A cable cannot push. So tensions are
skewed, correlated in time and bounded below; of a normal law they have the first two moments alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.special import i0e, i1e

from pipeline.errors import ConfigError


@dataclass(frozen=True)
class Robots:
    """What characterises the robots, one value each."""

    tension_sd: tuple[float, ...]  # N, σ_T of the tension's stationary law
    concentration: tuple[float, ...]  # κ of the von Mises law with the direction's mean resultant length
    slip_rate: float = 20.0  # 1/s, slips of one robot; assumed: some per turn of its wheels
    slip_recovery: float = 0.25  # s, time constant of regaining traction; assumed: that of a wheel-speed loop
    wander_time: float = 0.4  # s, correlation time of a cable's direction; assumed: the sway of a taut cable with its robot

    def __post_init__(self) -> None:
        if len(self.tension_sd) != len(self.concentration):
            raise ConfigError("twin.force: tension_sd and concentration need one value per robot each", key="robots")
        if min(self.tension_sd) < 0 or min(self.concentration) <= 0 or min(self.slip_rate, self.slip_recovery, self.wander_time) <= 0:
            raise ConfigError("twin.force: tension_sd must not be negative; concentration, rates and times must be positive", key="robots")


@dataclass(frozen=True)
class Transducer:
    """The force/torque transducer and its acquisition; pairs are (force in N, torque in N·m), equal on the three axes."""

    rate: float = 62.5  # Hz: 1000 Hz at averaging level 16
    noise: tuple[float, float] = (0.00625, 0.0005)  # sd a sample; an ATI Gamma SI-32-2.5 resolves 1/160 N and 1/2000 N·m
    bias: tuple[float, float] = (0.5, 0.02)  # sd of the constant offset of a record; assumed: mounting and temperature, not yet tared
    drift: tuple[float, float] = (2e-4, 1e-5)  # sd of the linear thermal drift, per s; assumed: 0.025 N in two minutes
    lever: tuple[float, float, float] = (0.0, 0.0, 0.03)  # m, from the transducer's origin to the point the cables are tied to

    def __post_init__(self) -> None:
        if self.rate <= 0 or min(*self.noise, *self.bias, *self.drift) < 0:
            raise ConfigError("twin.force: the transducer's rate must be positive; noise, bias and drift not negative", key="transducer")


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


def wander(sd: np.ndarray, correlation_time: float, samples: int, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Stationary Ornstein–Uhlenbeck paths of standard deviation ``sd`` (m,), exact at the sampling instants, (samples, m).

    ``correlation_time`` in s, ``rate`` in Hz; the result has the unit of ``sd``.
    """
    decay = np.exp(-1 / (rate * correlation_time))
    innovation = rng.standard_normal((samples, len(sd))) * sd * np.sqrt(1 - decay**2)
    return _autoregressive(innovation, decay, rng.standard_normal(len(sd)) * sd)


def slipping(sd: np.ndarray, slip_rate: float, recovery: float, samples: int, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Tension lost and regained by wheel slip about its mean, N, (samples, m): of zero mean and standard deviation ``sd`` (m,) in N.

    Slips of exponential size (mean d) arrive at ``slip_rate`` (1/s) and decay with ``recovery`` (s): shot noise whose stationary law is
    Gamma(ν, d) with ν = slip_rate·recovery, so d = sd/√ν, and whose skewness −2/√ν the tension carries. The process is exact at the
    sampling instants of ``rate`` (Hz): each slip has decayed since the instant it came.
    """
    nu = slip_rate * recovery
    size = sd / np.sqrt(nu)
    lost = np.zeros((samples, len(sd)))
    for robot in range(len(sd)):
        step = np.repeat(np.arange(samples), rng.poisson(slip_rate / rate, samples))
        decayed = rng.exponential(size=len(step)) * np.exp(-rng.uniform(size=len(step)) / (rate * recovery))
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
    """A record of ``tare`` seconds without load and ``duration`` seconds in which the robots pull with mean ``tension`` (m,) in N.

    ``direction`` (m,) in rad are the cables' mean directions in the transducer's x–y plane. A normal angle of variance s² has the mean
    resultant length exp(−s²/2); s is chosen so that it is the von Mises law's, I₁(κ)/I₀(κ). Raises ConfigError where robots, tensions and
    directions differ in number, or for times that make no record.
    """
    tension, direction = np.asarray(tension, dtype=float), np.asarray(direction, dtype=float)
    if not len(tension) == len(direction) == len(robots.tension_sd):
        raise ConfigError(
            f"twin.force: {len(robots.tension_sd)} robots, {len(tension)} tensions and {len(direction)} directions; one each is needed"
        )
    if tare < 0 or duration <= 0:
        raise ConfigError(f"twin.force: a tare interval of {tare} s and a load of {duration} s make no record", key="duration")
    samples = round((tare + duration) * transducer.rate)
    time = np.arange(samples) / transducer.rate
    unloaded = time < tare
    concentration = np.asarray(robots.concentration)
    direction_sd = np.sqrt(-2 * np.log(i1e(concentration) / i0e(concentration)))
    directions = direction + wander(direction_sd, robots.wander_time, samples, transducer.rate, rng)
    pull = tension + slipping(np.asarray(robots.tension_sd), robots.slip_rate, robots.slip_recovery, samples, transducer.rate, rng)
    pull[unloaded] = 0.0
    slack = int(np.sum(pull < 0))
    pull = np.maximum(pull, 0.0)
    force = np.stack([np.sum(pull * np.cos(directions), axis=1), np.sum(pull * np.sin(directions), axis=1), np.zeros(samples)], axis=1)
    channels = (force, np.cross(transducer.lever, force))
    measured = [
        true
        + rng.normal(0.0, transducer.bias[i], 3)
        + rng.normal(0.0, transducer.drift[i], 3) * time[:, None]
        + rng.normal(0.0, transducer.noise[i], true.shape)
        for i, true in enumerate(channels)
    ]
    return ForceRecord(time, *measured, pull, directions, slack)
