"""Synthetic force rig: robots that pull a force/torque transducer by cables, in a plane or in
space. Wheel slips occur at random, reduce the tension by an exponential amount and recover, so that
tensions are skewed and correlated in time. Directions are Ornstein–Uhlenbeck processes.
"""

from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.special import dawsn, i0e, i1e

from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Arrangement
from pipeline.laboratory.options import Robots, Transducer


class RiggedForce(NamedTuple):
    """One record of the transducer, and the true tensions and directions."""

    time: np.ndarray  # (N,) s
    force: np.ndarray  # (N, 3) N, with bias, drift and noise
    torque: np.ndarray  # (N, 3) N·m, with bias, drift and noise
    tension: np.ndarray  # (N, m) N, true; 0 in the tare interval
    # (N, m, 3) true unit vectors from the platform along the cables
    direction: np.ndarray


def _autoregressive(
    innovation: np.ndarray,
    decay: float,
    start: np.ndarray,
) -> np.ndarray:
    """Return x (N, m), x_k = decay·x_{k−1} + innovation_k, with x_{−1} = ``start`` (m,)."""
    from scipy.signal import lfilter

    before = decay * start[None]
    path, _ = lfilter([1.0], [1.0, -decay], innovation, axis=0, zi=before)
    return path


def wander(
    sd: np.ndarray,
    correlation_time: float,
    samples: int,
    rate: float,
    rng: Generator,
) -> np.ndarray:
    """Draw exact Ornstein–Uhlenbeck paths (samples, m) of standard deviation ``sd`` (m,)."""
    decay = np.exp(-1 / (rate * correlation_time))
    variates = rng.standard_normal((samples, len(sd)))
    innovation = variates * sd * np.sqrt(1 - decay**2)
    start = rng.standard_normal(len(sd)) * sd
    return _autoregressive(innovation, decay, start)


def slipping(
    sd: np.ndarray,
    robots: Robots,
    samples: int,
    rate: float,
    rng: Generator,
) -> np.ndarray:
    """Draw the deviation (samples, m) in N of the tension from its mean by wheel slip, with
    standard deviation ``sd`` (m,): shot noise, exact in law at ``rate`` (Hz). The loss of tension
    has the stationary law Gamma(ν, sd/√ν) with ν = slip_rate · slip_recovery; the skewness of the
    tension is −2/√ν.
    """
    nu = robots.slip_rate * robots.slip_recovery
    fade = rate * robots.slip_recovery
    lost = np.zeros((samples, len(sd)))
    for robot in range(len(sd)):
        slips = rng.poisson(robots.slip_rate / rate, samples)
        step = np.repeat(np.arange(samples), slips)
        loss = rng.exponential(size=len(step))
        since = rng.uniform(size=len(step))  # part of a sample from the slip to its end
        remaining = loss * np.exp(-since / fade)
        lost[:, robot] = np.bincount(step, remaining, samples)
    start = rng.gamma(nu, size=len(sd))
    paths = _autoregressive(lost, np.exp(-1 / fade), start)
    return sd / np.sqrt(nu) * (nu - paths)


def directions(
    cables: Arrangement,
    robots: Robots,
    samples: int,
    rate: float,
    rng: Generator,
) -> np.ndarray:
    """Draw unit vectors (samples, m, 3) that wander about the mean directions of ``cables``, with
    the mean resultant length of a von Mises–Fisher law of concentration κ (option of the robots).

    In a plane, an angle of variance s² has the mean resultant length exp(−s²/2) = I₁(κ)/I₀(κ). In
    space, two angles rotate the cable up and sideways. The resulting angle has a Rayleigh law, with
    E[cos] = 1 − √2·s·D(s/√2) = coth κ − 1/κ and Dawson's function D.
    """
    azimuth = np.asarray(cables.direction, dtype=float)
    concentration = np.asarray(robots.concentration)
    if cables.elevation is None:
        length = i1e(concentration) / i0e(concentration)
        sd = np.sqrt(-2 * np.log(length))
        angle = azimuth + wander(sd, robots.wander_time, samples, rate, rng)
        level = np.zeros_like(angle)
        return np.stack([np.cos(angle), np.sin(angle), level], axis=-1)
    sd = np.array([_angle_in_space(kappa) for kappa in concentration])
    up = wander(sd, robots.wander_time, samples, rate, rng)[..., None]
    aside = wander(sd, robots.wander_time, samples, rate, rng)[..., None]
    mean, upwards, sideways = _cable_axes(azimuth, np.asarray(cables.elevation))
    size = np.hypot(up, aside)
    turned = up * upwards + aside * sideways
    return np.cos(size) * mean + np.sinc(size / np.pi) * turned


def _cable_axes(azimuth: np.ndarray, elevation: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return unit vectors (m, 3) along the cables, and perpendicular to them, upwards and to the
    side, from ``azimuth`` and ``elevation`` (m,) in rad.
    """
    ca = np.cos(azimuth)
    sa = np.sin(azimuth)
    ce = np.cos(elevation)
    se = np.sin(elevation)
    along = np.column_stack([ce * ca, ce * sa, se])
    upwards = np.column_stack([-se * ca, -se * sa, ce])
    sideways = np.column_stack([-sa, ca, np.zeros_like(sa)])
    return along, upwards, sideways


def _angle_in_space(kappa: float) -> float:
    """Return s in rad, the standard deviation of both angles in space for κ = ``kappa``."""
    from scipy.optimize import brentq

    length = 1 / np.tanh(kappa) - 1 / kappa

    def excess(s: float) -> float:
        return 1 - np.sqrt(2) * s * dawsn(s / np.sqrt(2)) - length

    return brentq(excess, 1e-9, 1.5)


def record_force(
    cables: Arrangement,
    robots: Robots,
    transducer: Transducer,
    tare: float,
    duration: float,
    rng: Generator,
) -> RiggedForce:
    """Draw a record of ``tare`` s without load and ``duration`` s with load; ConfigError for
    unequal numbers of robots and cables.
    """
    tension = np.asarray(cables.tension, dtype=float)
    sd = np.asarray(robots.tension_sd)
    if len(sd) != len(tension):
        numbers = f"{len(sd)} robots and {len(tension)} cables"
        message = f"{numbers}: the numbers must be equal"
        raise ConfigError(message, key="laboratory.robots")
    rate = transducer.rate
    samples = round((tare + duration) * rate)
    time = np.arange(samples) / rate
    e = directions(cables, robots, samples, rate, rng)

    pull = tension + slipping(sd, robots, samples, rate, rng)
    pull[time < tare] = 0.0
    pull = np.maximum(pull, 0.0)  # a cable never pushes
    pulls = pull[..., None] * e

    force = np.sum(pulls, axis=1)
    torque = np.cross(transducer.lever, force)
    if cables.attachment is not None:
        places = np.zeros((len(tension), 3))
        places[:, : len(cables.attachment[0])] = cables.attachment
        torque = torque + np.sum(np.cross(places, pulls), axis=1)

    measured = []
    for i, true in enumerate((force, torque)):
        bias = rng.normal(0.0, transducer.bias[i], 3)
        drift_rate = rng.normal(0.0, transducer.drift[i], 3)
        drift = drift_rate * time[:, None]
        noise = rng.normal(0.0, transducer.noise[i], true.shape)
        measured.append(true + bias + drift + noise)
    return RiggedForce(time, *measured, pull, e)
