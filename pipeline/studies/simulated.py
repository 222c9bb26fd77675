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
from pipeline.laboratory.options import ClockOptions, DynamicsOptions, TrajectoryOptions
from pipeline.models.steps import Recorded, process_noise
from pipeline.recordings.commands import commanded_steps

RESTING = 40  # takes that give the arm's noise at rest, without measurement noise
SIZES = (
    "sway_std",
    "clearance",
    "speed_error_std",
    "encoder_ripple",
    "encoder_offset_std",
)
SIZES += (
    "length_std",
    "start_std",
    "jitter_std",
)  # of disturbances in ``DynamicsOptions``
LAGS = ("sway_time", "clearance_time")
# disturbances: on all SIZES; speed_exponent: at 0 the speed does not change sway and play; lasting:
# on the LAGS, the duration of a deviation; the last two: on the std of the instrument
FACTORS = (
    "disturbances",
    *SIZES,
    "speed_exponent",
    "lasting",
    "motion_capture",
    "depth_camera",
)
Factors = Mapping[str, float]  # FACTORS by name, 1 if absent


def require_factors(names: Iterable[str], known: Sequence[str] = FACTORS) -> None:
    """Raise ConfigError if one of the ``names`` is not ``known``."""
    if unknown := sorted({*names} - {*known}):
        message = (
            f"no factor {', '.join(unknown)}; known factors are {', '.join(known)}"
        )
        raise ConfigError(message, key="factors")


def disturb(dynamics: DynamicsOptions, factors: Factors) -> DynamicsOptions:
    """Return ``dynamics`` with the sizes and lags of the disturbances times their factors."""
    require_factors(factors)
    factors = dict.fromkeys(FACTORS, 1.0) | factors
    by = {name: factors["disturbances"] * factors[name] for name in SIZES}
    scaled = {
        name: np.multiply(getattr(dynamics, name), x).tolist() for name, x in by.items()
    }
    lags = {name: getattr(dynamics, name) * factors["lasting"] for name in LAGS}
    exponent = dynamics.speed_exponent * factors["speed_exponent"]
    return replace(dynamics, **scaled, **lags, speed_exponent=exponent)


@dataclass(frozen=True)
class NoiseLaw:
    """Mean and covariance of the depth camera's noise in the joint angles over the motion."""

    share: np.ndarray  # (F,) of the motion's duration, growing
    bias: np.ndarray  # (F, n) rad
    covariance: np.ndarray  # (F, n, n) rad²

    def sample(self, share: np.ndarray, stream: np.random.Generator) -> np.ndarray:
        """Draw noise (K, n) in rad, independent at each ``share`` (K,), with linear moments."""
        n = self.bias.shape[-1]
        moments = np.concatenate(
            [self.bias, self.covariance.reshape(-1, n * n)], axis=1
        )
        at = np.stack(
            [np.interp(share, self.share, column) for column in moments.T], axis=-1
        )
        root = np.linalg.cholesky(at[:, n:].reshape(-1, n, n))
        return at[:, :n] + np.matvec(root, stream.standard_normal((len(share), n)))


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
        cls, settings: SimpleNamespace, recorded: Recorded, kinect_noise: pd.DataFrame
    ) -> "Laboratory":
        """Return the laboratory of the run's dataset with the recorded noise of the instruments."""
        options, joints = settings.dataset.laboratory, tuple(recorded.joints)
        noise = kinect_noise[kinect_noise["take"] == "none"]
        share = noise["t"].to_numpy() / options["trajectory"].duration
        law = NoiseLaw(share, values(noise, "b"), matrices(noise, "r", joints))
        none, window = (
            np.zeros((len(joints), len(joints))),
            settings.articulation.noise_window,
        )
        parts = (options["dynamics"], options["trajectory"], options["clock"])
        alone = cls(recorded.chain, joints, *parts, none, law, window)
        poses, _ = perform(alone, {}, settings.seed, "train", RESTING)
        at_rest = steps(alone, poses).measurement
        # a step has the noise of two poses; negative estimates from few takes become zero
        variances, axes = np.linalg.eigh((recorded.measurement - at_rest) / 2)
        return replace(alone, pose_noise=(axes * np.maximum(variances, 0.0)) @ axes.T)


