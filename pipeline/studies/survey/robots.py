"""A condition's recordings in memory: what its robot did, as motion capture and depth camera would
have it, without cameras or files.

The arm moves as in :mod:`pipeline.laboratory`, with the session and the takes that the stage
`record` draws from the same seed. Then each measured pose gets the white noise that the recorded
run's poses have at rest, and each depth frame the noise that the recorded run's depth camera had at
an equal share of the motion. Left out is what instruments do besides: markers placed off their
templates, hidden, exchanged and lost, the estimate of the clocks' offset, the segmentation and the
articulation of depth images. As that takes the end-effector from the command, it shows less of a
pose's deviation than there is; here it shows all. A trajectory other than the recorded one has the
depth camera's noise of the recorded one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.cases.camera import Camera
from pipeline.cases.fits import Takes
from pipeline.core import rng
from pipeline.core.columns import spread
from pipeline.core.errors import ConfigError
from pipeline.filtering.measurement import measurements
from pipeline.laboratory.dynamics import expose, session_offset, simulate_take, true_chain
from pipeline.laboratory.options import ClockOptions, DynamicsOptions, TrajectoryOptions
from pipeline.laboratory.swing import desired_trajectory
from pipeline.models.noise import process_noise
from pipeline.models.steps import Recorded
from pipeline.perception.depth_noise import errors_of, leave_one_out
from pipeline.recordings.commands import commanded_steps
from pipeline.studies.survey.conditions import Factors, disturbed
from pipeline.studies.survey.options import Way
from pipeline.verdicts.reference import ArmNames


@dataclass(frozen=True)
class NoiseLaw:
    """Mean and covariance of the depth camera's noise in the joint angles over the motion."""

    share: np.ndarray  # (F,) of the motion's duration, growing
    bias: np.ndarray  # (F, 3) rad
    covariance: np.ndarray  # (F, 3, 3) rad²

    def sample(self, share: np.ndarray, stream: np.random.Generator) -> np.ndarray:
        """(K, 3) rad, one independent draw at each ``share`` (K,), mean and covariance interpolated
        linearly.
        """
        values = np.concatenate([self.bias, self.covariance.reshape(-1, 9)], axis=1)
        at = np.stack([np.interp(share, self.share, column) for column in values.T], axis=-1)
        root = np.linalg.cholesky(at[:, 3:].reshape(-1, 3, 3))
        return at[:, :3] + np.matvec(root, stream.standard_normal((len(share), 3)))


@dataclass(frozen=True)
class Laboratory:
    """What the laboratory has in every condition, before any factor."""

    chain: PlanarChain  # nominal
    joints: tuple[str, ...]  # their names, base to tip
    dynamics: DynamicsOptions
    trajectories: dict[str, TrajectoryOptions]
    clock: ClockOptions
    pose_noise: np.ndarray  # (3, 3) rad², of a pose of the motion capture
    depth_noise: NoiseLaw
    # frames on either side that the covariance of the depth camera's noise is estimated over
    window: int

    @property
    def arm(self) -> ArmNames:
        """What claims call its joints and rows."""
        return ArmNames(self.joints, self.chain.task)


@dataclass(frozen=True)
class Take:
    """What moved in one take, as its instruments saw it."""

    poses: np.ndarray  # (M+1, 3) rad, at the exposures of the motion capture
    frames: np.ndarray  # (F,) s, exposures of the depth camera on the motion clock
    seen: np.ndarray  # (F, 3) rad, at these


def perform(
    laboratory: Laboratory, trajectory: str, factors: Factors, seed: int, part: str, count: int
) -> list[Take]:
    """The first ``count`` takes of a ``part`` (train or test), true to the ones that the stage
    `record` draws from ``seed``.
    """
    dynamics, motion, clock = (
        disturbed(laboratory.dynamics, factors),
        laboratory.trajectories[trajectory],
        laboratory.clock,
    )
    session = rng.stream(seed, "record.session")
    built, offset = (
        true_chain(laboratory.chain, dynamics, session),
        session_offset(dynamics, len(laboratory.joints), session),
    )
    grid = np.arange(round(motion.duration * motion.rate) + 1) / motion.rate
    nominal = np.arange(int(motion.duration * clock.rate) + 1) / clock.rate
    takes = []
    for number in range(count):
        stream = rng.stream(seed, f"record.{part}", number)
        t, q, _ = simulate_take(built, offset, motion, dynamics, stream)
        poses = expose(t, q, grid, dynamics, stream)
        frames = np.clip(
            nominal + clock.jitter_std * stream.standard_normal(nominal.shape), 0.0, motion.duration
        )
        takes.append(
            Take(
                poses, frames, np.stack([np.interp(frames, t, q[:, j]) for j in range(3)], axis=-1)
            )
        )
    return takes


