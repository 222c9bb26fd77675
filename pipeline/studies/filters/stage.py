"""filters: every filter of the run between the training mean and the best linear filter, which
knows the laboratory's law; and both over the duration of the arm's deviations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.core import config, contracts, rng
from pipeline.core.filters import CLOSED, MEMORY, NONE, closed
from pipeline.figures import style
from pipeline.filtering.linear import autocorrelated_filter, linear_filter
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.filtering.particle_filter import FilterOptions, particle_filter
from pipeline.models import kinds
from pipeline.models.closed_loop import fit_closed_loop, mean_path, measured_poses
from pipeline.models.options import Options as Model
from pipeline.models.steps import Recorded
from pipeline.recordings.steps import training_steps
from pipeline.statistics.scores import Filtered, posterior_scores, score_comparison, training_mean
from pipeline.studies.filters.deviations import Deviations, deviations
from pipeline.studies.frame import NoAnswerError, Study, Tables, interval, joined, number, trials
from pipeline.studies.simulated import Laboratory, PhysicsFactors, disturbed, observe
from pipeline.verdicts.wording import listed, table

TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
AGAINST_NONE = "reports/{}/tables/filter_against_none.csv"
YARDSTICK = "yardstick"  # best linear filter, which knows the law of the arm's deviations
RMS, COVERAGE, LOG, ALL = "rms error", "coverage", "log score", "all"
LABELS = {NONE: "training mean", MEMORY: "linear, autocorrelation", YARDSTICK: "yardstick"}
LASTS = float(np.exp(-1))  # correlation after a frame, from which a deviation outlasts it
COLUMNS = ["filter", "score", "joint", "mean", "difference", "low", "high"]


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables."""
    if settings.dataset.laboratory is None:
        raise NoAnswerError("it has no synthetic laboratory whose law a yardstick could know")
    if not contracts.exists("angles", ARTICULATE):
        raise NoAnswerError("it has no depth camera")
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    noise, f = contracts.read("kinect_noise", ARTICULATE), settings.filter
    laboratory, training = Laboratory.of_run(settings, recorded, noise), measured_poses(recorded)
    parts = (laboratory.chain, laboratory.motion, laboratory.dynamics)
    law = deviations(*parts, training.mean(axis=0))
    takes = {take.take: take for take in measurements(contracts.read("angles", ARTICULATE), noise)}
    joints = contracts.read("joints", TRACK)
    order, poses = contracts.stacked(joints[joints["take"].isin(takes)], "q")
    frames, dt = [takes[name] for name in order], 1 / settings.dataset.motion.rate
    own = score_rows(linear_filters(recorded, training, poses, frames, dt, law), recorded.joints)
    run = long_scores(pd.read_csv(AGAINST_NONE.format(settings.dataset.name)), recorded.joints)
    common = {
        "laboratory": laboratory,
        "model": (options.model, config.model_options([options.model])[options.model]),
        "filter_options": FilterOptions(f.particles, f.scheme, f.threshold),
        "sizes": (options.training, options.test),
        "seed": settings.seed,
    }
    rows = trials(settings, "filters: durations", duration_rows, options.factors, **common)
    yardstick = own[own["filter"] == YARDSTICK]
    return {"filters": joined([run, yardstick]), "filters_lasting": joined(rows)}


def linear_filters(
    recorded: Recorded,
    training: np.ndarray,
    test: np.ndarray,
    frames: Sequence[Measurements],
    dt: float,
    law: Deviations,
) -> dict[str, Filtered]:
    """Return the training mean, the linear filter of the takes' autocorrelation and the yardstick
    of ``law``, from ``training`` (N, M+1, n) and ``test`` poses (T, M+1, n) in rad at steps of
    ``dt`` s and the ``frames`` of the test takes, in their order.
    """
    pose, arguments = recorded.measurement / 2, (frames, dt, recorded.chain)
    own, spread, _ = autocorrelated_filter(training, pose, *arguments)
    best, least = linear_filter(training.mean(axis=0), law.covariance, *arguments)
    return {
        NONE: training_mean(training, test),
        MEMORY: Filtered(own - test, spread, pose),
        YARDSTICK: Filtered(best - test, least + law.exposure, pose),
    }


