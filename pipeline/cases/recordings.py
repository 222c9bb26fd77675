"""Takes of the motion capture and the depth camera that cases are worked out from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core import contracts
from pipeline.core.columns import columns
from pipeline.core.options.dataset import Motion, Robot
from pipeline.core.rng import stream
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.models.steps import Recorded
from pipeline.perception.depth_noise import errors_of, leave_one_out
from pipeline.recordings.steps import training_steps
from pipeline.statistics.curves import constant_noise_variation
from pipeline.verdicts.reference import ArmNames

CONSTANT_SEED = 20_171


@dataclass(frozen=True)
class Takes:
    """Takes to fit to and, where there are any, those kept for testing."""

    training: Recorded
    poses: np.ndarray  # (takes, M+1, n) rad, of the training takes
    test: dict[str, np.ndarray]  # take → (M+1, n) rad

    @cached_property
    def variation_of_constant_noise(self) -> np.ndarray:
        """(n,) of the training takes, with the same draws in every case."""
        rng = stream(CONSTANT_SEED, "cases.constant_noise")
        return constant_noise_variation(self.training.noise, rng)

    @property
    def arm(self) -> ArmNames:
        """Names of joints and rows in claims."""
        return ArmNames(tuple(self.training.joints), tuple(self.training.chain.task))


class Camera(NamedTuple):
    """The depth camera, its frames on one clock and articulated in one way."""

    noise: pd.DataFrame  # as of leave_one_out
    takes: dict[str, Measurements]


def recorded_takes(robot: Robot, motion: Motion) -> Takes:
    """Training and test takes of ``motion`` as ``track`` wrote them."""
    joints = contracts.read("joints", Path("data/track"))
    _, poses = contracts.stacked(joints[joints.part == "training"], "q")
    test = {
        take: np.array(rows[columns("q", robot.joints)], order="C")
        for take, rows in joints[joints.part == "test"].groupby("take")
    }
    return Takes(training_steps(robot, motion), poses, test)


def camera_of(angles: pd.DataFrame, joints: pd.DataFrame, *, window: int) -> Camera:
    """The camera that measured ``angles``, its noise estimated over ``window`` frames on either
    side; ``angles`` and ``joints`` are tables of depth camera and motion capture.

    Raises RecordingError where the takes are too few to estimate the noise from.
    """
    noise = leave_one_out(errors_of(angles, joints), window=window)
    return Camera(noise, {take.take: take for take in measurements(angles, noise)})
