"""Posteriors of the particle filter under every model, as laws of the pose that was measured."""

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
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.filtering.particle_filter import FilterOptions, Posterior, Start, particle_filter
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded
from pipeline.statistics.take_scores import Scores, posterior_scores

ARTICULATE, FILTER = Path("data/articulate"), Path("data/filter")


@dataclass(frozen=True)
class Filters:
    """What the filters of the baselines run with."""

    fitted: Mapping[str, MotionModel]
    recorded: Recorded
    rate: float  # 1/s
    start: Start
    options: FilterOptions
    seed: int


def filtered_scores(
    chosen: Sequence[str],
    beside: Sequence[str],
    fitted: Mapping[str, MotionModel],
    recorded: Recorded,
    joints: pd.DataFrame,
    settings,
) -> dict[str, Scores]:
    """The scores of every filter's posterior as a law of the measured pose: those of the models
    ``chosen`` for the run, and filters run here of those ``beside`` them.
    """
    if not contracts.exists("angles", ARTICULATE):
        return {}
    names, o = recorded.joints, settings.filter
    measured = joints[["take", "k", *columns("q", names)]]
    tables = {
        model: contracts.read("posterior", FILTER / model).merge(measured, on=["take", "k"])
        for model in chosen
    }
    shape = (next(iter(tables.values()))["take"].nunique(), -1, len(names))
    truth = values(next(iter(tables.values())), "q").reshape(shape)
    means = {model: values(table, "m").reshape(shape) for model, table in tables.items()}
    covariances = {
        model: matrices(table, "c", names).reshape(*means[model].shape, len(names))
        for model, table in tables.items()
    }
    first = joints[(joints.part == "training") & (joints.k == 0)][columns("q", names)]
    run = Filters(
        fitted,
        recorded,
        settings.dataset.motion.rate,
        Start(first.mean().to_numpy(), first.cov().to_numpy()),
        FilterOptions(o.particles, o.scheme, o.threshold),
        settings.seed,
    )
    noise = contracts.read("kinect_noise", ARTICULATE)
    takes = list(enumerate(measurements(contracts.read("angles", ARTICULATE), noise)))
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
    pose = recorded.measurement / 2  # ω holds the noise of two poses
    return {
        model: posterior_scores(mean - truth, covariances[model] + pose, names)[0]
        for model, mean in means.items()
    }


def _filter(trial: tuple[str, int, Measurements], run: Filters) -> Posterior:
    model, number, take = trial
    recorded, stream = run.recorded, rng.stream(run.seed, f"filter.{model}", number)
    fitted, dt = run.fitted[model], 1 / run.rate
    return particle_filter(
        fitted, recorded.chain, recorded.v, dt, run.start, take, run.options, stream
    )