def duration_rows(
    factor: float,
    laboratory: Laboratory,
    model: tuple[str, Model],
    filter_options: FilterOptions,
    sizes: tuple[int, int],
    seed: int,
) -> pd.DataFrame:
    """Return rows of ``filters_lasting``: lags of sway and play ``factor`` times as long."""
    factors, motion = PhysicsFactors(lasting=factor), laboratory.motion
    dynamics = disturbed(laboratory.dynamics, factors)
    takes, camera = observe(laboratory, factors, seed, *sizes)
    recorded = replace(takes.training, known_measurement=2 * laboratory.pose_noise)
    path, dt = mean_path(recorded), 1 / motion.rate
    law = deviations(laboratory.chain, motion, dynamics, path.poses)
    test, frames = np.stack(list(takes.test.values())), list(camera.takes.values())
    filters = linear_filters(recorded, takes.poses, test, frames, dt, law)
    name, chosen = model
    fit = fit_closed_loop(recorded, chosen, kinds.estimate(recorded, chosen))
    loop = (fit.estimate.model, laboratory.chain, path.commands(fit.share), dt, takes.start)
    posteriors = [
        particle_filter(*loop, frame, filter_options, rng.stream(seed, "filters.lasting", number))
        for number, frame in enumerate(frames)
    ]
    error = np.stack([each.mean for each in posteriors]) - test
    covariance = np.stack([each.covariance for each in posteriors])
    filters[closed(name)] = Filtered(error, covariance, laboratory.pose_noise)
    lag = round(motion.rate / laboratory.clock.rate)
    left = np.einsum("kiki->i", law.covariance[:-lag, :, lag:])
    left = float(np.mean(left / np.einsum("kiki->i", law.covariance)))
    rows = score_rows(filters, laboratory.joints)
    return rows.assign(factor=factor, sway_time=dynamics.sway_time, left=left)


def score_rows(filters: Mapping[str, Filtered], joints: Sequence[str]) -> pd.DataFrame:
    """Return the scores of ``filters``, the training mean among them, and the differences to it."""
    scores = {
        name: posterior_scores(each.error, each.covariance + each.measurement, joints)[0]
        for name, each in filters.items()
    }
    return long_scores(score_comparison(scores, NONE), joints)


def long_scores(table: pd.DataFrame, joints: Sequence[str]) -> pd.DataFrame:
    """Return rms error, coverage and log score of a ``table`` of compared scores by joint."""
    names = {f"rms_error_{joint}_rad": (RMS, joint) for joint in joints}
    names |= {f"coverage_of_one_sigma_{joint}": (COVERAGE, joint) for joint in joints}
    names |= {"log_score": (LOG, ALL)}
    rows = table[table["score"].isin(names)].rename(columns={"model": "filter"})
    score, joint = zip(*rows["score"].map(names), strict=True)
    rows = rows.assign(score=score, joint=joint)[COLUMNS]
    return rows.astype(dict.fromkeys(COLUMNS[3:], float))


def label(name: str) -> str:
    """Return the name of a filter in words."""
    loop = "closed" if name.endswith(CLOSED) else "open"
    return LABELS.get(name, f"{name.removesuffix(CLOSED)}, {loop} loop")


def better_or_worse(rows: pd.DataFrame) -> pd.DataFrame:
    """Flag rms errors and log scores beyond the 95 % interval about the training mean."""
    proper = rows[rows["score"].isin((RMS, LOG)) & (rows["filter"] != NONE)]
    falls, rises, log = proper["high"] < 0, proper["low"] > 0, proper["score"] == LOG
    return proper.assign(better=rises.where(log, falls), worse=falls.where(log, rises))


