"""wrench_moments: the matrix model of the wrench with moments, in the plane and in space."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import MISSING

from pipeline.core import config, contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Wrench
from pipeline.studies import page
from pipeline.studies.wrench_moments.errors import Place, error_rows, slope_rows
from pipeline.studies.wrench_moments.recorded import recorded_rows
from pipeline.studies.wrench_moments.words import TITLE, sections
from pipeline.wrench.bounds import study_bounds

HERE, OUT = Path(__file__).parent, page.DATA / "wrench_moments"


@dataclass
class Recorded:
    """The systems whose directions are recorded."""

    agents: list[int] = MISSING
    systems: int = MISSING
    samples: int = MISSING  # of the directions of each system


@dataclass
class Options:
    """What goes beyond the bounds of the paper's study."""

    attachment: list[float] = MISSING  # m, each coordinate
    elevation: list[float] = MISSING  # rad
    agents: list[int] = MISSING  # in space
    lengths: list[float] = MISSING  # over the root mean square distance of an attachment
    recorded: Recorded = field(default_factory=Recorded)

    def __post_init__(self) -> None:
        if 1.0 not in self.lengths or np.any(np.diff(self.lengths) <= 0):
            raise ConfigError("lengths must grow, and hold 1", key="lengths")


def run() -> None:
    """Hold the matrix model against the parametric one in each place, and write the page."""
    settings = config.sections("wrench_moments", HERE / "dvc.yaml")
    options, compute = config.study_options(HERE, Options), settings.compute
    every = places(settings.wrench, options)
    shared = {"seed": settings.seed, "every": every}
    trials = [
        (number, length, repeat)
        for number, place in enumerate(every)
        for length in (options.lengths if place.bounds.attachment else [1.0])
        for repeat in range(settings.wrench.repeats if length == 1 else 1)
    ]
    function = partial(error_table, study=settings.wrench, **shared)
    errors = run_trials(function, trials, compute=compute, label="wrench_moments: errors")
    errors = pd.concat(list(errors), ignore_index=True)
    function = partial(recorded_table, recorded=options.recorded, **shared)
    pairs = [(number, m) for number in range(len(every)) for m in options.recorded.agents]
    psi = run_trials(function, pairs, compute=compute, label="wrench_moments: recorded")
    tables = {
        "wrench_moments": errors,
        "wrench_slopes": slope_rows(errors),
        "recorded_psi": pd.concat(list(psi), ignore_index=True),
    }
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("wrench_moments", {}, compute)
    page.write_page("wrench_moments", TITLE, sections(every, options.recorded.samples, **tables))


def places(study: Wrench, options: Options) -> list[Place]:
    """The paper's systems, the same with their attachments apart, and those in space.

    Raises ConfigError for a single number of cables, which has no slope.
    """
    if min(len(study.agents), len(options.agents)) < 2:
        raise ConfigError("a slope needs two numbers of cables", key="agents")
    point = study_bounds(study)
    plane = replace(point, attachment=tuple(options.attachment))
    space = replace(plane, elevation=tuple(options.elevation))
    return [
        Place("point", point, study.agents),
        Place("plane", plane, study.agents),
        Place("space", space, options.agents),
    ]


def error_table(
    trial: tuple[int, float, int], study: Wrench, seed: int, every: list[Place]
) -> pd.DataFrame:
    """The rows of one repeat of one place at one characteristic length; every length has the same
    systems.
    """
    number, length, repeat = trial
    generator = rng.stream(seed, "wrench_moments.errors", number, repeat)
    table = error_rows(every[number], length, study.systems, study.test_systems, generator)
    return table.assign(place=every[number].name, length=length, repeat=repeat)


def recorded_table(
    trial: tuple[int, int], recorded: Recorded, seed: int, every: list[Place]
) -> pd.DataFrame:
    """The rows of the recorded systems of one place and number of cables."""
    number, agents = trial
    generator = rng.stream(seed, "wrench_moments.recorded", number, agents)
    table = recorded_rows(every[number], agents, recorded.systems, recorded.samples, generator)
    return table.assign(place=every[number].name)
