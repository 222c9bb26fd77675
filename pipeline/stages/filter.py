"""filter@model: sequential importance sampling of every test take under one motion model (Sec.
"RMT-based particle filtering").
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import arm_of
from pipeline.core import config, contracts, rng
from pipeline.core.columns import columns, spread, triangle
from pipeline.core.compute.trials import run_trials
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.kinds import fitted_model
from pipeline.models.model import MotionModel
from pipeline.recordings.commands import commanded_steps

MOTION, TRACK = Path("data/ingest/motion"), Path("data/track")
ARTICULATE, FIT, OUT = Path("data/articulate"), Path("data/fit"), Path("data/filter")
METRICS = Path("reports/metrics")
OF_A_STEP = ("ess", "resampled", "measured", "clipped", "outside")


def run(model: str) -> None:
    """Posterior mean, covariance and effective sample size of every test take."""
    settings = config.sections("filter", item=model)
    robot, rate, options = settings.dataset.robot, settings.dataset.motion.rate, settings.filter
    metrics = {}
    with contracts.replacing(OUT / model) as folder:
        if contracts.exists("angles", ARTICULATE):
            angles = contracts.read("angles", ARTICULATE)
            joints = contracts.read("joints", TRACK)
            first = joints[(joints.part == "training") & (joints.k == 0)]
            starts = first[columns("q", robot.joints)]
            trial = partial(
                _filter_take,
                model=fitted_model(FIT / model),
                chain=arm_of(robot).chain,
                joints=robot.joints,
                steps=commanded_steps(contracts.read("trajectory", MOTION), rate),
                rate=rate,
                start=Start(starts.mean().to_numpy(), starts.cov().to_numpy()),
                options=FilterOptions(options.particles, options.scheme, options.threshold),
                stream=(settings.seed, f"filter.{model}"),
            )
            takes = enumerate(measurements(angles, contracts.read("kinect_noise", ARTICULATE)))
            label = f"filter {model}: takes"
            rows = list(run_trials(trial, list(takes), compute=settings.compute, label=label))
            posterior = pd.concat([table for table, _, _ in rows], ignore_index=True)
            contracts.write(posterior, "posterior", folder)
            metrics = {
                "mean_effective_sample_size": posterior["ess"].mean(),
                "share_of_steps_resampled": posterior["resampled"].mean(),
                "particle_steps_with_clipped_noise": posterior["clipped"].sum(),
                "particle_steps_outside_the_domain": posterior["outside"].sum(),
                "measurements_outside_the_motion": sum(left_out for _, left_out, _ in rows),
                "mean_log_evidence_per_take": np.mean([evidence for _, _, evidence in rows]),
            }
        else:
            print("filter: no joint angles from a depth camera; nothing to filter")
    contracts.write_metrics(metrics, METRICS / f"filter_{model}.json")


def _filter_take(
    trial: tuple[int, Measurements],
    model: MotionModel,
    chain: PlanarChain,
    joints: Sequence[str],
    steps: np.ndarray,
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
    posterior = particle_filter(model, chain, steps, 1 / rate, start, take, options, generator)
    k = np.arange(len(posterior.mean))
    table = {"take": take.take, "part": "test", "k": k, "t": k / rate}
    table |= spread("m", joints, posterior.mean) | triangle("c", joints, posterior.covariance)
    table |= {name: getattr(posterior, name) for name in OF_A_STEP}
    return pd.DataFrame(table), posterior.left_out, posterior.log_evidence
