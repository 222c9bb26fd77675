"""planning: noise on the motion that a model plans as least uncertain, against other motions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import kendalltau

from pipeline.arm.chain import Chain
from pipeline.arm.interface import trajectory_table
from pipeline.arm.model import chain_of
from pipeline.configuration import config
from pipeline.core import rng
from pipeline.core.errors import (
    ConfigError,
    ModelDomainError,
    SingularJacobianError,
    SolverError,
)
from pipeline.core.options.dataset import Robot
from pipeline.figures import style
from pipeline.laboratory.causes import dynamics_type
from pipeline.laboratory.dynamics import JointPath, desired_path, open_session, perform
from pipeline.laboratory.options import DynamicsOptions, TrajectoryOptions
from pipeline.models import kinds
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded, process_noise
from pipeline.planning.motions import best_conditioned, least_uncertain, minimum_norm
from pipeline.planning.problem import InfeasibleError, Problem, uncertainty
from pipeline.recordings.commands import commanded_steps
from pipeline.statistics.takes import drawn_takes, percentile_interval
from pipeline.studies.frame import (
    Tables,
    concatenate,
    dataset_option,
    interval,
    number,
    trials,
)
from pipeline.studies.simulated import disturb
from pipeline.verdicts.wording import MISSING, join_names

FIXED = RECORDED, MINIMUM, BEST = "recorded", "minimum_norm", "best_conditioned"
SURE = 0.975  # least share of the resamplings of a reliable result
DIGITS = 9  # significant digits of a prediction that are compared
KEYS = ["arm", "physics"]
Motions = Mapping[
    str, np.ndarray
]  # by name: (M+1, n) rad, or (choices,) sums of their noise


@dataclass(frozen=True, eq=False)
class Bench:
    """An arm with motion and task; ``takes`` is the number of takes in the physics ``dynamics``."""

    joints: tuple[str, ...]  # names, base to tip
    built: Chain  # nominal chain, with the task rows that sway
    chain: Chain  # nominal chain, with the task rows that are planned
    trajectory: TrajectoryOptions  # of the dataset, at the pace of the study
    dynamics: DynamicsOptions
    takes: int
    seed: int

    @classmethod
    def of_dataset(
        cls, arm: str, task: Sequence[str], options: SimpleNamespace, seed: int
    ) -> "Bench":
        """Return the arm of the dataset ``arm``; without ``task`` all rows are planned."""
        robot = dataset_option(Robot, arm, "robot")
        motion = dataset_option(TrajectoryOptions, arm, "laboratory", "trajectory")
        cause = dataset_option(str, arm, "laboratory", "cause")
        dynamics = dataset_option(dynamics_type(cause), arm, "laboratory", "dynamics")
        times = {
            n: getattr(motion, n) / options.pace for n in ("duration", "rest", "ramp")
        }
        built, motion = chain_of(robot), replace(motion, **times)
        chain = chain_of(replace(robot, task=list(task))) if task else built
        return cls(
            tuple(robot.joints), built, chain, motion, dynamics, options.takes, seed
        )

    @cached_property
    def recorded(self) -> np.ndarray:
        """Motion of the dataset (M+1, n) in rad."""
        return desired_path(self.built, self.trajectory)

    def command(self, path: np.ndarray) -> np.ndarray:
        """Return the commands (M, m + n) of a ``path`` (M+1, n) in rad, or (M, m) if m = n."""
        table = trajectory_table(self.chain, path, self.trajectory.rate, self.joints)
        return commanded_steps(table, self.trajectory.rate)

    def poses(self, path: np.ndarray, name: str) -> np.ndarray:
        """Return poses (takes, M+1, n) in rad of the takes ``name`` that perform ``path`` (M+1, n),
        without measurement noise and with equal random numbers for every path.

        Raises ConfigError if the arm cannot follow, SingularJacobianError at a singular pose.
        """
        motion, dynamics = JointPath(path, self.trajectory.rate), self.dynamics
        motion.require_followable(self.built)
        session = open_session(
            self.built, dynamics, rng.stream(self.seed, "planning.session")
        )
        streams = (
            rng.stream(self.seed, f"planning.{name}", n) for n in range(self.takes)
        )
        takes = [perform(session, motion, dynamics, stream) for stream in streams]
        return np.stack([take.motion_capture for take in takes])

    def steps(self, path: np.ndarray, name: str) -> Recorded:
        """Return the steps of the takes ``name`` of the ``path``."""
        q, command = self.poses(path, name), self.command(path)
        noise = process_noise(self.chain, q, command)
        return Recorded(self.chain, q[:, :-1], command, noise, self.joints)


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables."""
    arms, of_dataset = options.arms.items(), Bench.of_dataset
    benches = {arm: of_dataset(arm, task, options, settings.seed) for arm, task in arms}
    fixed = trials(
        settings, "planning: arms", fixed_motions, benches.values(), options=options
    )
    cases = [(arm, name) for name in options.physics for arm in benches]
    common = {"benches": benches, "fixed": dict(zip(benches, fixed, strict=True))}
    common |= {"options": options, "models": config.model_options(options.models)}
    parts = trials(settings, "planning: physics", tables_of, cases, **common)
    return {name: concatenate(part[name] for part in parts) for name in parts[0]}


