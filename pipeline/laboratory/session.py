"""The synthetic laboratory: one session of takes, as its instruments would have seen it."""

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from pipeline.arm.interface import Chain
from pipeline.laboratory import dynamics as arm
from pipeline.laboratory import options
from pipeline.laboratory.swing import desired_joints


class Session(NamedTuple):
    """The arm as it was built and its encoders' zeros, the same through a session."""

    nominal: Chain
    chain: Chain  # the true one
    encoder: np.ndarray  # (n,) rad


def open_session(nominal: Chain, dynamics: options.DynamicsOptions, rng: Generator) -> Session:
    """Draw what a session has of its own; ConfigError for the options of another arm."""
    built = arm.true_chain(nominal, dynamics, rng)
    zeros = dynamics.encoder_offset_std * rng.standard_normal(len(nominal.lower))
    return Session(nominal, built, zeros)


class PerformedMotion(NamedTuple):
    """One take: what moved, and where it was when the motion capture looked."""

    swing: arm.Swing
    motion_capture: np.ndarray  # (M+1, n) rad, at the exposures of the motion capture
    truth: np.ndarray  # (M+1, n) rad, at the instants of the motion grid


def perform(
    session: Session,
    trajectory: options.TrajectoryOptions,
    dynamics: options.DynamicsOptions,
    rng: Generator,
) -> PerformedMotion:
    """Let the arm track the trajectory once, watched by the motion capture."""
    swing = arm.simulate_take(session.chain, session.encoder, trajectory, dynamics, rng)
    grid = np.arange(round(trajectory.duration * trajectory.rate) + 1) / trajectory.rate
    watched = arm.expose(swing.t, swing.q, grid, dynamics, rng)
    return PerformedMotion(swing, watched, arm.joints_at(grid, swing.t, swing.q))


class DepthFrames(NamedTuple):
    """Exposures of a depth camera during a take, and the arm's angles at them."""

    exposed: np.ndarray  # (F,) s on the motion clock
    times: np.ndarray  # (F,) s on the camera's own clock
    joints: np.ndarray  # (F, n) rad, at the exposures
    clock_offset: float  # s, camera's clock minus motion clock at the start


def depth_frames(
    swing: arm.Swing, duration: float, clock: options.ClockOptions, rng: Generator
) -> DepthFrames:
    """Draw the frames of a take of ``duration`` s."""
    frames = np.arange(int(duration * clock.rate) + 1) / clock.rate
    exposed = np.clip(frames + clock.jitter_std * rng.standard_normal(frames.shape), 0.0, duration)
    offset = clock.offset + clock.offset_std * rng.standard_normal()
    times = exposed * (1 + clock.drift) + offset
    return DepthFrames(exposed, times, arm.joints_at(exposed, swing.t, swing.q), offset)


def log_joints(
    swing: arm.Swing, trajectory: options.TrajectoryOptions, encoders: options.EncoderOptions
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return times (N,) in s on the motion clock and the signals ``target`` and ``actual``, each
    (N, n) in rad: encoders sit at the motors and read what the servo makes of the command, to their
    resolution, not the zeros' errors and what happens behind the gears.
    """
    t = np.arange(int(trajectory.duration * encoders.rate) + 1) / encoders.rate
    felt = arm.joints_at(t, swing.t, swing.servo)
    actual = np.round(felt / encoders.resolution) * encoders.resolution
    return t, {"target": desired_joints(t, trajectory)[0], "actual": actual}
