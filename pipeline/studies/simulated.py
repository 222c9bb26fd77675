"""Recordings of the laboratory's arm in memory, without cameras or files.

Session and takes are equal to the stage `record` with the same seed. A measured pose has white
noise with the covariance of the recorded poses at rest. A depth frame has noise with the recorded
moments at an equal share of the motion. Markers have no faults and no offsets; clocks are known.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd

from pipeline.arm.chain import Chain
from pipeline.core import rng
from pipeline.core.columns import matrices, spread, values
from pipeline.core.errors import ConfigError
from pipeline.evidence.case import Camera, Takes, camera_of
from pipeline.laboratory import dynamics as moves
from pipeline.laboratory.causes import dynamics_type
from pipeline.laboratory.options import ClockOptions, DynamicsOptions, TrajectoryOptions
from pipeline.models.steps import Recorded, process_noise
from pipeline.recordings.commands import commanded_steps

RESTING = 40  # takes that give the arm's noise at rest, without measurement noise
SIZES = (  # of disturbances in ``DynamicsOptions``
    "sway_std",
    "clearance",
    "speed_error_std",
    "encoder_ripple",
    "encoder_offset_std",
    "length_std",
    "start_std",
    "jitter_std",
)
FACTORS = (*SIZES, "motion_capture", "depth_camera")  # the last two: std of instruments
Factors = Mapping[str, float]  # FACTORS by name, 1 if absent


def require_factors(names: Iterable[str], factors: Sequence[str] = FACTORS) -> None:
    """Raise ConfigError if one of the ``names`` is not one of the ``factors``."""
    if unknown := sorted({*names} - {*factors}):
        message = (
            f"no factor {', '.join(unknown)}; known factors are {', '.join(factors)}"
        )
        raise ConfigError(message, key="factors")


def disturb(dynamics: DynamicsOptions, factors: Factors) -> DynamicsOptions:
    """Return ``dynamics`` with the sizes of the disturbances times their ``factors``."""
    require_factors(factors)
    scaled = {}
    for name in SIZES:
        size = getattr(dynamics, name)
        scaled[name] = np.multiply(size, factors.get(name, 1.0)).tolist()
    return replace(dynamics, **scaled)


def dynamics_of_cause(cause: str, size: float) -> DynamicsOptions:
    """Return the disturbances under a ``cause``, those that the cause sets times ``size``."""
    shared = DynamicsOptions()
    options = dynamics_type(cause)()
    factors = {}
    for name in SIZES:
        if getattr(options, name) != getattr(shared, name):
            factors[name] = size
    return disturb(options, factors)


@dataclass(frozen=True)
class NoiseLaw:
    """Mean and covariance of the depth camera's noise in the joint angles over the motion."""

    share: np.ndarray  # (F,) of the motion's duration, growing
    bias: np.ndarray  # (F, n) rad
    covariance: np.ndarray  # (F, n, n) rad²

    def sample(self, share: np.ndarray, stream: np.random.Generator) -> np.ndarray:
        """Draw noise (K, n) in rad, independent at each ``share`` (K,), with linear moments."""
        bias = self.at(share, self.bias)
        covariance = self.at(share, self.covariance)
        root = np.linalg.cholesky(covariance)
        variates = stream.standard_normal(bias.shape)
        return bias + np.matvec(root, variates)

    def at(self, share: np.ndarray, moments: np.ndarray) -> np.ndarray:
        """Return the ``moments`` (F, ...) at each ``share`` (K,) by linear interpolation."""
        _, *shape = moments.shape
        columns = []
        for column in moments.reshape(len(moments), -1).T:
            columns.append(np.interp(share, self.share, column))
        return np.stack(columns, axis=-1).reshape(-1, *shape)


@dataclass(frozen=True)
class Laboratory:
    """An arm, its motion and its instruments, before any factor."""

    chain: Chain  # nominal
    joints: tuple[str, ...]  # names, base to tip
    dynamics: DynamicsOptions
    motion: TrajectoryOptions
    clock: ClockOptions
    pose_noise: np.ndarray  # (n, n) rad², of a pose of the motion capture
    depth_noise: NoiseLaw
    window: int  # frames on either side over which the depth camera's covariance is estimated

    @classmethod
    def of_run(
        cls,
        settings: SimpleNamespace,
        recorded: Recorded,
        kinect_noise: pd.DataFrame,
    ) -> "Laboratory":
        """Return the laboratory of the run's dataset with the recorded noise of the instruments."""
        options = settings.dataset.laboratory
        joints = tuple(recorded.joints)
        noise = kinect_noise[kinect_noise["take"] == "none"]
        share = noise["t"].to_numpy() / options["trajectory"].duration
        without_camera_errors = cls(
            recorded.chain,
            joints,
            options["dynamics"],
            options["trajectory"],
            options["clock"],
            np.zeros((len(joints), len(joints))),
            NoiseLaw(share, values(noise, "b"), matrices(noise, "r", joints)),
            settings.articulation.noise_window,
        )
        poses, _ = perform(without_camera_errors, {}, settings.seed, "train", RESTING)
        at_rest = steps(without_camera_errors, poses).measurement
        # a step has the noise of two poses; negative estimates from few takes become zero
        variances, axes = np.linalg.eigh((recorded.measurement - at_rest) / 2)
        pose_noise = (axes * np.maximum(variances, 0.0)) @ axes.T
        return replace(without_camera_errors, pose_noise=pose_noise)