def problem_of(bench: Bench, options: SimpleNamespace, smoothness: float) -> Problem:
    """Return the planning problem: task path of the recorded motion and the study's margin."""
    chain, recorded = bench.chain, bench.recorded
    margin = options.margin * float(chain.least_singular_value(recorded).min())
    return Problem(
        chain, chain.pose(recorded), bench.trajectory.rate, margin, smoothness
    )


def fixed_motions(bench: Bench, options: SimpleNamespace) -> Motions:
    """Return the motions without a model; raises InfeasibleError."""
    problem = problem_of(bench, options, 0.0)
    return {
        RECORDED: bench.recorded,
        MINIMUM: minimum_norm(problem, bench.recorded[0]).joints,
        BEST: best_conditioned(replace(problem, smoothness=options.conditioned)).joints,
    }


def plan_motion(
    bench: Bench, model: MotionModel, options: SimpleNamespace
) -> np.ndarray:
    """Return the motion (M+1, n) in rad of least Σ tr Cov under ``model``; raises InfeasibleError,
    and ModelDomainError for a model without a covariance or with the same covariance at every step.
    """
    cost, path = uncertainty(model, bench.chain, "trace"), bench.recorded
    problem = problem_of(bench, options, 0.0)
    costs = cost(path[:-1], problem.steps)
    if np.ptp(costs) == 0:
        raise ModelDomainError(
            "the covariance is the same at every step, so all motions are equal"
        )
    weight = options.smoothness * costs.sum() / np.sum(np.diff(path, axis=0) ** 2)
    return least_uncertain(replace(problem, smoothness=float(weight)), cost).joints


def tables_of(
    case: tuple[str, str],
    benches: Mapping[str, Bench],
    fixed: Mapping[str, Motions],
    options: SimpleNamespace,
    models: Mapping[str, object],
) -> Tables:
    """Return the tables of a ``case`` (arm, physics); ``fixed`` are the motions without a model."""
    (arm, physics), laws = case, {}
    dynamics = disturb(benches[arm].dynamics, options.physics[physics])
    bench, motions = replace(benches[arm], dynamics=dynamics), dict(fixed[arm])
    recorded = bench.steps(bench.recorded, "training")
    for name, chosen in models.items():
        try:
            laws[name] = kinds.estimate(recorded, chosen).model
            motions[name] = plan_motion(bench, laws[name], options)
        except (InfeasibleError, ModelDomainError, SolverError) as error:
            print(f"planning: {arm}, {physics}: {name} has no plan: {error.message}")
    resampled = drawn_takes(bench.takes, rng.stream(bench.seed, "planning.resampling"))
    sums = realised_sums(bench, motions, [np.arange(bench.takes), *resampled])
    rows = [
        (model, name, predicted_sum(bench, law, path))
        for model, law in laws.items()
        for name, path in motions.items()
    ]
    predictions = pd.DataFrame(rows, columns=["model", "motion", "sum"])
    tables = {"planning": sum_rows(sums), "planning_predictions": predictions}
    return {
        name: rows.assign(arm=arm, physics=physics) for name, rows in tables.items()
    }


def realised_sums(
    bench: Bench, motions: Motions, choices: Sequence[np.ndarray]
) -> Motions:
    """Return Σ_k tr of the sample covariance of ω_k over each choice of takes, by motion."""
    times = np.stack(
        [np.bincount(takes, minlength=bench.takes) for takes in choices]
    ).astype(float)
    count, sums = times.sum(axis=1), {}
    for name, path in motions.items():
        try:
            noise = bench.steps(path, "take").noise
        except SingularJacobianError as error:
            print(f"planning: {name} cannot be performed: {error.message}")
            continue
        centred = (noise - noise.mean(axis=0)).reshape(len(noise), -1)
        # einsum: equal bytes with any linear algebra library
        product = np.einsum("ik,jk->ij", centred, centred)
        mean = np.einsum("ci,ij,cj->c", times, product, times) / count
        sums[name] = (np.einsum("ci,ii->c", times, product) - mean) / (count - 1)
    return sums


def predicted_sum(bench: Bench, model: MotionModel, path: np.ndarray) -> float:
    """Return Σ_k tr Cov(ω_k) in rad² of ``path`` (M+1, n) by ``model``, NaN without covariance."""
    try:
        covariance = model.covariance(bench.chain, path[:-1], bench.command(path))
    except ModelDomainError:
        return float("nan")
    return float(np.trace(covariance, axis1=-2, axis2=-1).sum())


def agreement(rows: pd.DataFrame) -> float:
    """Return Kendall's τ_b (Biometrika 33, 1945) of the ``rows`` of :func:`compared` of one model;
    NaN for < 3 motions and equal predictions.
    """
    predicted = [float(f"{value:.{DIGITS}g}") for value in rows["predicted"]]
    if len(rows) < 3 or len(set(predicted)) == 1:
        return float("nan")
    return float(kendalltau(predicted, rows["ratio"]).statistic)


