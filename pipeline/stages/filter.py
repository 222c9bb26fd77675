"""filter@model: particle filter of the test takes (Sec. "RMT-based particle filtering")."""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.columns import spread, triangle
from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Filter
from pipeline.filtering.measurement import Measurements, measured_takes
from pipeline.filtering.particle_filter import Start, particle_filter
from pipeline.models.closed_loop import FOLDER, fitted_closed_loop, mean_path
from pipeline.models.kinds import fitted_models
from pipeline.models.model import Commands, MotionModel, open_loop
from pipeline.models.steps import Recorded
from pipeline.recordings.steps import training_steps

FIT, OUT = Path("data/fit"), Path("data/filter")
OF_A_STEP = (
    "ess",
    "resampled",
    "measured",
    "clipped",
    "outside",
)  # fields of a posterior


def run(model: str) -> None:
    """Write the posterior of every test take in the open and in the closed loop of ``model``."""
    settings = config.sections("filter", item=model)
    takes, options, metrics = (
        list(enumerate(measured_takes(settings.dataset))),
        settings.filter,
        {},
    )
    with contracts.replacing(OUT / model) as folder:
        if not takes:
            print(
                "filter: the dataset has no measurements of its test takes; nothing to filter"
            )
            return contracts.write_metrics(metrics, folder / "filter.json")
        recorded, loops = (
            training_steps(settings.dataset.robot, settings.dataset.motion),
            {},
        )
        if fitted := fitted_models([model], FIT, "filter"):
            loops[""] = (fitted[model], open_loop(recorded.v))
        if (closed := fitted_closed_loop(FIT / model)) is not None:
            loops[FOLDER] = (closed[0], mean_path(recorded).commands(closed[1]))
        first = recorded.q[:, 0]
        start = Start(first.mean(axis=0), np.cov(first.T))
        for loop, law in loops.items():
            label = " ".join(filter(None, ("filter", model, loop)))
            same = {
                "law": law,
                "recorded": recorded,
                "start": start,
                "options": options,
            }
            stream = (settings.seed, label.replace(" ", "."))
            trial = partial(
                filter_take, rate=settings.dataset.motion.rate, stream=stream, **same
            )
            rows = run_trials(
                trial, takes, compute=settings.compute, label=f"{label}: takes"
            )
            posteriors, left_out = zip(*rows, strict=True)
            posterior = pd.concat(posteriors, ignore_index=True)
            (folder / loop).mkdir(exist_ok=True)
            contracts.write(posterior, "posterior", folder / loop)
            numbers = {
                "particle_steps_with_clipped_noise": posterior["clipped"].sum(),
                "particle_steps_outside_the_domain": posterior["outside"].sum(),
                "measurements_outside_the_motion": sum(left_out),
            }
            metrics |= {
                f"{'closed_loop_' * bool(loop)}{name}": n for name, n in numbers.items()
            }
        contracts.write_metrics(metrics, folder / "filter.json")


def filter_take(
    trial: tuple[int, Measurements],
    law: tuple[MotionModel, Commands],
    recorded: Recorded,
    rate: float,
    start: Start,
    options: Filter,
    stream: tuple[int, str],
) -> tuple[pd.DataFrame, int]:
    """Return one take's posterior and the number of measurements outside the motion."""
    (number, take), (model, commands) = trial, law
    motion, generator = (
        (recorded.chain, commands, 1 / rate, start),
        rng.stream(*stream, number),
    )
    posterior = particle_filter(model, *motion, take, options, generator)
    k = np.arange(len(posterior.mean))
    table = {"take": take.take, "part": "test", "k": k, "t": k / rate}
    table |= spread("m", recorded.joints, posterior.mean)
    table |= triangle("c", recorded.joints, posterior.covariance)
    table |= {name: getattr(posterior, name) for name in OF_A_STEP}
    return pd.DataFrame(table), posterior.left_out
