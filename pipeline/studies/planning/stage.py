"""planning: sum of the variances along the motion that a model plans as the least uncertain, beside
other motions of the same task path, performed by two arms of the laboratory in four physics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from pydantic import Field
from scipy.stats import kendalltau

from pipeline.core import config, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError, ModelDomainError, SingularJacobianError, SolverError
from pipeline.core.options.analysis import Positive
from pipeline.core.validation import options
from pipeline.figures import style
from pipeline.models import kinds
from pipeline.models.model import MotionModel
from pipeline.models.noise import process_noise
from pipeline.planning.motions import best_conditioned, least_uncertain, minimum_norm
from pipeline.planning.problem import InfeasibleError, Problem, uncertainty
from pipeline.statistics.takes import drawn_takes, percentile_interval
from pipeline.studies.frame import MISSING, Results, Study, interval, listed, number
from pipeline.studies.planning.bench import Bench, Rig, bench_of
from pipeline.studies.simulated import PhysicsFactors, disturbed
from pipeline.verdicts.wording import table

RECORDED, MINIMUM, BEST = "recorded", "minimum_norm", "best_conditioned"
SURE = 0.975  # share of the resamplings
DIGITS = 9  # of a prediction; smaller differences are none
KEYS = ["arm", "physics"]
PAGE = """Is the motion that a model plans as the least uncertain really the least uncertain of one
task path? Every model is fitted to {takes} takes of the recorded motion and plans the motion of
least Σ tr Cov(ω). The laboratory performs each motion as often.

**Answer.** In {sure} of {pairs} pairs of arm and physics a model's plan has the least sum in at
least {share:.1%} of the resamplings. The median of Kendall's τ between predicted and realised order
of the motions is {medians}; 1 is the same order, −1 the opposite. The additive model has no plan:
its covariance is the same at every step.{verdict}

{table}

Sums are those of the joints' one-step noise in rad²; ratios are to the minimum-norm motion, with
bootstrap 95 % intervals over the takes; the share is that of the resamplings.

{figure}

**What would change it.** The laboratory's sway grows with the speed of all joints, the null space
included, and no matrix model gives noise to a step in the null space. On a real robot whose noise
follows a model, that model's plan would be the least uncertain. The planner knows no collisions."""


@options()
class Options:
    """Arms, models, physics and terms of the plans; params.yaml describes each."""

    arms: dict[str, list[str]]
    models: list[str]
    physics: dict[str, dict[str, float]]
    takes: Annotated[int, Field(ge=2)]
    pace: Positive
    margin: Positive
    smoothness: Positive
    conditioned: Positive


def evaluate(settings: SimpleNamespace, options: Options) -> dict[str, pd.DataFrame]:
    """Return the study's tables."""
    benches = {
        arm: bench_of(config.CONF / f"dataset/{arm}.yaml", task, options.pace)
        for arm, task in options.arms.items()
    }
    compute = settings.compute
    trial = partial(fixed_motions, options=options)
    fixed = run_trials(trial, benches.values(), compute=compute, label="planning: arms")
    trial = partial(
        tables_of,
        benches=benches,
        fixed=dict(zip(benches, fixed, strict=True)),
        options=options,
        models=config.model_options(options.models),
        seed=settings.seed,
    )
    cases = [(arm, name) for name in options.physics for arm in benches]
    parts = list(run_trials(trial, cases, compute=compute, label="planning: physics"))
    return {name: pd.concat([part[name] for part in parts], ignore_index=True) for name in parts[0]}


def problem_of(bench: Bench, options: Options, smoothness: float) -> Problem:
    """Return the task path of the recorded motion with the study's margin."""
    least = np.linalg.svd(bench.chain.jacobian(bench.recorded), compute_uv=False)[:, -1].min()
    path = bench.chain.pose(bench.recorded)
    return Problem(bench.chain, path, bench.rate, options.margin * float(least), smoothness)


def fixed_motions(bench: Bench, options: Options) -> dict[str, np.ndarray]:
    """Return the motions (M+1, n) in rad that need no model; raises InfeasibleError."""
    problem = problem_of(bench, options, 0.0)
    return {
        RECORDED: bench.recorded,
        MINIMUM: minimum_norm(problem, bench.recorded[0]).joints,
        BEST: best_conditioned(replace(problem, smoothness=options.conditioned)).joints,
    }


def planned(bench: Bench, model: MotionModel, options: Options) -> np.ndarray:
    """Return the motion (M+1, n) in rad of least Σ tr Cov under ``model``.

    Raises InfeasibleError, and ModelDomainError for a model without a covariance or with the same
    covariance at every step.
    """
    cost, path = uncertainty(model, bench.chain, "trace"), bench.recorded
    problem = problem_of(bench, options, 0.0)
    each = cost(path[:-1], problem.steps)
    if np.ptp(each) == 0:
        raise ModelDomainError("the covariance is the same at every step, so no motion has less")
    weight = options.smoothness * each.sum() / np.sum(np.diff(path, axis=0) ** 2)
    return least_uncertain(replace(problem, smoothness=float(weight)), cost).joints