def compared(planning: pd.DataFrame, predictions: pd.DataFrame) -> pd.DataFrame:
    """Return the sums of performed motions over the minimum-norm motion's, by arm, physics and
    model: ``predicted`` and realised (``ratio``).
    """
    norm = predictions[predictions["motion"] == MINIMUM].drop(columns="motion")
    both = predictions.merge(
        norm, on=[*KEYS, "model"], suffixes=("", " of norm")
    ).dropna()
    both["predicted"] = both["sum"] / both["sum of norm"]
    return both.merge(planning[[*KEYS, "motion", "ratio"]], on=[*KEYS, "motion"])


def sum_rows(sums: Motions) -> pd.DataFrame:
    """Return the table ``planning`` of one arm in one physics."""
    if MINIMUM not in sums:
        raise ConfigError("the arm cannot perform the minimum-norm motion", key="arms")
    least = np.argmin(np.stack(list(sums.values()))[:, 1:], axis=0)
    rows = []
    for place, (motion, values) in enumerate(sums.items()):
        ratios = values / sums[MINIMUM]
        low, high = percentile_interval(ratios[1:])
        row = {
            "motion": motion,
            "sum": values[0],
            "ratio": ratios[0],
            "low": low,
            "high": high,
        }
        rows.append(row | {"least": float(np.mean(least == place))})
    return pd.DataFrame(rows)


def motion_label(motion: str) -> str:
    """Return the name of a motion on the page."""
    return (
        f"{motion.replace('_', '-')} motion" if motion in FIXED else f"plan of {motion}"
    )


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    rows, pairs = tables["planning"], {"by": KEYS, "sort": False}
    both = compared(rows, tables["planning_predictions"]).groupby(
        [*KEYS, "model"], sort=False
    )
    taus = both[["predicted", "ratio"]].apply(agreement).dropna()
    texts = map(interval, rows["ratio"], rows["low"], rows["high"])
    rows = rows.assign(
        text=[text.replace("+", "") for text in texts],
        label=rows["motion"].map(motion_label),
        plan=~rows["motion"].isin(FIXED),
    )
    plans = rows[rows["plan"]]
    least = rows.loc[rows.groupby(**pairs)["ratio"].idxmin()]
    best = plans.loc[plans.groupby(**pairs)["ratio"].idxmin(), [*KEYS, "label", "text"]]
    shown = least.merge(best, "left", KEYS, suffixes=("", " of plan"))
    shown["label"] += [f" ({share:.0%})" for share in shown["least"]]
    cells = shown[[*KEYS, "label", "text", "label of plan", "text of plan"]].fillna(
        MISSING
    )
    sure = (least["plan"] & (least["least"] >= SURE)).sum()
    medians = taus.groupby("model", sort=False).median().map(number)
    return {
        "sure": sure,
        "pairs": len(least),
        "share": SURE,
        "medians": join_names(
            [f"{x} ({n})" for n, x in medians.items()] or ["undefined"]
        ),
        "cells": cells.to_numpy(),
    }


def draw(planning: pd.DataFrame, planning_predictions: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    both, arms = compared(planning, planning_predictions), planning["arm"].unique()
    grey, colours = style.GREY, (style.BLACK, style.GREY, style.GREEN, style.BLUE)
    colours += (style.VERMILLION, style.ORANGE, style.PURPLE)
    motions = dict(zip(planning["motion"].unique(), colours, strict=False))
    models = dict(zip(both["model"].unique(), "osD^vP", strict=False))
    figure, (row,) = style.panels(style.TWO_COLUMNS, 3.2, columns=len(arms))
    dotted = {"color": grey, "ls": ":", "lw": 0.8, "label": "prediction holds"}
    for axes, arm in zip(row, arms, strict=True):
        for each in both[both["arm"] == arm].itertuples():
            look = {"color": motions[each.motion], "marker": models[each.model]}
            axes.plot(
                [each.predicted], [each.ratio], ls="none", ms=4, alpha=0.8, **look
            )
        axes.set(
            xscale="log",
            yscale="log",
            xlabel="predicted over minimum norm (1)",
            title=arm,
        )
        axes.axline((1, 1), (2, 2), **dotted)
        for ticks in (axes.xaxis, axes.yaxis):
            ticks.set_major_formatter("{x:g}")
            ticks.set_minor_formatter("{x:g}")
        axes.tick_params(which="both", labelsize=7)
    style.letters(row)
    row[0].set_ylabel("realised over minimum norm (1)")
    looks = {
        motion_label(x): {"marker": "o", "color": color} for x, color in motions.items()
    }
    hollow = {"mfc": "none", "mec": style.BLACK}
    looks |= {
        f"predicted by {x}": {"marker": mark} | hollow for x, mark in models.items()
    }
    entries = [Line2D([], [], ls="none", label=x, **look) for x, look in looks.items()]
    figure.legend(
        handles=[*entries, Line2D([], [], **dotted)],
        loc="outside lower center",
        ncols=3,
    )
    return figure
