"""The synthetic arm in motion: a position-controlled robot with many small disturbances, none of
them a random Jacobian: speed errors of the servo, swaying of the end-effector, clearance of one
joint, timing of the exposure. All of it is bounded.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.special import ndtr

from pipeline.arm.chain import PlanarChain
from pipeline.arm.interface import Chain
from pipeline.core.errors import ConfigError
from pipeline.laboratory.options import DynamicsOptions
from pipeline.laboratory.swing import Commanded, desired_joints

LAGS = 4  # of a drive: position loop, velocity loop, current loop and the gear's elasticity
SETTLED = 30  # lags after which nothing is left of a start: four lags pass on 1e-9 of it


def lagged_noise(shape: tuple[int, ...], steps_per_lag: float, rng: Generator) -> np.ndarray:
    """Draw stationary normal paths of variance 1 along the last axis: white noise after LAGS."""
    from scipy.signal import lfilter

    denominator, response = _lags(steps_per_lag)
    noise = rng.standard_normal((*shape[:-1], len(response) + shape[-1]))
    passed_on = lfilter([1.0], denominator, noise, axis=-1)[..., len(response) :]
    return passed_on / np.linalg.norm(response)


def lagged_correlation(steps: np.ndarray, steps_per_lag: float) -> np.ndarray:
    """Correlation (...) of :func:`lagged_noise` with itself so many whole ``steps`` (...) later."""
    _, response = _lags(steps_per_lag)
    power = np.abs(np.fft.rfft(response, 2 * len(response))) ** 2
    correlation = np.append(np.fft.irfft(power, 2 * len(response))[: len(response)], 0.0)
    # beyond the response nothing is left
    return correlation[np.minimum(steps, len(response))] / correlation[0]


def _lags(steps_per_lag: float) -> tuple[np.ndarray, np.ndarray]:
    """The recursive filter's denominator, and its response to an impulse until that is settled."""
    from scipy.signal import lfilter

    denominator = np.poly(np.full(LAGS, np.exp(-1.0 / steps_per_lag)))
    impulse = np.zeros(int(np.ceil(SETTLED * steps_per_lag)))
    impulse[0] = 1.0
    return denominator, lfilter([1.0], denominator, impulse)


def servo_times(motion: Commanded, options: DynamicsOptions) -> np.ndarray:
    """Return the servo's times (N,) in s, from a little before the motion to a little after it."""
    dt = 1.0 / options.rate
    return np.arange(-50, round(motion.duration * options.rate) + 51) * dt


def sway_share(chain: Chain, speed: np.ndarray, options: DynamicsOptions) -> np.ndarray:
    """Return the share (N,) of the sway at joint speeds ``speed`` (N, n) in rad/s."""
    pace = np.linalg.norm(speed, axis=1) / np.linalg.norm(chain.max_speed)
    pace **= options.speed_exponent
    return options.sway_rest + (1 - options.sway_rest) * pace


def play_share(speed: np.ndarray, options: DynamicsOptions) -> np.ndarray:
    """Share (N,) of the play that its joint fills at joint speeds ``speed`` (N, n) in rad/s."""
    pace = np.abs(speed[:, options.play_joint - 1] / options.rattle_speed)
    return np.minimum(1.0, pace**options.speed_exponent)


def true_chain(nominal: Chain, options: DynamicsOptions, rng: Generator) -> Chain:
    """Return the arm as built, with errors of length; ConfigError for another arm's options."""
    key, number, rows = "laboratory.dynamics", len(nominal.lower), ", ".join(nominal.task)
    if len(options.sway_std) != len(nominal.task):
        message = f"{key}.sway_std: must have an entry for each of {rows}"
        raise ConfigError(message, value=options.sway_std)
    if options.play_joint > number:
        message = f"{key}.play_joint: must lie between 1 and {number}"
        raise ConfigError(message, value=options.play_joint)
    planar = isinstance(nominal, PlanarChain)
    links = nominal.links if planar else nominal.placements[1:, 9:]
    lengths = nominal.lengths if planar else np.linalg.norm(links, axis=1)
    built = lengths + options.length_std * rng.standard_normal(len(links))
    # where two axes meet there is no link
    ratio = np.divide(built, lengths, out=np.ones_like(lengths), where=lengths > 0)
    if planar:
        return replace(nominal, links=links * ratio[:, None])
    placements = nominal.placements.copy()
    placements[1:, 9:] *= ratio[:, None]
    return replace(nominal, placements=placements)