def tables_of(
    case: tuple[str, str],
    benches: Mapping[str, Bench],
    fixed: Mapping[str, Mapping[str, np.ndarray]],
    options: Options,
    models: Mapping[str, object],
    seed: int,
) -> dict[str, pd.DataFrame]:
    """Return the study's tables of one arm in one physics, ``case``; ``fixed`` are the motions that
    need no model, by arm.
    """
    arm, physics = case
    bench, motions, laws = benches[arm], dict(fixed[arm]), {}
    dynamics = disturbed(bench.dynamics, PhysicsFactors(**options.physics[physics]))
    rig = Rig(bench, dynamics, options.takes, seed)
    recorded = rig.training()
    for name, chosen in models.items():
        try:
            laws[name] = kinds.estimate(recorded, chosen).model
            motions[name] = planned(bench, laws[name], options)
        except (InfeasibleError, ModelDomainError, SolverError) as error:
            print(f"planning: {arm}, {physics}: {name} has no plan: {error.message}")
    drawn = drawn_takes(options.takes, rng.stream(seed, "planning.resampling"))
    sums = realised_sums(rig, motions, [np.arange(options.takes), *drawn])
    predictions, agreements = [], []
    for model, law in laws.items():
        own = {name: predicted_sum(bench, law, path) for name, path in motions.items()}
        predictions += [(model, *each) for each in own.items()]
        agreements.append((model, agreement(own, {name: one[0] for name, one in sums.items()})))
    tables = {
        "planning": sum_rows(sums),
        "planning_predictions": pd.DataFrame(predictions, columns=["model", "motion", "sum"]),
        "planning_agreements": pd.DataFrame(agreements, columns=["model", "tau"]),
    }
    return {name: rows.assign(arm=arm, physics=physics) for name, rows in tables.items()}


def realised_sums(
    rig: Rig, motions: Mapping[str, np.ndarray], choices: Sequence[np.ndarray]
) -> dict[str, np.ndarray]:
    """Return Σ_k tr of the sample covariance of ω_k over each choice of takes, which may repeat, by
    motion; motions that the arm cannot perform are left out.
    """
    times = np.stack([np.bincount(takes, minlength=rig.takes) for takes in choices]).astype(float)
    count, sums = times.sum(axis=1), {}
    for name, path in motions.items():
        try:
            q = rig.poses(path, "take")
            noise = process_noise(rig.bench.chain, q, rig.bench.command(path))
        except SingularJacobianError as error:
            print(f"planning: {name} cannot be performed: {error.message}")
            continue
        centred = (noise - noise.mean(axis=0)).reshape(len(noise), -1)
        # equal bytes with any linear algebra library
        product = np.einsum("ik,jk->ij", centred, centred)
        mean = np.einsum("ci,ij,cj->c", times, product, times) / count
        sums[name] = (np.einsum("ci,ii->c", times, product) - mean) / (count - 1)
    return sums


def predicted_sum(bench: Bench, model: MotionModel, path: np.ndarray) -> float:
    """Σ_k tr Cov(ω_k) in rad² of ``path`` (M+1, n) by ``model``; NaN if it has no covariance."""
    try:
        covariance = model.covariance(bench.chain, path[:-1], bench.command(path))
    except ModelDomainError:
        return float("nan")
    return float(np.trace(covariance, axis1=-2, axis2=-1).sum())


def agreement(prediction: Mapping[str, float], realised: Mapping[str, float]) -> float:
    """Kendall's τ_b of two orders of the motions (Kendall, Biometrika 33, 1945); NaN for fewer than
    three motions or equal predictions.
    """
    names = [name for name, value in prediction.items() if name in realised and value == value]
    first = [float(f"{prediction[name]:.{DIGITS}g}") for name in names]
    if len(names) < 3 or len(set(first)) == 1:
        return float("nan")
    return float(kendalltau(first, [realised[name] for name in names]).statistic)


