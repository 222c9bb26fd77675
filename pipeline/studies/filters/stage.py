"""filters: every filter of the run between the training mean and the best linear filter, which
knows the laboratory's law; and both over the duration of the arm's deviations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from pipeline.arm.interface import Chain
from pipeline.core import config, contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.filters import CLOSED, MEMORY, NONE, closed
from pipeline.core.options.analysis import Positive
from pipeline.core.validation import options
from pipeline.filtering.baselines import autocorrelated_filter
from pipeline.filtering.linear import linear_filter
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models import kinds
from pipeline.models.closed_loop import mean_path, measured_poses
from pipeline.models.closed_loop_fit import fit_closed_loop
from pipeline.models.options import Options as Model
from pipeline.recordings.steps import training_steps
from pipeline.statistics.filters import Filtered, no_filter
from pipeline.statistics.scores import compared, posterior_scores
from pipeline.studies.filters.deviations import Deviations, deviations
from pipeline.studies.frame import NoAnswerError, Results, Study, interval, listed, number
from pipeline.studies.simulated import Factors, Laboratory, disturbed, observe
from pipeline.verdicts.wording import table

TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
AGAINST_NONE = "reports/{}/tables/filter_against_none.csv"
YARDSTICK = "yardstick"  # best linear filter, which knows the law of the arm's deviations
RMS, COVERAGE, LOG, ALL = "rms error", "coverage", "log score", "all"
LABELS = {NONE: "training mean", MEMORY: "linear, autocorrelation", YARDSTICK: "yardstick"}
LASTS = float(np.exp(-1))  # correlation after a frame, from which a deviation outlasts it


@options()
class Options:
    """Size of the study; params.yaml describes each."""

    training: Annotated[int, Field(ge=4)]
    test: Annotated[int, Field(ge=4)]
    model: str
    factors: Annotated[list[Positive], Field(min_length=1)]


@dataclass(frozen=True)
class Filmed:
    """Test takes of motion capture and depth camera, and the training takes before them."""

    training: np.ndarray  # (N, M+1, n) rad
    test: np.ndarray  # (T, M+1, n) rad
    frames: Sequence[Measurements]  # of the test takes, in their order
    pose: np.ndarray  # (n, n) rad², noise of a measured pose
    dt: float  # s, step of the motion
    chain: Chain

    def linear_filters(self, law: Deviations) -> dict[str, Filtered]:
        """Return the training mean, the linear filter of the takes' autocorrelation and the
        yardstick of ``law``.
        """
        path, arguments = self.training.mean(axis=0), (self.frames, self.dt, self.chain)
        own, spread, _ = autocorrelated_filter(self.training, self.pose, *arguments)
        best, least = linear_filter(path, law.covariance, *arguments)
        return {
            NONE: no_filter(self.training, self.test),
            MEMORY: Filtered(own - self.test, spread, self.pose),
            YARDSTICK: Filtered(best - self.test, least + law.exposure, self.pose),
        }


def evaluate(settings: SimpleNamespace, options: Options) -> dict[str, pd.DataFrame]:
    """Return the study's tables."""
    if settings.dataset.laboratory is None:
        raise NoAnswerError("it has no synthetic laboratory whose law a yardstick could know")
    if not contracts.exists("angles", ARTICULATE):
        raise NoAnswerError("it has no depth camera")
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    noise = contracts.read("kinect_noise", ARTICULATE)
    laboratory = Laboratory.of_run(settings, recorded, noise)
    training = measured_poses(recorded)
    law = deviations(
        laboratory.chain, laboratory.motion, laboratory.dynamics, training.mean(axis=0)
    )
    takes = measurements(contracts.read("angles", ARTICULATE), noise)
    joints, names = contracts.read("joints", TRACK), [take.take for take in takes]
    order, poses = contracts.stacked(joints[joints["take"].isin(names)], "q")
    frames = [takes[names.index(name)] for name in order]
    dt = 1 / settings.dataset.motion.rate
    filmed = Filmed(training, poses, frames, recorded.measurement / 2, dt, recorded.chain)
    own = score_rows(filmed.linear_filters(law), recorded.joints)
    run = long_scores(pd.read_csv(AGAINST_NONE.format(settings.dataset.name)), recorded.joints)
    f = settings.filter
    trial = partial(
        duration_rows,
        laboratory=laboratory,
        model=(options.model, config.model_options([options.model])[options.model]),
        filter_options=FilterOptions(f.particles, f.scheme, f.threshold),
        sizes=(options.training, options.test),
        seed=settings.seed,
    )
    parts = run_trials(trial, options.factors, compute=settings.compute, label="filters: durations")
    return {
        "filters": pd.concat([run, own[own["filter"] == YARDSTICK]], ignore_index=True),
        "filters_lasting": pd.concat(list(parts), ignore_index=True),
    }