def error_ratio(rows: pd.DataFrame) -> pd.Series:
    """Return the mean of each of ``rows`` over the training mean's."""
    return rows["mean"] / (rows["mean"] - rows["difference"].fillna(0.0))


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    rows, lasting = tables["filters"], tables["filters_lasting"]
    flags = better_or_worse(rows).groupby("filter", sort=False)[["better", "worse"]].any()
    gains = flags.index[flags["better"] & ~flags["worse"]]
    joints = [joint for joint in dict.fromkeys(rows["joint"]) if joint != ALL]
    lines, found = [], {True: [], False: []}
    for name, own in rows.assign(ratio=error_ratio(rows)).groupby("filter", sort=False):
        own = own.set_index(["score", "joint"])
        cells = [*own["ratio"][RMS][joints], *own["mean"][COVERAGE][joints]]
        log = own.loc[(LOG, ALL)]
        gain = interval(log["difference"], log["low"], log["high"])
        lines.append([label(name), *map("{:.2f}".format, cells), number(log["mean"]), gain])
        if name in gains:
            found[name in LABELS].append(f"{label(name)} (log score {gain} nat)")
    head = [f"rms error of {joint} over the mean's" for joint in joints]
    head += [f"coverage of {joint}" for joint in joints]
    sweep = better_or_worse(lasting[lasting["left"] >= LASTS])
    sentences = [
        f"{label(name)}: {better.sum()} of {len(better)} {score}s"
        for (name, score), better in sweep.groupby(["filter", "score"], sort=False)["better"]
    ]
    return {
        "particle": listed(found[False] or ["none"]),
        "linear": listed(found[True] or ["none"]),
        "table": table(["filter", *head, "log score (nat)", "minus the mean's"], lines),
        "least": min(options.factors),
        "greatest": max(options.factors),
        "lasts": LASTS,
        "sweep": "; ".join(sentences) or "no case",
    }


def draw(filters: pd.DataFrame, filters_lasting: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    widths = {"columns": 4, "width_ratios": [1.2, 1, 1, 1]}
    figure, ((run, *others),) = style.panels(style.TWO_COLUMNS, 3.0, **widths)
    errors, grey = filters[(filters["score"] == RMS) & (filters["filter"] != NONE)], style.GREY
    ratios = error_ratio(errors).groupby(errors["filter"], sort=False)
    joint = {"color": style.PURPLE, "ms": 3, "label": "a joint, in (a)"}
    for y, (_, values) in enumerate(ratios):
        run.hlines(y, values.min(), values.max(), color=style.PURPLE, lw=1.2)
        run.plot(values, [y] * len(values), "o", **joint)
    run.set_yticks(range(len(ratios)), map(label, dict.fromkeys(errors["filter"])))
    run.set(xlabel="rms error over the\ntraining mean's (1)", xlim=(0, None))
    run.invert_yaxis()
    run.axvline(1.0, color=grey, linewidth=1.6, zorder=0, label="training mean, or 0.68")
    rows = filters_lasting[filters_lasting["filter"] != NONE]
    rows = rows.assign(ratio=error_ratio(rows), lag=1e3 * rows["sway_time"])
    looks = {
        MEMORY: {"color": style.GREEN, "linestyle": "-."},
        YARDSTICK: {"color": style.BLACK, "linestyle": "-"},
    }
    panels = (
        (RMS, "ratio", 1.0, "rms error over the training mean's (1)", (0, None)),
        (COVERAGE, "mean", 0.683, "coverage of ±1σ (1)", (0, 1)),
        (LOG, "difference", 0.0, "log score minus the training mean's (nat)", None),
    )
    for axes, (score, column, level, name, limits) in zip(others, panels, strict=True):
        for kind, own in rows[rows["score"] == score].groupby("filter", sort=False):
            look = looks.get(kind, {"color": style.BLUE, "linestyle": ":"})
            mean = own.groupby("lag")[column].mean()
            axes.plot(mean, label=label(kind), marker="o", markersize=2.5, **look)
        axes.axhline(level, color=grey, linewidth=1.6, zorder=0)
        axes.set(xscale="log", xlabel="lag of the sway (ms)", ylabel=name, ylim=limits)
        axes.xaxis.set_major_formatter("{x:g}")
    style.letters((run, *others))
    style.legend(figure, ncols=5)
    return figure


run = Study(evaluate, facts, draw).run