def sum_rows(sums: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Return the table ``planning`` without arm and physics."""
    least = np.array(list(sums))[np.argmin(np.stack(list(sums.values()))[:, 1:], axis=0)]
    if MINIMUM not in sums:
        raise ConfigError("the arm cannot perform the minimum-norm motion", key="arms")
    rows = []
    for motion, values in sums.items():
        ratios = values / sums[MINIMUM]
        low, high = percentile_interval(ratios[1:])
        share = float(np.mean(least == motion))
        rows.append((motion, values[0], ratios[0], low, high, share))
    return pd.DataFrame(rows, columns=["motion", "sum", "ratio", "low", "high", "least"])


def motion_label(motion: str) -> str:
    """Return the name of a motion in words."""
    if motion in (RECORDED, MINIMUM, BEST):
        return f"{motion.replace('_', '-')} motion"
    return f"plan of {motion}"


def page(results: Results) -> list[str]:
    """Return the page's parts."""
    rows, taus = results.tables["planning"], results.tables["planning_agreements"]
    least = rows.loc[rows.groupby(KEYS, sort=False)["ratio"].idxmin()]
    plans = ~rows["motion"].isin([RECORDED, MINIMUM, BEST])
    sure = (plans[least.index] & (least["least"] >= SURE)).sum()
    best = rows[plans].groupby(KEYS, sort=False)["ratio"].idxmin()
    medians = taus.dropna(subset="tau").groupby("model", sort=False)["tau"].median()
    few, lines = sure < SURE * len(least), []
    for row in least.itertuples():
        cells = [row.arm, row.physics, f"{motion_label(row.motion)} ({row.least:.0%})"]
        cells += [ratio_text(row), MISSING, MISSING]
        if (row.arm, row.physics) in best:
            own = rows.loc[best[row.arm, row.physics]]
            cells[-2:] = motion_label(own["motion"]), ratio_text(own)
        lines.append(cells)
    header = ["arm", "physics", "least sum (share)", "over minimum norm", "best plan", "over it"]
    text = PAGE.format(
        takes=results.options.takes,
        sure=sure,
        pairs=len(least),
        share=SURE,
        medians=listed([f"{number(tau)} ({model})" for model, tau in medians.items()])
        or "undefined",
        verdict=" These plans do not reliably reduce the uncertainty." if few else "",
        table=table(header, lines),
        figure=results.figure,
    )
    return [text]


def ratio_text(row) -> str:
    """Return a ratio with its interval."""
    return interval(row.ratio, row.low, row.high).replace("+", "")


def draw(planning: pd.DataFrame, planning_predictions: pd.DataFrame) -> Figure:
    """Uncertainty of motions along one task path, predicted and realised.

    One panel an arm, all physics. Across: predicted Σ tr Cov(ω) over that of the minimum-norm
    motion, a symbol a model; upwards: the realised sum over that of the minimum-norm motion, a
    colour a motion. On the dotted diagonal the prediction holds.
    """
    predicted = planning_predictions.dropna(subset="sum")
    norm = predicted[predicted["motion"] == MINIMUM].rename(columns={"sum": "norm"})
    both = predicted.merge(norm.drop(columns="motion"), on=[*KEYS, "model"])
    both = both.merge(planning[[*KEYS, "motion", "ratio"]], on=[*KEYS, "motion"])
    arms, black = list(dict.fromkeys(planning["arm"])), style.BLACK
    colours = (black, style.GREY, style.GREEN, style.BLUE, style.VERMILLION, style.ORANGE)
    motions = dict(zip(dict.fromkeys(planning["motion"]), (*colours, style.PURPLE), strict=False))
    models = dict(zip(dict.fromkeys(both["model"]), "osD^vP", strict=False))
    figure, grid = style.panels(style.TWO_COLUMNS, 3.2, columns=len(arms))
    for name, axes, arm in zip("abcdefg", grid[0], arms, strict=False):
        for row in both[both["arm"] == arm].itertuples():
            look = {"color": motions[row.motion], "marker": models[row.model]}
            axes.plot([row.sum / row.norm], [row.ratio], ls="none", ms=4, alpha=0.8, **look)
        axes.set(xscale="log", yscale="log", xlabel="predicted over minimum norm", title=arm)
        axes.axline((1, 1), (2, 2), color=style.GREY, ls=":", lw=0.8)
        for ticks in (axes.xaxis, axes.yaxis):
            ticks.set_major_formatter("{x:g}")
            ticks.set_minor_formatter("{x:g}")
        axes.tick_params(which="both", labelsize=7)
        style.letter(axes, name)
    grid[0, 0].set_ylabel("realised over minimum norm")
    entries = [
        Line2D([], [], marker="o", ls="none", color=color, label=motion_label(name))
        for name, color in motions.items()
    ]
    hollow = {"ls": "none", "mfc": "none", "mec": black}
    entries += [
        Line2D([], [], marker=mark, label=f"predicted by {name}", **hollow)
        for name, mark in models.items()
    ]
    entries.append(Line2D([], [], color=style.GREY, ls=":", lw=0.8, label="prediction holds"))
    figure.legend(handles=entries, loc="outside lower center", ncols=3)
    return figure


run = Study("Least uncertain motions, planned and performed", Options, evaluate, page, draw).run