def duration_rows(
    factor: float,
    laboratory: Laboratory,
    model: tuple[str, Model],
    filter_options: FilterOptions,
    sizes: tuple[int, int],
    seed: int,
) -> pd.DataFrame:
    """Rows of the table ``filters_lasting``: every lag of sway and play ``factor`` times as long,
    ``sizes`` simulated takes for training and test, equal random numbers at every factor.
    """
    factors, motion = Factors(lasting=factor), laboratory.motion
    dynamics = disturbed(laboratory.dynamics, factors)
    takes, camera = observe(laboratory, factors, seed, *sizes)
    recorded = replace(takes.training, known_measurement=2 * laboratory.pose_noise)
    path, first = mean_path(recorded), takes.poses[:, 0]
    law = deviations(laboratory.chain, motion, dynamics, path.poses)
    test, frames = np.stack(list(takes.test.values())), list(camera.takes.values())
    pose, dt = laboratory.pose_noise, 1 / motion.rate
    filmed = Filmed(takes.poses, test, frames, pose, dt, laboratory.chain)
    name, chosen = model
    fit = fit_closed_loop(recorded, chosen, kinds.estimate(recorded, chosen))
    loop = (fit.estimate.model, laboratory.chain, path.commands(fit.share), dt)
    start = Start(first.mean(axis=0), np.cov(first.T))
    posteriors = [
        particle_filter(
            *loop, start, measured, filter_options, rng.stream(seed, "filters.lasting", number)
        )
        for number, measured in enumerate(frames)
    ]
    means, covariances = (
        np.stack([getattr(each, key) for each in posteriors]) for key in ("mean", "covariance")
    )
    linear = filmed.linear_filters(law)
    filters = linear | {closed(name): Filtered(means - test, covariances, pose)}
    lag = round(motion.rate / laboratory.clock.rate)
    left = np.einsum("kiki->i", law.covariance[:-lag, :, lag:])
    left = float(np.mean(left / np.einsum("kiki->i", law.covariance)))
    rows = score_rows(filters, laboratory.joints)
    return rows.assign(factor=factor, sway_time=dynamics.sway_time, left=left)


def score_rows(filters: Mapping[str, Filtered], joints: Sequence[str]) -> pd.DataFrame:
    """Return the scores of ``filters`` and their differences to the training mean, which is one of
    them.
    """
    scores = {
        name: posterior_scores(each.error, each.covariance + each.measurement, joints)[0]
        for name, each in filters.items()
    }
    return long_scores(compared(scores, NONE), joints)


def long_scores(table: pd.DataFrame, joints: Sequence[str]) -> pd.DataFrame:
    """Return rms error, coverage and log score of a table of
    :func:`pipeline.statistics.scores.compared`, with the columns of tables.yaml.
    """
    names = {f"rms_error_{joint}_rad": (RMS, joint) for joint in joints}
    names |= {f"coverage_of_one_sigma_{joint}": (COVERAGE, joint) for joint in joints}
    names |= {"log_score": (LOG, ALL)}
    rows = table[table["score"].isin(names)].rename(columns={"model": "filter"})
    both = [names[score] for score in rows["score"]]
    rows = rows.assign(score=[score for score, _ in both], joint=[joint for _, joint in both])
    return rows[["filter", "score", "joint", "mean", "difference", "low", "high"]].astype(
        dict.fromkeys(["mean", "difference", "low", "high"], float)
    )


