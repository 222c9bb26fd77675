"""A case, one way to decide everything that the paper or a user leaves open; and the recordings
that cases are evaluated on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core import contracts
from pipeline.core.columns import columns
from pipeline.core.options.dataset import Motion, Robot
from pipeline.core.rng import stream
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.filtering.particle_filter import FilterOptions, Start
from pipeline.models.steps import Options, Recorded
from pipeline.perception.depth_noise import errors_of, leave_one_out
from pipeline.recordings.steps import training_steps
from pipeline.statistics.curves import constant_noise_variation
from pipeline.verdicts.run import ArmNames

# the paper's models, the first being the one that the others are compared with
KINDS = ("additive", "wishart", "gaussian")
CONSTANT_SEED = 20_171


@dataclass(frozen=True)
class Choices:
    """One way to decide everything."""

    models: dict[str, Options]  # by name; those of the paper by their kind
    filter: FilterOptions
    mode: str  # of the realisations: one_step or free_running
    clock: str = "aligned"  # name of the camera in the recordings
    measurement: float = 1.0  # factor on the measurement noise that scores add to every step, or 0
    batch: int = 0  # number of the batch of test takes for the filter
    draw: int = 0  # number of the random stream
    closed: bool = False  # filters the paper's models in a closed loop too

    @classmethod
    def of_run(cls, settings: SimpleNamespace, **further: Options) -> "Choices":
        """The run's own choices: its first model of each of the paper's kinds, and ``further``."""
        by_kind = {model.kind: model for model in reversed(list(settings.models.values()))}
        models = {kind: by_kind[kind] for kind in KINDS if kind in by_kind} | further
        own = settings.filter
        chosen = FilterOptions(own.particles, own.scheme, own.threshold)
        return cls(models, chosen, settings.simulation.mode)

    @property
    def options(self) -> Options:
        """Options of the only model."""
        (options,) = self.models.values()
        return options

    def model_case(self, name: str) -> "Choices":
        """This case with the model ``name`` alone and defaults for the filter's decisions."""
        closed, plain = self.closed and name in KINDS, {"filter": FilterOptions(), "clock": ""}
        return replace(self, models={name: self.models[name]}, batch=0, closed=closed, **plain)

    def filter_case(self, name: str, closed: bool) -> "Choices":
        """This case with one model's filter in one loop, and defaults where it does not matter."""
        plain = {"mode": "", "measurement": 1.0, "batch": 0}
        return replace(self, models={name: self.models[name]}, closed=closed, **plain)

    def with_wishart(self, **changes: object) -> "Choices":
        """This case with other options of the Wishart model."""
        wishart = replace(self.models["wishart"], **changes)
        return replace(self, models=self.models | {"wishart": wishart})


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

    @property
    def start(self) -> Start:
        """The law of the first pose."""
        first = self.poses[:, 0]
        return Start(first.mean(axis=0), np.cov(first.T))


class Camera(NamedTuple):
    """The depth camera, its frames on one clock and articulated in one way."""

    noise: pd.DataFrame  # as of leave_one_out
    takes: dict[str, Measurements]


@dataclass(frozen=True)
class Recordings:
    """Takes, cameras, sizes and random numbers of the evaluation of every case."""

    takes: Takes
    cameras: Mapping[str, Camera]  # by clock or name; none where there is no depth camera
    rate: float  # 1/s, of the motion
    filtered: int  # takes that the filter runs on
    realizations: int
    stream: tuple[int, str]  # seed and name of the random numbers


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
    """The camera that measured the table ``angles``, its noise against the table ``joints`` over
    ``window`` frames on either side; RecordingError for too few takes.
    """
    noise = leave_one_out(errors_of(angles, joints), window=window)
    return Camera(noise, {take.take: take for take in measurements(angles, noise)})
