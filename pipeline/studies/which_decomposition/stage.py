"""which_decomposition: which decomposition of the Jacobian the paper's printed numbers allow, over
random paths of its arm.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import arm_of, chain_of
from pipeline.cases.readings import read_claims
from pipeline.core import config, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ModelDomainError
from pipeline.core.options.dataset import Robot
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import options, validated
from pipeline.recordings.steps import training_steps
from pipeline.studies.frame import Study
from pipeline.studies.which_decomposition.arms import level_rows, unit_rows
from pipeline.studies.which_decomposition.evidence import (
    Published,
    Widths,
    evidence_rows,
    joined,
    published,
    unsquared_rows,
    width_rows,
    widths,
)
from pipeline.studies.which_decomposition.paths import KINDS, TimeLaw, draw_paths, with_tool
from pipeline.studies.which_decomposition.words import page

STEPS, RATE = 320, 100.0  # M and steps a second of the paper
RAMPED, FULL_SPEED = "ramps and rest", "constant full speed"
PAPER_ARM, SPACE_ARM = "youbot", "ur5"  # whatever dataset is analysed

Range = tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]]
Factor = Annotated[float, Field(gt=1)]
Several = Annotated[int, Field(ge=2)]


@options()
class Options:
    """Ranges of the path prior, tolerances of the likelihood, and a motion of an arm in space."""

    chunks: Annotated[int, Field(ge=1)]  # random streams, each with one tool length
    paths: Several  # of each kind a chunk, with ramps and rest
    full_speed_paths: Several  # likewise, at constant full speed
    tool: Range  # m, from joint 4 to the end-effector
    rest: Range  # s
    ramp: Range  # s
    peak: Range  # share of the speed limit
    once: Range  # share of 3.2 s that a path takes once at constant full speed
    least_norm: float  # of the greatest ‖J⁻¹‖ on a path, for the prior near û
    tolerances: Annotated[list[Factor], Field(min_length=1)]
    span: tuple[Factor, Factor]  # least and greatest tolerance of the integral
    start: list[float]  # rad, of the arm in space
    end: list[float]
    poses: Several
    turns: list[float]  # degrees, of the base's axes about z

    @property
    def laws(self) -> dict[str, tuple[TimeLaw, int]]:
        """Time laws, and the number of paths of each kind in a chunk."""
        still = (0.0, 0.0)
        full = TimeLaw(STEPS, RATE, still, still, (1.0, 1.0), self.once)
        ramped = TimeLaw(STEPS, RATE, self.rest, self.ramp, self.peak)
        return {RAMPED: (ramped, self.paths), FULL_SPEED: (full, self.full_speed_paths)}


def evaluate(settings: SimpleNamespace, options: Options) -> dict[str, pd.DataFrame]:
    """Return the study's tables; ``level`` only if the measurement noise is known."""
    stated, chain = published(read_claims()), arm_of(robot_of(PAPER_ARM)).chain
    trial = partial(
        widths_of_chunk, chain=chain, options=options, stated=stated, seed=settings.seed
    )
    label = "which_decomposition: paths"
    chunks = list(run_trials(trial, range(options.chunks), compute=settings.compute, label=label))
    drawn = {name: joined([chunk[name] for chunk in chunks]) for name in options.laws}
    evidence = {
        name: evidence_rows(part, stated, options.tolerances, options.span)
        for name, part in priors(drawn, options.least_norm).items()
    }
    q = np.linspace(options.start, options.end, options.poses)
    tables = {
        "evidence": _stacked(evidence),
        "widths": _stacked({name: width_rows(part, stated) for name, part in drawn.items()}),
        "unsquared": unsquared_rows(drawn[RAMPED], stated, options.tolerances),
        "units": unit_rows(chain_of(robot_of(SPACE_ARM)), q, options.turns, stated.sigma_b),
    }
    try:
        recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
        tables["level"] = level_rows(recorded)
    except ModelDomainError as reason:
        print(f"which_decomposition: no level of the recordings: {reason}")
    return tables


def widths_of_chunk(
    chunk: int, chain: PlanarChain, options: Options, stated: Published, seed: int
) -> dict[str, Widths]:
    """Both models on the paths of one ``chunk`` of the arm ``chain``, by the time law's name."""
    stream = rng.stream(seed, "which_decomposition", chunk)
    chain, parts = with_tool(chain, stream.uniform(*options.tool)), {}
    for name, (law, count) in options.laws.items():
        drawn = {kind: draw_paths(chain, law, kind, stated.u, count, stream) for kind in KINDS}
        parts[name] = joined([widths(chain, drawn[kind], stated, kind) for kind in KINDS])
    return parts


def priors(drawn: dict[str, Widths], least_norm: float) -> dict[str, Widths]:
    """The paths of each prior: all with ramps and rest, parts of these, full speed."""
    ramped = drawn[RAMPED]
    parts = {f"{kind}s alone": ramped.subset(ramped.kind == kind) for kind in KINDS}
    parts[f"greatest ‖J⁻¹‖ above {least_norm:g}"] = ramped.subset(ramped.norm > least_norm)
    return {RAMPED: ramped} | parts | {FULL_SPEED: drawn[FULL_SPEED]}


def robot_of(dataset: str) -> Robot:
    """The robot of ``pipeline/conf/dataset``."""
    file = config.CONF / f"dataset/{dataset}.yaml"
    return validated(Robot, read_yaml(file)["robot"], "robot", file)


def _stacked(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    parts = [table.assign(prior=name) for name, table in tables.items()]
    return pd.concat(parts, ignore_index=True)


run = Study("Which decomposition the printed numbers allow", Options, evaluate, page).run
