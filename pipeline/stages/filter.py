"""filter@model: sequential importance sampling of every test take under one motion model (Sec.
"RMT-based particle filtering").
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.interface import Chain
from pipeline.core import config, contracts, rng
from pipeline.core.columns import spread, triangle
from pipeline.core.compute.trials import run_trials
from pipeline.filtering.instruments import measured_takes
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.closed_loop import FOLDER, fitted_closed_loop, mean_path
from pipeline.models.kinds import fitted_models
from pipeline.models.model import Commands, MotionModel, open_loop
from pipeline.recordings.steps import training_steps

FIT, OUT = Path("data/fit"), Path("data/filter")
OF_A_STEP = ("ess", "resampled", "measured", "clipped", "outside")


def run(model: str) -> None:
    """Posterior mean, covariance and effective sample size of every test take, in an open loop and,
    where the model has been fitted in one, in a closed loop.
    """
    settings = config.sections("filter", item=model)
    robot, options = settings.dataset.robot, settings.filter
    metrics = {}
    with contracts.replacing(OUT / model) as folder:
        if takes := list(enumerate(measured_takes(settings.dataset))):
            rate = settings.dataset.motion.rate
            recorded = training_steps(robot, settings.dataset.motion)
            loops = {}
            if fitted := fitted_models([model], FIT, "filter"):
                loops[""] = (fitted[model], open_loop(recorded.v))
            closed = fitted_closed_loop(FIT / model)
            if closed is not None:
                loops[FOLDER] = (closed[0], mean_path(recorded).commands(closed[1]))
            first = recorded.q[:, 0]
            for loop, (fitted, commands) in loops.items():
                trial = partial(
                    filter_take,
                    model=fitted,
                    chain=recorded.chain,
                    joints=robot.joints,
                    commands=commands,
                    rate=rate,
                    start=Start(first.mean(axis=0), np.cov(first.T)),
                    options=FilterOptions(options.particles, options.scheme, options.threshold),
                    stream=(settings.seed, ".".join(filter(None, ("filter", model, loop)))),
                )
                label = " ".join(filter(None, ("filter", model, loop)))
                rows = list(
                    run_trials(trial, takes, compute=settings.compute, label=f"{label}: takes")
                )
                posterior = pd.concat([table for table, _, _ in rows], ignore_index=True)
                (folder / loop).mkdir(exist_ok=True)
                contracts.write(posterior, "posterior", folder / loop)
                prefix = "closed_loop_" if loop else ""
                metrics |= {f"{prefix}{name}": n for name, n in _metrics(posterior, rows).items()}
        else:
            print("filter: the dataset has no measurements of its test takes; nothing to filter")
        contracts.write_metrics(metrics, folder / "filter.json")


def _metrics(
    posterior: pd.DataFrame, rows: Sequence[tuple[pd.DataFrame, int, float]]
) -> dict[str, float]:
    """How the filters of all takes fared."""
    return {
        "mean_effective_sample_size": posterior["ess"].mean(),
        "share_of_steps_resampled": posterior["resampled"].mean(),
        "particle_steps_with_clipped_noise": posterior["clipped"].sum(),
        "particle_steps_outside_the_domain": posterior["outside"].sum(),
        "measurements_outside_the_motion": sum(left_out for _, left_out, _ in rows),
        "mean_log_evidence_per_take": np.mean([evidence for _, _, evidence in rows]),
    }


def filter_take(
    trial: tuple[int, Measurements],
    model: MotionModel,
    chain: Chain,
    joints: Sequence[str],
    commands: Commands,
    rate: float,
    start: Start,
    options: FilterOptions,
    stream: tuple[int, str],
) -> tuple[pd.DataFrame, int, float]:
    """Rows of the table ``posterior`` of one take, how many of its measurements lie outside the
    motion, and its log evidence.
    """
    number, take = trial
    generator = rng.stream(*stream, number)
    posterior = particle_filter(model, chain, commands, 1 / rate, start, take, options, generator)
    k = np.arange(len(posterior.mean))
    table = {"take": take.take, "part": "test", "k": k, "t": k / rate}
    table |= spread("m", joints, posterior.mean) | triangle("c", joints, posterior.covariance)
    table |= {name: getattr(posterior, name) for name in OF_A_STEP}
    return pd.DataFrame(table), posterior.left_out, posterior.log_evidence