def performed_takes(
    session: moves.Session,
    motion: moves.Commanded,
    dynamics: DynamicsOptions,
    streams: Sequence[np.random.Generator],
) -> tuple[np.ndarray, list[moves.Swing]]:
    """Return the poses (takes, M+1, n) in rad of the motion capture, and the takes: one for each of
    the ``streams``, as :func:`pipeline.laboratory.dynamics.perform` draws them, computed together.
    """
    chances = [moves.draw(session.chain, motion, dynamics, s) for s in streams]
    by_quantity = zip(*chances, strict=True)
    together = moves.Chance(*map(np.stack, by_quantity))
    arm, zeros = session
    all_takes = moves.swing(arm, zeros, motion, dynamics, together)
    steps_of_motion = round(motion.duration * motion.rate)
    grid = np.arange(steps_of_motion + 1) / motion.rate
    poses = []
    takes = []
    for q, servo, stream in zip(all_takes.q, all_takes.servo, streams, strict=True):
        poses.append(moves.expose(all_takes.t, q, grid, dynamics, stream))
        takes.append(moves.Swing(all_takes.t, q, servo))
    return np.stack(poses), takes


def perform(
    laboratory: Laboratory,
    factors: Factors,
    seed: int,
    kind: str,
    count: int,
) -> tuple[np.ndarray, list[moves.DepthFrames]]:
    """Return ``count`` takes of a ``kind`` (train or test) as `record` draws them: poses (takes,
    M+1, n) in rad of the motion capture, and the exposures of the depth camera in each take.
    """
    dynamics = disturb(laboratory.dynamics, factors)
    motion = laboratory.motion
    session_stream = rng.stream(seed, "record.session")
    session = moves.open_session(laboratory.chain, dynamics, session_stream)
    streams = [rng.stream(seed, f"record.{kind}", number) for number in range(count)]
    poses, takes = performed_takes(session, motion, dynamics, streams)
    frames = []
    for take, stream in zip(takes, streams, strict=True):
        frames.append(
            moves.depth_frames(take, motion.duration, laboratory.clock, stream),
        )
    return poses, frames


def steps(laboratory: Laboratory, poses: np.ndarray) -> Recorded:
    """Return the steps between ``poses`` (takes, M+1, n) in rad; raises SingularJacobianError."""
    table = moves.desired_trajectory(laboratory.chain, laboratory.motion)
    v = commanded_steps(table, laboratory.motion.rate)
    noise = process_noise(laboratory.chain, poses, v)
    return Recorded(laboratory.chain, poses[:, :-1], v, noise, laboratory.joints)


def measure_poses(
    poses: np.ndarray,
    covariance: np.ndarray,
    factor: float,
    stream: np.random.Generator,
) -> np.ndarray:
    """Return ``poses`` (takes, M+1, n) in rad with noise of ``factor``² · ``covariance``."""
    variances, axes = np.linalg.eigh(covariance)
    # an eigenvalue may round to below zero
    root = axes * np.sqrt(np.maximum(variances, 0.0))
    return poses + factor * stream.standard_normal(poses.shape) @ root.T


def observe(
    laboratory: Laboratory,
    factors: Factors,
    seed: int,
    training: int,
    test: int,
) -> tuple[Takes, Camera]:
    """Return ``training`` and ``test`` takes, and the depth camera with its estimated noise; raises
    SingularJacobianError, and RecordingError if the test takes are too few to estimate the noise.
    """
    counts = {"train": training, "test": test}
    measured = {}
    names = {}
    frames = {}
    for number, (kind, count) in enumerate(counts.items()):
        q, frames[kind] = perform(laboratory, factors, seed, kind, count)
        stream = rng.stream(seed, "simulated.capture", number)
        factor = factors.get("motion_capture", 1.0)
        measured[kind] = measure_poses(q, laboratory.pose_noise, factor, stream)
        names[kind] = [f"{kind}_{n:03d}" for n in range(1, count + 1)]

    test_poses = dict(zip(names["test"], measured["test"], strict=True))
    camera = watch(laboratory, factors, seed, test_poses, frames["test"])
    training_steps = steps(laboratory, measured["train"])
    takes = Takes(training_steps, tuple(names["train"]), measured["train"], test_poses)
    return takes, camera


def watch(
    laboratory: Laboratory,
    factors: Factors,
    seed: int,
    poses: Mapping[str, np.ndarray],
    frames: Sequence[moves.DepthFrames],
) -> Camera:
    """Return the depth camera that sees the ``frames`` of the takes; their measured ``poses`` (M+1,
    n) in rad by name are the reference of its noise.
    """
    motion = laboratory.motion
    joints = laboratory.joints
    stream = rng.stream(seed, "simulated.camera")
    factor = factors.get("depth_camera", 1.0)
    references = []
    angles = []
    for (name, q), seen in zip(poses.items(), frames, strict=True):
        share = seen.exposed / motion.duration
        noisy = seen.joints + factor * laboratory.depth_noise.sample(share, stream)
        reference = {"take": name, "t": np.arange(len(q)) / motion.rate}
        references.append(pd.DataFrame(reference | spread("q", joints, q)))
        place = {"take": name, "t": seen.exposed, "frame": range(len(noisy))}
        angles.append(pd.DataFrame(place | spread("q", joints, noisy)))
    return camera_of(
        pd.concat(angles, ignore_index=True),
        pd.concat(references, ignore_index=True),
        window=laboratory.window,
    )
