"""which_decomposition: which decomposition of the Jacobian the paper's printed numbers allow, over
random paths of its arm.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace

import pandas as pd
from omegaconf import MISSING, OmegaConf

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import arm_of, chain_of
from pipeline.cases.verdict import read_claims
from pipeline.core import config, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.core.options.dataset import Robot
from pipeline.core.typed_yaml import load_yaml, typed
from pipeline.recordings.steps import training_steps
from pipeline.studies.frame import Study
from pipeline.studies.published import Published, published
from pipeline.studies.which_decomposition.evidence import (
    Widths,
    evidence_rows,
    joined,
    unsquared_rows,
    width_rows,
    widths,
)
from pipeline.studies.which_decomposition.level import level_rows
from pipeline.studies.which_decomposition.paths import KINDS, TimeLaw, draw_paths, with_tool
from pipeline.studies.which_decomposition.units import SpaceMotion, unit_rows
from pipeline.studies.which_decomposition.words import page

STEPS = 320  # M of the paper
RAMPED, FULL_SPEED = "ramps and rest", "constant full speed"
PAPER_ARM = "youbot"  # whatever dataset is analysed


@dataclass
class Options:
    """Ranges of the path prior, tolerances of the likelihood, and an arm in space."""

    chunks: int = MISSING  # random streams, each with one tool length
    paths: int = MISSING  # of each kind a chunk, with ramps and rest
    full_speed_paths: int = MISSING  # likewise, at constant full speed
    tool: list[float] = MISSING  # m, from joint 4 to the end-effector
    rest: list[float] = MISSING  # s
    ramp: list[float] = MISSING  # s
    peak: list[float] = MISSING  # share of the speed limit
    once: list[float] = MISSING  # share of 3.2 s that a path takes once at constant full speed
    least_norm: float = MISSING  # of the greatest ‖J⁻¹‖ on a path, for the prior near û
    tolerances: list[float] = MISSING  # factors
    span: list[float] = MISSING  # least and greatest factor of the integral
    space: SpaceMotion = field(default_factory=SpaceMotion)

    def __post_init__(self) -> None:
        for name in ("tool", "rest", "ramp", "peak", "once", "span"):
            values = getattr(self, name)
            if len(values) != 2 or not 0 <= values[0] <= values[1]:
                raise ConfigError(f"two numbers, 0 ≤ least ≤ greatest, got {values}", key=name)
        if min(*self.tolerances, *self.span) <= 1:
            raise ConfigError("a tolerance is a factor above 1", key="tolerances")
        if self.chunks < 1 or min(self.paths, self.full_speed_paths) < 2:
            raise ConfigError("1 chunk or more of 2 paths or more", key="paths")


def evaluate(settings: SimpleNamespace, options: Options) -> dict[str, pd.DataFrame]:
    """Return the tables ``evidence``, ``widths``, ``unsquared``, ``units`` and, where the motion
    rests, ``level``.
    """
    robot, rate = robot_of(PAPER_ARM)
    stated = published(read_claims())
    chain = arm_of(robot).chain
    trial = partial(
        widths_of_chunk,
        chain=chain,
        laws=time_laws(options, rate),
        stated=stated,
        tool=tuple(options.tool),
        seed=settings.seed,
    )
    label = "which_decomposition: paths"
    chunks = list(run_trials(trial, range(options.chunks), compute=settings.compute, label=label))
    drawn = {name: joined([chunk[name] for chunk in chunks]) for name in chunks[0]}
    evidence = [
        evidence_rows(part, stated, options.tolerances, tuple(options.span)).assign(prior=name)
        for name, part in priors(drawn, options.least_norm).items()
    ]
    space, _ = robot_of(options.space.arm)
    tables = {
        "evidence": pd.concat(evidence, ignore_index=True),
        "widths": pd.concat(
            [width_rows(part, stated).assign(prior=name) for name, part in drawn.items()],
            ignore_index=True,
        ),
        "unsquared": unsquared_rows(drawn[RAMPED], stated, options.tolerances),
        "units": unit_rows(chain_of(space), options.space, stated.sigma_b),
    }
    try:
        recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
        tables["level"] = level_rows(recorded)
    except ModelDomainError as reason:
        print(f"which_decomposition: no level of the recordings: {reason}")
    return tables


def widths_of_chunk(
    chunk: int,
    chain: PlanarChain,
    laws: dict[str, tuple[TimeLaw, int]],
    stated: Published,
    tool: tuple[float, float],
    seed: int,
) -> dict[str, Widths]:
    """Both models on the paths of one ``chunk``, by the name of the time law.

    Args:
        chunk: its number.
        chain: the arm.
        laws: time laws, and the number of paths of each kind.
        stated: the printed values.
        tool: range of the tool length in m.
        seed: of the experiment.
    """
    stream = rng.stream(seed, "which_decomposition", chunk)
    chain = with_tool(chain, stream.uniform(*tool))
    return {
        name: joined(
            [
                widths(chain, draw_paths(chain, law, kind, stated.u, count, stream), stated, kind)
                for kind in KINDS
            ]
        )
        for name, (law, count) in laws.items()
    }


def time_laws(options: Options, rate: float) -> dict[str, tuple[TimeLaw, int]]:
    """The two time laws, and the number of paths of each kind in a chunk."""
    ranges = (tuple(getattr(options, name)) for name in ("rest", "ramp", "peak"))
    still, full = (0.0, 0.0), (1.0, 1.0)
    constant = TimeLaw(STEPS, rate, still, still, full, tuple(options.once))
    return {
        RAMPED: (TimeLaw(STEPS, rate, *ranges), options.paths),
        FULL_SPEED: (constant, options.full_speed_paths),
    }


def priors(drawn: dict[str, Widths], least_norm: float) -> dict[str, Widths]:
    """The paths of each prior: all with ramps and rest first, parts of these, full speed."""
    ramped = drawn[RAMPED]
    parts = {f"{kind}s alone": ramped.subset(ramped.kind == kind) for kind in KINDS}
    parts[f"greatest ‖J⁻¹‖ above {least_norm:g}"] = ramped.subset(ramped.norm > least_norm)
    return {RAMPED: ramped} | parts | {FULL_SPEED: drawn[FULL_SPEED]}


def robot_of(dataset: str) -> tuple[Robot, float]:
    """The robot of ``pipeline/conf/dataset``, and its steps a second."""
    section = load_yaml(config.CONF / f"dataset/{dataset}.yaml")
    robot = OmegaConf.to_object(typed(Robot, section.robot, "robot"))
    return robot, float(section.motion.rate)


run = Study("Which decomposition the printed numbers allow", Options, evaluate, page).run
