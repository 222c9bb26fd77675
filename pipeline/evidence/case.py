"""A case: the choices in everything that paper and user leave open, and the recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core import contracts, rng
from pipeline.core.columns import PLANE, columns
from pipeline.core.errors import ModelDomainError
from pipeline.core.filters import KINDS, SPEED
from pipeline.core.options.analysis import Filter
from pipeline.core.options.dataset import Motion, Robot
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.models import kinds
from pipeline.models.model import MotionModel
from pipeline.models.prediction import modelled_noise
from pipeline.models.speed.fit import Options as SpeedOptions
from pipeline.models.steps import Options, Recorded
from pipeline.models.wishart.decomposition import COMPUTED, decomposition_of
from pipeline.perception.depth_noise import errors_of, leave_one_out
from pipeline.recordings.steps import training_steps
from pipeline.statistics.curves import ModelledNoise, variation_limits

WISHART = "wishart"
NAMES = {
    "pivoted_lu": "pivoted LU",
    "qr": "QR of J",
    "qr_transposed": "QR of Jᵀ (control)",
}


@dataclass(frozen=True)
class Choices:
    """Options of the models, the filter and the comparison in one case."""

    models: dict[str, Options]  # by name; the paper's models by their kind
    filter: Filter | None  # None if the posteriors are read
    mode: str  # mode of the realisations: one_step or free_running
    clock: str = "aligned"  # key of the camera in Recordings.cameras
    # factor on the measurement noise that scores add to every step, or 0
    measurement: float = 1.0
    batch: int = 0  # number of the batch of test takes for the filter
    draw: int = 0  # number of the random stream
    # whether the paper's models are also filtered in a closed loop
    closed: bool = False

    @classmethod
    def of_run(cls, settings: SimpleNamespace) -> "Choices":
        """Return the run's choices: its first model of each of the paper's kinds."""
        return cls(settings.paper_models, settings.filter, settings.simulation.mode)

    @property
    def name(self) -> str:
        """Name of the only model of the case."""
        (name,) = self.models
        return name

    @property
    def options(self) -> Options:
        """Options of the only model of the case."""
        (options,) = self.models.values()
        return options

    def model_case(self, name: str) -> "Choices":
        """Return this case with only the model ``name``, and default choices for the filter."""
        defaults = {"filter": None, "clock": "", "batch": 0}
        closed = self.closed and self.models[name].kind in KINDS
        return replace(
            self,
            models={name: self.models[name]},
            closed=closed,
            **defaults,
        )

    def filter_case(self, name: str, closed: bool) -> "Choices":
        """Return this case with one model, its loop, and defaults for choices without effect."""
        defaults = {"mode": "", "measurement": 1.0, "batch": 0}
        return replace(
            self,
            models={name: self.models[name]},
            closed=closed,
            **defaults,
        )

    def with_wishart(self, **changes: object) -> "Choices":
        """Return this case with ``changes`` of the options of the Wishart model."""
        wishart = replace(self.models["wishart"], **changes)
        return replace(self, models=self.models | {"wishart": wishart})


@dataclass(frozen=True)
class Takes:
    """Training takes, and any test takes."""

    training: Recorded
    names: tuple[str, ...]  # of the training takes
    poses: np.ndarray  # (takes, M+1, n) rad, of the training takes
    test: dict[str, np.ndarray]  # take → (M+1, n) rad

    @cached_property
    def speed_law(self) -> MotionModel | None:
        """Law of the joint speed alone, fitted to the training takes; None if Σ_m is unknown."""
        try:
            return kinds.estimate(self.training, SpeedOptions(kind=SPEED)).model
        except ModelDomainError:
            return None

    @cached_property
    def speed_noise(self) -> ModelledNoise | None:
        """Noise of the speed law at the recorded total variance, None if it cannot have it."""
        if self.speed_law is None:
            return None
        try:
            return modelled_noise(self.speed_law, self.training)
        except ModelDomainError:
            return None


class Camera(NamedTuple):
    """Measurements of the test takes with the instrument's frames on one clock, and its noise."""

    noise: pd.DataFrame | None  # of leave_one_out; None if other instruments measure
    takes: dict[str, Measurements]
    slopes: pd.DataFrame | None = None  # of error_slopes near a sample


@dataclass(frozen=True)
class Recordings:
    """Takes, cameras, sizes and the seed of the evaluation of every case."""

    takes: Takes
    cameras: Mapping[str, Camera]  # by clock; empty without a depth camera
    rate: float  # 1/s, of the motion
    filtered: int  # number of takes in a batch of the filter
    realizations: int
    seed: int
    # whether cases have the evidence on the recordings themselves
    described: bool = True

    def generator(self, name: str, *trial: int, draw: int = 0) -> np.random.Generator:
        """Return :func:`pipeline.core.rng.drawn_stream` of these recordings' seed."""
        return rng.drawn_stream(self.seed, name, *trial, draw=draw)

    @cached_property
    def variation_limits(self) -> np.ndarray | None:
        """:func:`variation_limits` (n, 2) of the training takes, None unless they are described."""
        if not self.described:
            return None
        return variation_limits(
            self.takes.training.noise,
            self.generator("score.variation"),
        )


def recorded_takes(robot: Robot, motion: Motion) -> Takes:
    """Return the training and test takes of ``motion`` from the tables of the stage track."""
    joints = contracts.read("joints", Path("data/track"))
    training = joints[joints["part"] == "training"]
    names, poses = contracts.stacked(training, "q")
    test = joints[joints["part"] == "test"]
    angles = columns("q", robot.joints)
    test_poses = {}
    for take, rows in test.groupby("take"):
        test_poses[take] = np.array(rows[angles], order="C")
    steps = training_steps(robot, motion)
    return Takes(steps, tuple(names), poses, test_poses)


def camera_of(angles: pd.DataFrame, joints: pd.DataFrame, *, window: int) -> Camera:
    """Return the camera of the table ``angles``, its noise against ``joints`` over ± ``window``."""
    noise = leave_one_out(errors_of(angles, joints), window=window)
    return Camera(noise, {take.take: take for take in measurements(angles, noise)})


def readings(
    base: Choices,
    task: Sequence[str] = PLANE,
    joints: Sequence[str] = PLANE,
) -> dict[str, Choices]:
    """Return by name ``base`` and the case of every other decomposition of the Wishart model, a
    reading of "LU or QR" (Eq. LUDecom); {} without a Wishart model.
    """
    wishart = base.models.get(WISHART)
    if wishart is None:
        return {}
    of_run = decomposition_of(wishart.decomposition, task, joints).name
    cases = {NAMES.get(of_run, of_run): base}
    for name in COMPUTED:
        cases.setdefault(NAMES[name], base.with_wishart(decomposition=name))
    return cases
