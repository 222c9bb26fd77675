"""filters: the run's filters against the training mean and a linear filter with the true law."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.signal import fftconvolve, lfilter

from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.filters import CLOSED, MEMORY, NONE, closed
from pipeline.figures import style
from pipeline.filtering.linear import autocorrelated_filter, linear_filter
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.filtering.particle_filter import particle_filter
from pipeline.laboratory.dynamics import (
    desired_joints,
    lagged_correlation,
    play_share,
    servo_times,
    sway_share,
)
from pipeline.laboratory.options import DynamicsOptions
from pipeline.models import kinds
from pipeline.models.closed_loop import fit_closed_loop, mean_path, measured_poses
from pipeline.models.steps import Recorded
from pipeline.recordings.steps import training_steps
from pipeline.statistics.scores import Filtered, posterior_scores, score_comparison, training_mean
from pipeline.studies.frame import (
    NoAnswerError,
    Study,
    Tables,
    concatenate,
    interval,
    number,
    trials,
)
from pipeline.studies.simulated import Laboratory, PhysicsFactors, disturb, observe
from pipeline.verdicts.wording import join_names, table

TRACK, ARTICULATE = Path("data/track"), Path("data/articulate")
AGAINST_NONE = "reports/{}/tables/filter_against_none.csv"
YARDSTICK = "yardstick"  # linear filter that uses the law of the arm's deviations
RMS, COVERAGE, LOG, ALL = "rms error", "coverage", "log score", "all"
LABELS = {NONE: "training mean", MEMORY: "linear, autocorrelation", YARDSTICK: "yardstick"}
LASTS = float(np.exp(-1))  # autocorrelation after a frame above which a deviation outlasts a frame
PLAY = -1  # index of the joint that has play
COLUMNS = ["filter", "score", "joint", "mean", "difference", "low", "high"]


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables."""
    if settings.dataset.laboratory is None:
        raise NoAnswerError("it has no synthetic laboratory whose law the yardstick uses")
    if not contracts.exists("angles", ARTICULATE):
        raise NoAnswerError("it has no depth camera")
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    noise, training = contracts.read("kinect_noise", ARTICULATE), measured_poses(recorded)
    laboratory = Laboratory.of_run(settings, recorded, noise)
    law = deviations(laboratory, laboratory.dynamics, training.mean(axis=0))
    takes = {take.take: take for take in measurements(contracts.read("angles", ARTICULATE), noise)}
    joints = contracts.read("joints", TRACK)
    order, poses = contracts.stacked(joints[joints["take"].isin(takes)], "q")
    frames, dt = [takes[name] for name in order], 1 / settings.dataset.motion.rate
    own = score_rows(linear_filters(recorded, training, poses, frames, dt, law), recorded.joints)
    run = long_scores(pd.read_csv(AGAINST_NONE.format(settings.dataset.name)), recorded.joints)
    common = {"laboratory": laboratory, "settings": settings, "options": options}
    rows = trials(settings, "filters: durations", duration_rows, options.factors, **common)
    yardstick = own[own["filter"] == YARDSTICK]
    return {"filters": concatenate([run, yardstick]), "filters_lasting": concatenate(rows)}


