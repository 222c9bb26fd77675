"""filter@model: sequential importance sampling of every test take under one motion model (Sec. "RMT-based particle filtering")."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng
from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import load_arm
from pipeline.compute.trials import run_trials
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.motion.build import fitted_model
from pipeline.motion.model import MotionModel

INGEST, TRACK, NOISE = Path("data/ingest"), Path("data/track"), Path("data/noise")
ARTICULATE, FIT, OUT = Path("data/articulate"), Path("data/fit"), Path("data/filter")
METRICS = Path("reports/metrics")


def run(model: str) -> None:
    """Posterior mean, covariance and effective sample size of every test take."""
    settings = config.sections("filter", item=model)
    robot, rate = settings.dataset.robot, settings.dataset.motion.rate
    with contracts.replacing(OUT / model) as folder:
        if not contracts.exists("angles", ARTICULATE):
            print("filter: no joint angles from a depth camera; nothing to filter")
            contracts.write_metrics({}, METRICS / f"filter_{model}.json")
            return
        options = FilterOptions(settings.filter.particles, settings.filter.scheme, settings.filter.threshold)
        chain = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain
        joints = contracts.read("joints", TRACK)
        starts = joints[(joints.part == "training") & (joints.k == 0)][["q1", "q2", "q3"]]
        start = Start(starts.mean().to_numpy(), starts.cov().to_numpy())
        steps = contracts.read("trajectory", INGEST)[["vx", "vz", "vphi"]].to_numpy()[:-1] / rate
        takes = measurements(contracts.read("angles", ARTICULATE), contracts.read("kinect_noise", NOISE))
        trial = partial(
            _filter_take, model=fitted_model(FIT / model), chain=chain, steps=steps, rate=rate, start=start, options=options,
            stream=(settings.seed, f"filter.{model}"),
        )  # fmt: skip
        rows = list(run_trials(trial, list(enumerate(takes)), compute=settings.compute, label=f"filter {model}: takes"))
        contracts.write(pd.concat([table for table, _, _ in rows], ignore_index=True), "posterior", folder)
    posterior = contracts.read("posterior", OUT / model)
    metrics = {
        "mean_effective_sample_size": posterior["ess"].mean(),
        "share_of_steps_resampled": posterior["resampled"].mean(),
        "particle_steps_with_clipped_noise": posterior["clipped"].sum(),
        "particle_steps_outside_the_domain": posterior["outside"].sum(),
        "measurements_outside_the_motion": sum(left_out for _, left_out, _ in rows),
        "mean_log_evidence_per_take": np.mean([evidence for _, _, evidence in rows]),
    }
    contracts.write_metrics(metrics, METRICS / f"filter_{model}.json")


def _filter_take(
    trial: tuple[int, Measurements], model: MotionModel, chain: PlanarChain, steps: np.ndarray, rate: float,
    start: Start, options: FilterOptions, stream: tuple[int, str],
) -> tuple[pd.DataFrame, int, float]:  # fmt: skip
    number, seen = trial
    posterior = particle_filter(model, chain, steps, 1 / rate, start, seen, options, rng.stream(*stream, number))
    k = np.arange(len(posterior.mean))
    table = {"take": seen.take, "part": "test", "k": k, "t": k / rate} | {f"m{j + 1}": posterior.mean[:, j] for j in range(3)}
    table |= {f"c{i + 1}{j + 1}": posterior.covariance[:, i, j] for i in range(3) for j in range(i, 3)}
    table |= {name: getattr(posterior, name) for name in ("ess", "resampled", "measured", "clipped", "outside")}
    return pd.DataFrame(table), posterior.left_out, posterior.log_evidence
