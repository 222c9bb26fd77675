"""Posteriors of the particle filter under every model, in both loops, as laws of the pose that was
measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core import contracts, rng
from pipeline.core.columns import columns, matrices, values
from pipeline.core.compute.trials import run_trials
from pipeline.core.filters import NONE
from pipeline.filtering.measured import measured_takes
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.models.closed_loop import FOLDER
from pipeline.models.commands import Commands
from pipeline.models.model import MotionModel
from pipeline.models.noise import rest_covariance
from pipeline.models.steps import Recorded
from pipeline.statistics.filters import no_filter
from pipeline.statistics.take_scores import Scores, posterior_scores

FILTER = Path("data/filter")

Loops = Mapping[str, tuple[MotionModel, Commands]]  # by model


@dataclass(frozen=True)
class Filters:
    """What the filters of the baselines run with."""

    loops: Loops
    closed: bool
    recorded: Recorded
    rate: float  # 1/s
    start: Start
    options: FilterOptions
    seed: int


def filtered_scores(
    chosen: Sequence[str],
    beside: Loops,
    closed: bool,
    recorded: Recorded,
    joints: pd.DataFrame,
    settings,
) -> dict[str, Scores]:
    """The scores of every filter's posterior as a law of the measured pose: those of the models
    ``chosen`` for the run, and filters run here of those ``beside`` them; no filter last.

    Args:
        chosen: models of the run.
        beside: models that have not been filtered yet.
        closed: whether in a closed loop or in an open one.
        recorded: the training takes.
        joints: the table.
        settings: of the study.
    """
    loop = FOLDER if closed else ""
    places = {
        model: FILTER / model / loop
        for model in chosen
        if contracts.exists("posterior", FILTER / model / loop)
    }
    if not places:
        return {}
    names, o = recorded.joints, settings.filter
    measured = joints[["take", "k", *columns("q", names)]]
    tables = {
        model: contracts.read("posterior", place).merge(measured, on=["take", "k"])
        for model, place in places.items()
    }
    _, truth = contracts.stacked(next(iter(tables.values())), "q")
    means = {model: values(table, "m").reshape(truth.shape) for model, table in tables.items()}
    covariances = {
        model: matrices(table, "c", names).reshape(*truth.shape, len(names))
        for model, table in tables.items()
    }
    first = recorded.q[:, 0]
    run = Filters(
        beside,
        closed,
        recorded,
        settings.dataset.motion.rate,
        Start(first.mean(axis=0), np.cov(first.T)),
        FilterOptions(o.particles, o.scheme, o.threshold),
        settings.seed,
    )
    takes = list(enumerate(measured_takes(settings.dataset)))
    trials = [(model, *take) for model in beside for take in takes]
    posteriors = list(
        run_trials(
            partial(_filter, run=run), trials, compute=settings.compute, label="baselines: filters"
        )
    )
    for place, model in enumerate(beside):
        own = posteriors[place * len(takes) : (place + 1) * len(takes)]
        means[model] = np.stack([posterior.mean for posterior in own])
        covariances[model] = np.stack([posterior.covariance for posterior in own])
    _, training = contracts.stacked(joints[joints.part == "training"], "q")
    # ω holds the noise of two poses
    pose = rest_covariance(training, recorded.v) if closed else recorded.measurement / 2
    scores = {
        model: posterior_scores(mean - truth, covariances[model] + pose, names)[0]
        for model, mean in means.items()
    }
    none = no_filter(training, truth)
    return scores | {NONE: posterior_scores(none.error, none.covariance, names)[0]}


def _filter(trial: tuple[str, int, Measurements], run: Filters) -> Posterior:
    model, number, take = trial
    stream = f"filter.{model}.{FOLDER}" if run.closed else f"filter.{model}"
    fitted, commands = run.loops[model]
    return particle_filter(
        fitted,
        run.recorded.chain,
        commands,
        1 / run.rate,
        run.start,
        take,
        run.options,
        rng.stream(run.seed, stream, number),
    )