def deviations(
    laboratory: Laboratory, dynamics: DynamicsOptions, path: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance (M+1, n, M+1, n) of the arm's deviations from its mean ``path``
    (M+1, n) in rad, and the covariance (M+1, n, n) of the jitter of the exposure, in rad².

    Both are of first order in the disturbances that :mod:`pipeline.laboratory.dynamics` draws.
    With d_k = q(t_k) − E q(t_k)

        Cov(d_k, d_l) = p_k p_l J_k⁻¹ diag(σ²) J_l⁻ᵀ ρ(t_k − t_l)          sway
                      + e_n e_nᵀ c_k c_l · (2/π) asin(ρ'(t_k − t_l)/2)      play, in rad ± c_k
                      + response of the servo to its speed errors and to the start
                      + ripple²/2 · cos(goal_k − goal_l)                    by joint

    σ, p the sway and its share at the speed, ρ and ρ' correlations of lagged noise. The play is
    2Φ(g) − 1 of a normal g: uniform, of variance 1/3 and of the correlation (6/π) asin(ρ'/2).
    Raises SingularJacobianError.
    """
    trajectory = laboratory.motion
    t = servo_times(trajectory, dynamics)
    at = np.searchsorted(t, (np.arange(len(path)) - 0.25) / trajectory.rate)
    goal, speed = desired_joints(np.clip(t, 0.0, trajectory.duration), trajectory)
    apart = np.abs(at[:, None] - at)

    share = sway_share(laboratory.chain, speed[at], dynamics)[:, None, None]
    inverse = laboratory.chain.inverse_jacobian(path, what="step of the mean path")
    sway = share * inverse * dynamics.sway_std
    correlation = lagged_correlation(apart, dynamics.sway_time * dynamics.rate)
    covariance = np.einsum("kia,lja,kl->kilj", sway, sway, correlation)

    play = dynamics.clearance * play_share(speed[at], dynamics)
    normal = lagged_correlation(apart, dynamics.clearance_time * dynamics.rate)
    covariance[:, PLAY, :, PLAY] += play[:, None] * play * (2 / np.pi) * np.arcsin(normal / 2)

    for j in range(path.shape[-1]):
        servo = _servo_covariance(goal[:, j], speed[:, j], at, dynamics)
        phase = goal[at, None, j] - goal[at, j]
        covariance[:, j, :, j] += servo + dynamics.encoder_ripple**2 / 2 * np.cos(phase)

    speeds = np.gradient(path, 1 / trajectory.rate, axis=0)
    return covariance, dynamics.jitter_std**2 * speeds[:, :, None] * speeds[:, None, :]


def _servo_covariance(
    goal: np.ndarray, speed: np.ndarray, at: np.ndarray, dynamics: DynamicsOptions
) -> np.ndarray:
    """Return the covariance (K, K) in rad² of a joint's angle at the servo's steps ``at``: of first
    order, its deviation becomes e_{i+1} = (1 − gΔt)e_i + … + ε_i·Δt(speed_i + g(−ē_i)).
    """
    dt = 1 / dynamics.rate
    keep = 1 - dynamics.servo_gain * dt
    pushes = goal[:-1] + dt * speed[:-1] - goal[1:]
    off = np.append(0.0, lfilter([1.0], [1.0, -keep], pushes))
    passed = dynamics.speed_error_std * dt * (speed - dynamics.servo_gain * off)
    steps = np.arange(len(goal))
    since = at[:, None] - 1 - steps
    left = np.where(since >= 0, keep ** np.maximum(since, 0), 0.0) * passed
    correlation = lagged_correlation(steps, dynamics.speed_error_time * dynamics.rate)
    both = np.concatenate([correlation[:0:-1], correlation])[None]
    errors = fftconvolve(left, both, mode="full", axes=1)[:, len(goal) - 1 : 2 * len(goal) - 1]
    errors = errors @ left.T
    start = dynamics.start_std * keep**at
    return errors + start[:, None] * start


def linear_filters(
    recorded: Recorded,
    training: np.ndarray,
    test: np.ndarray,
    frames: Sequence[Measurements],
    dt: float,
    law: tuple[np.ndarray, np.ndarray],
) -> dict[str, Filtered]:
    """Return the training mean, the linear filter of the takes' autocorrelation and the yardstick.

    ``training`` (N, M+1, n) and ``test`` (T, M+1, n) are poses in rad at steps of ``dt`` s;
    ``frames`` belong to the test takes; ``law`` is the result of :func:`deviations`.
    """
    pose, arguments = recorded.measurement / 2, (frames, dt)
    mean, covariance, _ = autocorrelated_filter(training, pose, *arguments)
    best, least = linear_filter(training.mean(axis=0), law[0], *arguments)
    return {
        NONE: training_mean(training, test),
        MEMORY: Filtered(mean - test, covariance, pose),
        YARDSTICK: Filtered(best - test, least + law[1], pose),
    }


def duration_rows(
    factor: float, laboratory: Laboratory, settings: SimpleNamespace, options: SimpleNamespace
) -> pd.DataFrame:
    """Return rows of ``filters_lasting`` with lags of sway and play times ``factor``."""
    factors, motion = PhysicsFactors(lasting=factor), laboratory.motion
    dynamics = disturb(laboratory.dynamics, factors)
    takes, camera = observe(laboratory, factors, settings.seed, options.training, options.test)
    recorded = replace(takes.training, known_measurement=2 * laboratory.pose_noise)
    path, dt = mean_path(recorded), 1 / motion.rate
    law = deviations(laboratory, dynamics, path.poses)
    test, frames = np.stack(list(takes.test.values())), list(camera.takes.values())
    filters = linear_filters(recorded, takes.poses, test, frames, dt, law)
    model = config.model_options([options.model])[options.model]
    fit = fit_closed_loop(recorded, model, kinds.estimate(recorded, model))
    loop = (fit.estimate.model, laboratory.chain, path.commands(fit.share), dt, takes.start)
    streams = [rng.stream(settings.seed, "filters.lasting", i) for i in range(len(frames))]
    posteriors = [
        particle_filter(*loop, frame, settings.filter, stream)
        for frame, stream in zip(frames, streams, strict=True)
    ]
    error = np.stack([each.mean for each in posteriors]) - test
    covariance = np.stack([each.covariance for each in posteriors])
    filters[closed(options.model)] = Filtered(error, covariance, laboratory.pose_noise)
    lag = round(motion.rate / laboratory.clock.rate)
    left = np.einsum("kiki->i", law[0][:-lag, :, lag:]) / np.einsum("kiki->i", law[0])
    rows = score_rows(filters, laboratory.joints)
    return rows.assign(factor=factor, sway_time=dynamics.sway_time, left=np.mean(left))


def score_rows(filters: Mapping[str, Filtered], joints: Sequence[str]) -> pd.DataFrame:
    """Return the scores of ``filters`` and their differences to the training mean."""
    scores = {
        name: posterior_scores(each.error, each.covariance + each.measurement, joints)[0]
        for name, each in filters.items()
    }
    return long_scores(score_comparison(scores, NONE), joints)


def long_scores(table: pd.DataFrame, joints: Sequence[str]) -> pd.DataFrame:
    """Return rms error, coverage and log score by joint from a ``table`` of compared scores."""
    names = {f"rms_error_{joint}_rad": (RMS, joint) for joint in joints}
    names |= {f"coverage_of_one_sigma_{joint}": (COVERAGE, joint) for joint in joints}
    names |= {"log_score": (LOG, ALL)}
    rows = table[table["score"].isin(names)].rename(columns={"model": "filter"})
    score, joint = zip(*rows["score"].map(names), strict=True)
    rows = rows.assign(score=score, joint=joint)[COLUMNS]
    return rows.astype(dict.fromkeys(COLUMNS[3:], float))


def label(name: str) -> str:
    """Return the name of a filter on the page."""
    loop = "closed" if name.endswith(CLOSED) else "open"
    return LABELS.get(name, f"{name.removesuffix(CLOSED)}, {loop} loop")


def better_or_worse(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rms errors and log scores with the flags ``better`` and ``worse`` (95 % interval)."""
    proper = rows[rows["score"].isin((RMS, LOG)) & (rows["filter"] != NONE)]
    falls, rises, log = proper["high"] < 0, proper["low"] > 0, proper["score"] == LOG
    return proper.assign(better=rises.where(log, falls), worse=falls.where(log, rises))


def error_ratio(rows: pd.DataFrame) -> pd.Series:
    """Return the ratio of each row's score to the training mean's score."""
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
        "particle": join_names(found[False] or ["none"]),
        "linear": join_names(found[True] or ["none"]),
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