class Chance(NamedTuple):
    """Random numbers of a take, or of many along leading axes; paths are :func:`lagged_noise`."""

    gain: np.ndarray  # (..., N, n) of the speed errors
    phase: np.ndarray  # (..., n) rad, of the encoders' ripple
    start: np.ndarray  # (..., n) standard normal, of the start pose
    sway: np.ndarray  # (..., N, m) of the task's rows
    play: np.ndarray  # (..., N) of the joint with play


def draw(chain: Chain, motion: Commanded, options: DynamicsOptions, rng: Generator) -> Chance:
    """Draw the numbers of one take; of ``motion`` they depend on its duration alone."""
    n, steps, rate = len(chain.lower), len(servo_times(motion, options)), options.rate
    return Chance(
        gain=lagged_noise((n, steps), options.speed_error_time * rate, rng).T,
        phase=rng.uniform(0, 2 * np.pi, n),
        start=rng.standard_normal(n),
        sway=lagged_noise((len(chain.task), steps), options.sway_time * rate, rng).T,
        play=lagged_noise((steps,), options.clearance_time * rate, rng),
    )


class Swing(NamedTuple):
    """One take of the arm, or many along leading axes (...), at the servo's steps."""

    t: np.ndarray  # (N,) s on the motion clock
    q: np.ndarray  # (..., N, n) rad, true joint angles
    servo: np.ndarray  # (..., N, n) rad, what the encoders feel of them, before the gears


def swing(
    chain: Chain, offset: np.ndarray, motion: Commanded, options: DynamicsOptions, chance: Chance
) -> Swing:
    """Return the takes that ``chance`` makes of ``motion`` by the true ``chain``."""
    dt, t = 1.0 / options.rate, servo_times(motion, options)
    goal, speed = desired_joints(np.clip(t, 0.0, motion.duration), motion)
    gain = 1 + options.speed_error_std * chance.gain
    ripple = options.encoder_ripple * np.sin(goal + chance.phase[..., None, :])
    servo = np.empty_like(gain)
    servo[..., 0, :] = goal[0] + options.start_std * chance.start
    for i in range(t.size - 1):
        now = servo[..., i, :]
        wanted = speed[i] + options.servo_gain * (goal[i] - now)
        servo[..., i + 1, :] = now + dt * gain[..., i, :] * wanted
    sway = chance.sway * options.sway_std
    sway *= sway_share(chain, speed, options)[:, None]
    inverse = chain.inverse_jacobian(servo, what="time of the laboratory")
    q = servo + offset + ripple + np.einsum("...ij,...j->...i", inverse, sway)
    play = 2 * ndtr(chance.play) - 1
    q[..., options.play_joint - 1] += options.clearance * play * play_share(speed, options)
    return Swing(t, q, servo)


def simulate_take(
    chain: Chain, offset: np.ndarray, motion: Commanded, options: DynamicsOptions, rng: Generator
) -> Swing:
    """Return one take with numbers of ``rng``, see :func:`swing`."""
    return swing(chain, offset, motion, options, draw(chain, motion, options, rng))


def expose(
    t: np.ndarray, q: np.ndarray, at: np.ndarray, options: DynamicsOptions, rng: Generator
) -> np.ndarray:
    """Return true joint angles (K, n) rad at ``at`` (K,) s, missed by the jitter."""
    instants = np.clip(at + options.jitter_std * rng.standard_normal(at.shape), t[0], t[-1])
    return joints_at(instants, t, q)


def joints_at(instants: np.ndarray, t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return ``q`` (N, n) in rad of the times ``t`` (N,) at the ``instants`` (K,) in s, (K, n)."""
    return np.stack([np.interp(instants, t, joint) for joint in q.T], axis=-1)
