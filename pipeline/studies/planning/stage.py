"""planning: noise on the motion that a model plans as least uncertain, against other motions."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.arm.chain import Chain
from pipeline.arm.interface import trajectory_table
from pipeline.arm.model import chain_of
from pipeline.configuration import config
from pipeline.core import rng
from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.core.options.dataset import Robot
from pipeline.figures import style
from pipeline.laboratory.causes import dynamics_type
from pipeline.laboratory.dynamics import JointPath, desired_path, open_session
from pipeline.laboratory.options import DynamicsOptions, TrajectoryOptions
from pipeline.models import kinds
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded, process_noise
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
from pipeline.studies.planning.solver import (
    PathTask,
    feasible_motions,
    least_uncertain,
    motions_from,
    summed_variance,
)
from pipeline.studies.simulated import performed_takes
from pipeline.verdicts.wording import join_names

RECORDED_START = "recorded start"
SURE = 0.975  # least share of the resamplings of a reliable result
CASE = ["arm", "cause"]
Motions = dict[str, np.ndarray]  # by name: (M+1, n) rad
PLAN = "plan of "


@dataclass(frozen=True, eq=False)
class Bench:
    """An arm of the laboratory with its noise and the task path of its recorded motion."""

    joints: tuple[str, ...]  # names, base to tip
    built: Chain  # nominal chain, with the task rows along which the tool sways
    task: PathTask
    recorded: np.ndarray  # (M+1, n) rad, motion of the dataset
    dynamics: DynamicsOptions
    takes: int  # of a motion
    seed: int

    def recorded_steps(self, motion: np.ndarray, name: str) -> Recorded:
        """Return the steps of the takes ``name`` that perform ``motion`` (M+1, n) in rad, without
        measurement noise and with equal random numbers for every motion.

        Raises ConfigError if the arm cannot follow, SingularJacobianError at a singular pose.
        """
        commanded = JointPath(motion, self.task.rate)
        commanded.require_followable(self.built)
        session_stream = rng.stream(self.seed, "planning.session")
        session = open_session(self.built, self.dynamics, session_stream)
        streams = [
            rng.stream(self.seed, f"planning.{name}", take)
            for take in range(self.takes)
        ]
        q, _ = performed_takes(session, commanded, self.dynamics, streams)
        chain = self.task.chain
        table = trajectory_table(chain, motion, self.task.rate, self.joints)
        command = commanded_steps(table, self.task.rate)
        noise = process_noise(chain, q, command)
        return Recorded(chain, q[:, :-1], command, noise, self.joints)


def bench_of(arm: str, cause: str, options: SimpleNamespace, seed: int) -> Bench:
    """Return the arm of the dataset ``arm`` with the noise of a ``cause``."""
    robot = dataset_option(Robot, arm, "robot")
    trajectory = dataset_option(TrajectoryOptions, arm, "laboratory", "trajectory")
    dynamics = dataset_option(dynamics_type(cause), arm, "laboratory", "dynamics")
    built = chain_of(robot)
    rows = options.arms[arm]["task"]
    chain = chain_of(replace(robot, task=rows)) if rows else built
    recorded = desired_path(built, trajectory)
    least = float(chain.least_singular_value(recorded).min())
    task = PathTask(
        chain,
        chain.pose(recorded),
        trajectory.rate,
        options.margin * least,
    )
    joints = tuple(robot.joints)
    return Bench(joints, built, task, recorded, dynamics, options.takes, seed)


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables."""
    cases = []
    for arm, choices in options.arms.items():
        cases += [(arm, cause) for cause in choices["causes"]]
    by_case = trials(
        settings,
        "planning",
        tables_of,
        cases,
        options=options,
        models=config.model_options(options.models),
        seed=settings.seed,
    )
    tables = {}
    for name in by_case[0]:
        tables[name] = concatenate(of_case[name] for of_case in by_case)
    return tables


