"""An arm of the laboratory in one physics, the task that is planned for it, and the takes that it
performs of any motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.arm.commanded import trajectory_table
from pipeline.arm.interface import Chain
from pipeline.arm.model import chain_of
from pipeline.core import rng
from pipeline.core.options.dataset import Robot
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated
from pipeline.laboratory.dynamics import (
    Chance,
    JointPath,
    Session,
    desired_path,
    draw,
    expose,
    open_session,
    swing,
)
from pipeline.laboratory.options import DynamicsOptions, TrajectoryOptions
from pipeline.models.noise import process_noise
from pipeline.models.steps import Recorded
from pipeline.recordings.commands import commanded_steps

TOGETHER = 50  # takes that are simulated at once, so many that memory does not count


@dataclass(frozen=True, eq=False)
class Bench:
    """An arm and its motion, which no physics changes."""

    joints: tuple[str, ...]  # names, base to tip
    built: Chain  # nominal, of the task whose rows sway
    chain: Chain  # of the task that is planned, the same or fewer rows
    trajectory: TrajectoryOptions  # of the dataset, at the pace of the study
    dynamics: DynamicsOptions

    @cached_property
    def recorded(self) -> np.ndarray:
        """(M+1, n) rad, the motion of the dataset."""
        return desired_path(self.built, self.trajectory)

    @property
    def rate(self) -> float:
        """Steps of a motion a second."""
        return self.trajectory.rate

    def command(self, path: np.ndarray) -> np.ndarray:
        """Return the commands (M, m + n) of a ``path`` (M+1, n) in rad, see
        :mod:`pipeline.models.model`; (M, m) of a task that leaves no choice.
        """
        table = trajectory_table(self.chain, path, self.rate, self.joints)
        return commanded_steps(table, self.rate)


def bench_of(file: Path, task: Sequence[str], pace: float) -> Bench:
    """Return the arm of a dataset's option ``file``, with the rows ``task`` to plan (its own where
    none are named) and its motion's times divided by ``pace``; ConfigError.
    """
    section = read_yaml(file)
    robot = validated(Robot, section["robot"], "robot", file)
    motion, dynamics = (
        validated(kind, section["laboratory"][key], f"laboratory.{key}", file)
        for key, kind in (("trajectory", TrajectoryOptions), ("dynamics", DynamicsOptions))
    )
    times = {name: getattr(motion, name) / pace for name in ("duration", "rest", "ramp")}
    built = chain_of(robot)
    chain = chain_of(replace(robot, task=list(task))) if task else built
    return Bench(tuple(robot.joints), built, chain, replace(motion, **times), dynamics)


@dataclass(frozen=True, eq=False)
class Rig:
    """The arm of a ``bench`` in one physics, whose takes draw equal numbers for every motion."""

    bench: Bench
    dynamics: DynamicsOptions
    takes: int
    seed: int

    @cached_property
    def session(self) -> Session:
        """The arm as it was built, and its encoders' zeros."""
        stream = rng.stream(self.seed, "planning.session")
        return open_session(self.bench.built, self.dynamics, stream)

    def poses(self, path: np.ndarray, name: str) -> np.ndarray:
        """Return the (takes, M+1, n) poses in rad of the ``path`` (M+1, n) in rad performed by the
        takes ``name``, without noise of motion capture. Raises ConfigError for a path that the arm
        cannot follow, SingularJacobianError where the sway has no law.
        """
        motion, built = JointPath(path, self.bench.rate), self.bench.built
        motion.require_followable(built)
        grid, poses = np.arange(len(path)) / motion.rate, []
        streams = [rng.stream(self.seed, f"planning.{name}", n) for n in range(self.takes)]
        for first in range(0, self.takes, TOGETHER):
            own = streams[first : first + TOGETHER]
            drawn = [draw(built, motion, self.dynamics, stream) for stream in own]
            chance = Chance(*map(np.stack, zip(*drawn, strict=True)))
            t, q, _ = swing(self.session.chain, self.session.encoder, motion, self.dynamics, chance)
            pairs = zip(q, own, strict=True)
            poses += [expose(t, each, grid, self.dynamics, stream) for each, stream in pairs]
        return np.stack(poses)

    def training(self) -> Recorded:
        """Return the steps of the training takes, of the dataset's motion."""
        bench = self.bench
        q, command = self.poses(bench.recorded, "training"), bench.command(bench.recorded)
        noise = process_noise(bench.chain, q, command)
        return Recorded(bench.chain, q[:, :-1], command, noise, bench.joints)
