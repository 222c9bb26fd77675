"""The synthetic laboratory: one session of takes with the arm, and the force records, as arrays
that the instruments would have seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.laboratory.dynamics import expose, session_offset, simulate_take, true_chain
from pipeline.laboratory.mocap import place_markers
from pipeline.laboratory.options import (
    ClockOptions,
    DynamicsOptions,
    KinectOptions,
    MocapOptions,
    TrajectoryOptions,
)
from pipeline.laboratory.sensor import draw_bias


@dataclass(frozen=True)
class Session:
    """What stays the same through a session: the arm as built, its encoders' zeros, the markers'
    places, the sensor's bias.
    """

    arm: Arm  # with the true chain
    nominal: PlanarChain
    encoder: np.ndarray  # (3,) rad
    markers: np.ndarray  # (3, 3, 3) m, in segment frames
    depth_bias: np.ndarray


def open_session(
    arm: Arm,
    template: np.ndarray,
    dynamics: DynamicsOptions,
    mocap: MocapOptions,
    kinect: KinectOptions,
    rng: np.random.Generator,
) -> Session:
    """Draw what a session has of its own; ``template`` (3, 3, 3) are the markers' nominal places in
    m.
    """
    built = replace(arm, chain=true_chain(arm.chain, dynamics, rng))
    return Session(
        built,
        arm.chain,
        session_offset(dynamics, rng),
        place_markers(template, mocap, rng),
        draw_bias(kinect, rng),
    )


@dataclass(frozen=True)
class Motion:
    """One take: what moved, and when which instrument looked."""

    motion_capture: np.ndarray  # (M+1, 3) rad, at the exposures of the motion capture
    frame_times: np.ndarray  # (F,) s, depth frames on the camera's own clock
    frame_joints: np.ndarray  # (F, 3) rad, at the depth frames' exposures
    truth: np.ndarray  # (M+1, 3) rad, at the instants of the motion grid
    clock_offset: float  # s, camera's clock minus motion clock at the start


def perform(
    session: Session,
    trajectory: TrajectoryOptions,
    dynamics: DynamicsOptions,
    clock: ClockOptions,
    rng: np.random.Generator,
) -> Motion:
    """Let the arm track the trajectory once, watched by both cameras."""
    t, q = simulate_take(session.arm.chain, session.encoder, trajectory, dynamics, rng)
    grid = np.arange(round(trajectory.duration * trajectory.rate) + 1) / trajectory.rate
    watched = expose(t, q, grid, dynamics, rng)
    frames = np.arange(int(trajectory.duration * clock.rate) + 1) / clock.rate
    exposed = np.clip(
        frames + clock.jitter_std * rng.standard_normal(frames.shape), 0.0, trajectory.duration
    )
    offset = clock.offset + clock.offset_std * rng.standard_normal()
    observed = np.stack([np.interp(exposed, t, q[:, j]) for j in range(3)], axis=-1)
    truth = np.stack([np.interp(grid, t, q[:, j]) for j in range(3)], axis=-1)
    return Motion(watched, exposed * (1 + clock.drift) + offset, observed, truth, offset)