def tables_of(
    case: tuple[str, str],
    options: SimpleNamespace,
    models: Mapping[str, object],
    seed: int,
) -> Tables:
    """Return the tables of a ``case`` (arm, cause of the noise)."""
    arm, cause = case
    bench = bench_of(arm, cause, options, seed)
    candidates = feasible_motions(bench.task, options.starts)
    training = bench.recorded_steps(bench.recorded, "training")
    laws = {}
    plans = {}
    for name, model_options in models.items():
        try:
            law = kinds.estimate(training, model_options).model
            plans[PLAN + name] = least_uncertain(law, bench.task, candidates)
            laws[name] = law
        except (ModelDomainError, SolverError) as error:
            print(f"planning: {arm}, {cause}: {name} has no plan: {error.message}")

    # a plan is counted before an equal motion of the others
    (recorded_start,) = motions_from(bench.task, bench.recorded[:1])
    motions = {RECORDED_START: recorded_start} | plans
    motions |= motions_by_conditioning(bench.task, candidates, options.compared)
    tables = {
        "planning": realised_rows(bench, motions),
        "planning_predictions": predicted_rows(bench.task, motions, laws),
    }
    return {name: rows.assign(arm=arm, cause=cause) for name, rows in tables.items()}


def motions_by_conditioning(
    task: PathTask,
    candidates: np.ndarray,
    count: int,
) -> Motions:
    """Return ``count`` of the ``candidates`` (S, M+1, n) from the worst to the best conditioned,
    named by their rank in the mean least singular value of J.
    """
    clearance = task.chain.least_singular_value(candidates).mean(axis=1)
    ranked = candidates[np.argsort(clearance, kind="stable")]
    motions = {}
    for share in np.linspace(0.0, 1.0, count):
        rank = round(share * (len(ranked) - 1))
        motions[f"conditioning {share:.0%}"] = ranked[rank]
    return motions


def predicted_rows(
    task: PathTask,
    motions: Motions,
    laws: Mapping[str, MotionModel],
) -> pd.DataFrame:
    """Return the table ``planning_predictions`` of one case."""
    joints = np.stack(list(motions.values()))
    rows = []
    for model, law in laws.items():
        sums = summed_variance(law, task, joints)
        for motion, value in zip(motions, sums, strict=True):
            rows.append((model, motion, value))
    return pd.DataFrame(rows, columns=["model", "motion", "sum"])


def realised_rows(bench: Bench, motions: Motions) -> pd.DataFrame:
    """Return the table ``planning`` of one case: sums over the takes, and their intervals by a
    bootstrap of the takes.
    """
    stream = rng.stream(bench.seed, "planning.resampling")
    choices = [np.arange(bench.takes), *drawn_takes(bench.takes, stream)]
    sums = {}
    for name, motion in motions.items():
        noise = bench.recorded_steps(motion, "take").noise
        sums[name] = realised_sums(noise, choices)

    least = np.argmin(np.stack(list(sums.values()))[:, 1:], axis=0)
    rows = []
    for place, (name, values) in enumerate(sums.items()):
        ratios = values / sums[RECORDED_START]
        low, high = percentile_interval(ratios[1:])
        row = {
            "motion": name,
            "sum": values[0],
            "ratio": ratios[0],
            "low": low,
            "high": high,
            "least": float(np.mean(least == place)),
        }
        rows.append(row)
    return pd.DataFrame(rows)


def realised_sums(noise: np.ndarray, choices: list[np.ndarray]) -> np.ndarray:
    """Return Σ_k tr of the sample covariance of ``noise`` (takes, M, n) in rad over each of the
    ``choices`` of takes.
    """
    takes = len(noise)
    times = np.stack([np.bincount(chosen, minlength=takes) for chosen in choices])
    times = times.astype(float)
    count = times.sum(axis=1)
    centred = (noise - noise.mean(axis=0)).reshape(takes, -1)
    # einsum: equal bytes with any linear algebra library
    products = np.einsum("ik,jk->ij", centred, centred)
    mean = np.einsum("ci,ij,cj->c", times, products, times) / count
    squares = np.einsum("ci,ii->c", times, products)
    return (squares - mean) / (count - 1)


