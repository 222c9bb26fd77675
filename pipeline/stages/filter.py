"""filter@model: particle filter of the test takes (Sec. "RMT-based particle filtering")."""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.columns import spread, triangle
from pipeline.core.compute.trials import run_trials
from pipeline.filtering.measurement import Measurements, measured_takes
from pipeline.filtering.particle_filter import (
    FilterTrial,
    Posterior,
    Start,
    take_posterior,
)
from pipeline.models.closed_loop import FOLDER, fitted_closed_loop, loops_of
from pipeline.models.kinds import fitted_models
from pipeline.models.steps import Recorded
from pipeline.recordings.steps import training_steps

FIT = Path("data/fit")
OUT = Path("data/filter")
# fields of a posterior with one value a step
OF_A_STEP = ("ess", "resampled", "measured", "clipped", "outside")
Metrics = dict[str, float]


def run(model: str) -> None:
    """Write the posterior of every test take in the open and in the closed loop of ``model``."""
    settings = config.sections("filter", item=model)
    takes = measured_takes(settings.dataset)
    with contracts.replacing(OUT / model) as folder:
        metrics: Metrics = {}
        if takes:
            metrics = _filter(model, takes, settings, folder)
        else:
            missing = "the dataset has no measurements of its test takes"
            print(f"filter: {missing}; nothing to filter")
        contracts.write_metrics(metrics, folder / "filter.json")


def _filter(model: str, takes: list[Measurements], settings, folder: Path) -> Metrics:
    """Write the posteriors of both loops; return their counts of unusual particles and frames."""
    motion = settings.dataset.motion
    recorded = training_steps(settings.dataset.robot, motion)
    fitted = fitted_models([model], FIT, "filter")
    loops = loops_of(recorded, fitted.get(model), fitted_closed_loop(FIT / model))
    start = Start.of_takes(recorded)
    metrics: Metrics = {}
    for closed, loop in loops.items():
        place = folder / FOLDER if closed else folder
        label = f"filter {model} {FOLDER}" if closed else f"filter {model}"
        prefix = "closed_loop_" if closed else ""
        trials = [
            FilterTrial(model, loop, closed, take, number, start, settings.filter)
            for number, take in enumerate(takes)
        ]
        of_take = partial(
            take_posterior,
            chain=recorded.chain,
            rate=motion.rate,
            seed=settings.seed,
        )
        workers = {"compute": settings.compute, "label": f"{label}: takes"}
        posteriors = list(run_trials(of_take, trials, **workers))
        tables = [
            posterior_table(take.take, posterior, recorded, motion.rate)
            for take, posterior in zip(takes, posteriors, strict=True)
        ]
        table = pd.concat(tables, ignore_index=True)
        place.mkdir(exist_ok=True)
        contracts.write(table, "posterior", place)
        numbers = {
            "particle_steps_with_clipped_noise": table["clipped"].sum(),
            "particle_steps_outside_the_domain": table["outside"].sum(),
            "measurements_outside_the_motion": sum(p.left_out for p in posteriors),
        }
        metrics |= {f"{prefix}{name}": number for name, number in numbers.items()}
    return metrics


def posterior_table(
    take: str,
    posterior: Posterior,
    recorded: Recorded,
    rate: float,
) -> pd.DataFrame:
    """Return the rows of the table ``posterior`` of one take with the ``rate`` in 1/s."""
    k = np.arange(len(posterior.mean))
    table = {"take": take, "part": "test", "k": k, "t": k / rate}
    table |= spread("m", recorded.joints, posterior.mean)
    table |= triangle("c", recorded.joints, posterior.covariance)
    table |= {name: getattr(posterior, name) for name in OF_A_STEP}
    return pd.DataFrame(table)