def performed_poses(
    session: moves.Session,
    motion: moves.Commanded,
    dynamics: DynamicsOptions,
    streams: Sequence[np.random.Generator],
) -> np.ndarray:
    """Return the poses (takes, M+1, n) in rad of the motion capture in one take for each of the
    ``streams``, as :func:`pipeline.laboratory.dynamics.perform` draws them, all takes at once.
    """
    chances = [moves.draw(session.chain, motion, dynamics, s) for s in streams]
    together = moves.Chance(*map(np.stack, zip(*chances, strict=True)))
    swing = moves.swing(session.chain, session.encoder, motion, dynamics, together)
    grid = np.arange(round(motion.duration * motion.rate) + 1) / motion.rate
    poses = []
    for q, stream in zip(swing.q, streams, strict=True):
        poses.append(moves.expose(swing.t, q, grid, dynamics, stream))
    return np.stack(poses)


def perform(
    laboratory: Laboratory, factors: Factors, seed: int, part: str, count: int
) -> tuple[np.ndarray, list[moves.DepthFrames]]:
    """Return ``count`` takes of a ``part`` (train or test) as `record` draws them: poses (takes,
    M+1, n) in rad of the motion capture, and the exposures of the depth camera in each take.
    """
    dynamics, motion = disturb(laboratory.dynamics, factors), laboratory.motion
    opened = moves.open_session(
        laboratory.chain, dynamics, rng.stream(seed, "record.session")
    )
    poses, frames = [], []
    for number in range(count):
        stream = rng.stream(seed, f"record.{part}", number)
        take = moves.perform(opened, motion, dynamics, stream)
        frames.append(
            moves.depth_frames(take.swing, motion.duration, laboratory.clock, stream)
        )
        poses.append(take.motion_capture)
    return np.stack(poses), frames


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
    root = axes * np.sqrt(
        np.maximum(variances, 0.0)
    )  # an eigenvalue may round to below zero
    return poses + factor * stream.standard_normal(poses.shape) @ root.T


def observe(
    laboratory: Laboratory, factors: Factors, seed: int, training: int, test: int
) -> tuple[Takes, Camera]:
    """Return ``training`` and ``test`` takes, and the depth camera with its estimated noise; raises
    SingularJacobianError, and RecordingError if the test takes are too few to estimate the noise.
    """
    parts = {"train": training, "test": test}
    performed = [perform(laboratory, factors, seed, *part) for part in parts.items()]
    poses, others = (
        measure_poses(
            q, laboratory.pose_noise, factors.get("motion_capture", 1.0), stream
        )
        for number, (q, _) in enumerate(performed)
        for stream in [rng.stream(seed, "simulated.capture", number)]
    )
    names, tested = (
        [f"{part}_{n:03d}" for n in range(1, count + 1)]
        for part, count in parts.items()
    )
    motion, stream = laboratory.motion, rng.stream(seed, "simulated.camera")
    t, joints, angles = np.arange(others.shape[1]) / motion.rate, [], []
    for name, frames, q in zip(tested, performed[1][1], others, strict=True):
        noise = laboratory.depth_noise.sample(frames.exposed / motion.duration, stream)
        seen = frames.joints + factors.get("depth_camera", 1.0) * noise
        joints.append(
            pd.DataFrame({"take": name, "t": t} | spread("q", laboratory.joints, q))
        )
        place = {"take": name, "t": frames.exposed, "frame": range(len(seen))}
        angles.append(pd.DataFrame(place | spread("q", laboratory.joints, seen)))
    recordings = (pd.concat(each, ignore_index=True) for each in (angles, joints))
    of_name = dict(zip(tested, others, strict=True))
    takes = Takes(steps(laboratory, poses), tuple(names), poses, of_name)
    return takes, camera_of(*recordings, window=laboratory.window)