def recorded(laboratory: Laboratory, trajectory: str, poses: np.ndarray) -> Recorded:
    """The steps between ``poses`` (takes, M+1, 3) in rad under the commands of ``trajectory``;
    raises SingularJacobianError.
    """
    motion = laboratory.trajectories[trajectory]
    v = commanded_steps(desired_trajectory(laboratory.chain, motion), motion.rate)
    noise = process_noise(laboratory.chain, poses, v)
    return Recorded(laboratory.chain, poses[:, :-1], v, noise, laboratory.joints)


def measured(
    takes: list[Take], covariance: np.ndarray, factor: float, stream: np.random.Generator
) -> np.ndarray:
    """(takes, M+1, 3) rad: the takes' poses with the noise of the motion capture, ``factor`` times
    its standard deviation.
    """
    poses = np.stack([take.poses for take in takes])
    variances, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(variances, 0.0))  # what rounds to just below zero is zero
    return poses + factor * stream.standard_normal(poses.shape) @ root.T


def observe(
    laboratory: Laboratory, trajectory: str, factors: Factors, seed: int, training: int, test: int
) -> tuple[Takes, Camera]:
    """``training`` and ``test`` takes of a condition and the depth camera that saw the latter, its
    noise estimated as the stages do.

    Raises SingularJacobianError, and RecordingError where the test takes are too few for that
    estimate.
    """
    fitted = perform(laboratory, trajectory, factors, seed, "train", training)
    kept = perform(laboratory, trajectory, factors, seed, "test", test)
    white = (laboratory.pose_noise, factors.motion_capture)
    poses = measured(fitted, *white, rng.stream(seed, "survey.capture", 0))
    others = measured(kept, *white, rng.stream(seed, "survey.capture", 1))
    names = [f"test_{number + 1:03d}" for number in range(test)]
    motion = laboratory.trajectories[trajectory]
    t = np.arange(others.shape[1]) / motion.rate
    joints = pd.concat(
        [_table(name, t, q, laboratory.joints) for name, q in zip(names, others, strict=True)],
        ignore_index=True,
    )
    stream, tables = rng.stream(seed, "survey.camera"), []
    for name, take in zip(names, kept, strict=True):
        noise = laboratory.depth_noise.sample(take.frames / motion.duration, stream)
        q = take.seen + factors.depth_camera * noise
        table = _table(name, take.frames, q, laboratory.joints)
        tables.append(table.assign(frame=np.arange(len(table))))
    angles = pd.concat(tables, ignore_index=True)
    noise = leave_one_out(errors_of(angles, joints), window=laboratory.window)
    camera = Camera(noise, {take.take: take for take in measurements(angles, noise)})
    steps = recorded(laboratory, trajectory, poses)
    return Takes(steps, poses, dict(zip(names, others, strict=True))), camera


def _table(take: str, t: np.ndarray, q: np.ndarray, joints: Sequence[str]) -> pd.DataFrame:
    return pd.DataFrame({"take": take, "t": t} | spread("q", joints, q))


def pose_noise(at_rest: np.ndarray, robot: np.ndarray) -> np.ndarray:
    """(3, 3) rad²: the noise of a measured pose, from that of a step at rest as recorded and as the
    robot alone has it, both (3, 3).

    A step holds the noise of two poses. What a finite number of takes leaves negative is zero.
    """
    variances, axes = np.linalg.eigh((at_rest - robot) / 2)
    return (axes * np.maximum(variances, 0.0)) @ axes.T


def trajectories(
    chain: PlanarChain, own: TrajectoryOptions, ways: Mapping[str, Way]
) -> dict[str, TrajectoryOptions]:
    """The trajectories of a survey by name, from the dataset's ``own``. Raises ConfigError for one
    beyond the joints' limits.
    """
    options = {}
    for name, way in ways.items():
        ends = {
            "folded": tuple(way.folded or own.folded),
            "extended": tuple(way.extended or own.extended),
        }
        rest = own.rest if way.rest is None else way.rest
        # the arm rests four times, and what it moves in between stays as it is
        duration = own.duration + 4 * (rest - own.rest)
        try:
            options[name] = replace(
                own,
                **ends,
                duration=duration / way.pace,
                rest=rest / way.pace,
                ramp=own.ramp / way.pace,
            )
            desired_trajectory(chain, options[name])
        except ConfigError as error:
            raise ConfigError(
                error.message, **error.evidence | {"key": f"trajectories.{name}"}
            ) from None
    return options