def label(name: str) -> str:
    """Return the name of a filter in words."""
    if name in LABELS:
        return LABELS[name]
    loop = "closed" if name.endswith(CLOSED) else "open"
    return f"{name.removesuffix(CLOSED)}, {loop} loop"


def better_or_worse(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rms errors and log scores of ``rows`` with the flags ``better`` and ``worse`` than
    the training mean, beyond the 95 % interval.
    """
    proper = rows[rows["score"].isin((RMS, LOG)) & (rows["filter"] != NONE)]
    falls, rises, log = proper["high"] < 0, proper["low"] > 0, proper["score"] == LOG
    return proper.assign(better=rises.where(log, falls), worse=falls.where(log, rises))


def error_ratio(rows: pd.DataFrame) -> pd.Series:
    """Return the mean of each of ``rows`` over that of the training mean."""
    return rows["mean"] / (rows["mean"] - rows["difference"].fillna(0.0))


def page(results: Results) -> list[str]:
    """Return the page's parts."""
    rows, lasting = results.tables["filters"], results.tables["filters_lasting"]
    by_filter = better_or_worse(rows).groupby("filter", sort=False)[["better", "worse"]]
    flags = by_filter.any()
    gains = [name for name, row in flags.iterrows() if row["better"] and not row["worse"]]
    particle = [label(name) for name in gains if name not in LABELS]
    cells = rows.assign(ratio=error_ratio(rows)).set_index(["filter", "score", "joint"])
    joints = [joint for joint in dict.fromkeys(rows["joint"]) if joint != ALL]
    lines = []
    for name in dict.fromkeys(rows["filter"]):
        ratios = [cells.loc[(name, RMS, joint), "ratio"] for joint in joints]
        covered = [cells.loc[(name, COVERAGE, joint), "mean"] for joint in joints]
        log = cells.loc[(name, LOG, ALL)]
        gain = interval(log["difference"], log["low"], log["high"])
        texts = [f"{value:.2f}" for value in (*ratios, *covered)]
        lines.append([label(name), *texts, number(log["mean"]), gain])
    head = [f"rms error of {joint} over the mean's" for joint in joints]
    head += [f"coverage of {joint}" for joint in joints]
    long = lasting[lasting["left"] >= LASTS]
    sweep = better_or_worse(long).groupby(["filter", "score"], sort=False)["better"]
    sentences = [
        f"{label(name)}: {int(better.sum())} of {len(better)} {score}s"
        for (name, score), better in sweep
    ]
    return [
        "Has any particle filter a lower rms error or a higher log score than the mean and "
        "covariance of the training takes, which need no depth camera? How far are the filters "
        "from the yardstick, the best linear filter, which knows the laboratory's law?",
        "**Particle filters** with a lower rms error or a higher log score than the training mean "
        f"in one score at least and the opposite in none, beyond 95 % intervals: "
        f"{listed(particle) or 'none'}. Of the "
        f"linear filters: {listed([label(name) for name in gains if name in LABELS]) or 'none'}.",
        table(["filter", *head, "log score (nat)", "minus the mean's"], lines),
        "Differences are paired over the test takes; brackets hold 95 % intervals. An open loop "
        "adds up the noise of all steps, a closed loop corrects a share of the deviation from the "
        "mean path. The linear filter knows the covariance of the training takes at each step and "
        "one autocorrelation over time. The yardstick knows the covariance of the arm's deviations "
        "over time, to first order in the disturbances; it does not know that the play is bounded, "
        "nor that the camera's error depends on the pose.",
        results.figures["filters"],
        "**Duration of a deviation.** On simulated takes, every lag of sway and play times a "
        f"factor of {min(results.options.factors):g} to {max(results.options.factors):g}; equal "
        "random numbers, white noise of both instruments. Where the autocorrelation after a frame "
        f"of the camera is at least {LASTS:.2f}, the filter has the lower rms error or the higher "
        "log score, beyond the interval, in "
        f"{'; '.join(sentences) or 'no case'}.",
        "**What would change it.** A camera with a higher rate or less noise; a law of the motion "
        "noise that is correlated over time, as the linear filter's, instead of independent steps. "
        "Which duration real deviations have is not published.",
    ]


run = Study("Filters between the training mean and a yardstick", Options, evaluate, page).run