def compared(planning: pd.DataFrame, predictions: pd.DataFrame) -> pd.DataFrame:
    """Return the sums over the sum of the motion from the recorded start, by case, model and
    motion: ``predicted`` and realised (``ratio``).
    """
    keys = [*CASE, "model"]
    from_start = predictions["motion"] == RECORDED_START
    start = predictions.loc[from_start, [*keys, "sum"]]
    start = start.rename(columns={"sum": "sum_of_start"})
    rows = predictions.merge(start, on=keys)
    rows["predicted"] = rows["sum"] / rows["sum_of_start"]
    keys = [*CASE, "motion"]
    realised = planning[[*keys, "ratio"]]
    return rows.merge(realised, on=keys)


def agreement(rows: pd.DataFrame) -> float:
    """Return Kendall's τ_b (Biometrika 33, 1945) of ``rows`` of :func:`compared` of one model, NaN
    for fewer than three motions.
    """
    from scipy.stats import kendalltau

    if len(rows) < 3:
        return float("nan")
    return float(kendalltau(rows["predicted"], rows["ratio"]).statistic)


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    planning = tables["planning"]
    taus: dict[str, list[float]] = {}
    both = compared(planning, tables["planning_predictions"])
    for (*_, model), rows in both.groupby([*CASE, "model"], sort=False):
        taus.setdefault(model, []).append(agreement(rows))
    medians = []
    for name, of_cases in taus.items():
        medians.append(f"{number(np.nanmedian(of_cases))} ({name})")

    sure = 0
    cells = []
    for case, rows in planning.groupby(CASE, sort=False):
        least = rows.loc[rows["ratio"].idxmin()]
        planned = rows["motion"].str.startswith(PLAN)
        sure += rows.loc[planned, "least"].sum() >= SURE
        cell = [*case, f"{least['motion']} ({least['least']:.0%})", ratio_text(least)]
        for model in taus:
            plan = rows[rows["motion"] == PLAN + model]
            cell.append(ratio_text(plan.iloc[0]) if len(plan) else "–")
        cells.append(cell)
    header = ["arm", "cause", "least sum (share)", "ratio"]
    header += [PLAN + model for model in taus]
    return {
        "sure": int(sure),
        "pairs": len(cells),
        "share": SURE,
        "medians": join_names(medians or ["undefined"]),
        "header": header,
        "cells": cells,
    }


def ratio_text(row: pd.Series) -> str:
    """Return the ratio of a ``row`` of the table ``planning`` with its interval."""
    return interval(row["ratio"], row["low"], row["high"]).replace("+", "")


def draw(planning: pd.DataFrame, planning_predictions: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    both = compared(planning, planning_predictions)
    cases = list(both.groupby(CASE, sort=False))
    markers = dict(zip(both["model"].unique(), "osD^vP", strict=False))
    figure, (row,) = style.panels(style.TWO_COLUMNS, 2.8, columns=len(cases))
    for axes, ((arm, cause), rows) in zip(row, cases, strict=True):
        for point in rows.itertuples():
            color = style.GREY
            above = 2
            if point.motion == PLAN + point.model:
                # an equal motion is beneath
                color = style.VERMILLION
                above = 3
            elif point.motion == RECORDED_START:
                color = style.BLACK
            look = {"marker": markers[point.model], "color": color, "ls": "none"}
            axes.plot([point.predicted], [point.ratio], ms=4, zorder=above, **look)
        axes.axline((1, 1), slope=1, color=style.GREY, ls=":", lw=0.8)
        axes.set(title=f"{arm}, {cause}", xlabel="predicted (1)")
        axes.tick_params(labelsize=7)
    row[0].set_ylabel("realised (1)")

    looks = {
        "recorded start": {"marker": "o", "color": style.BLACK},
        "plan of the predicting model": {"marker": "o", "color": style.VERMILLION},
        "other start": {"marker": "o", "color": style.GREY},
    }
    for model, marker in markers.items():
        hollow = {"marker": marker, "mfc": "none", "mec": style.BLACK}
        looks[f"predicted by {model}"] = hollow
    entries = [Line2D([], [], ls="none", label=x, **look) for x, look in looks.items()]
    dotted = {"color": style.GREY, "ls": ":", "lw": 0.8}
    entries.append(Line2D([], [], label="prediction holds", **dotted))
    figure.legend(handles=entries, loc="outside lower center", ncols=3)
    return figure
