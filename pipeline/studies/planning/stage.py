"""planning: sum of the variances along the motion that a model plans as the least uncertain, beside
other motions of the same task path, performed by two arms of the laboratory in four physics.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.stats import kendalltau

from pipeline.core import config, rng
from pipeline.core.errors import ConfigError, ModelDomainError, SingularJacobianError, SolverError
from pipeline.figures import style
from pipeline.models import kinds
from pipeline.models.model import MotionModel
from pipeline.models.steps import process_noise
from pipeline.planning.motions import best_conditioned, least_uncertain, minimum_norm
from pipeline.planning.problem import InfeasibleError, Problem, uncertainty
from pipeline.statistics.takes import drawn_takes, percentile_interval
from pipeline.studies.frame import MISSING, Study, Tables, interval, joined, number, trials
from pipeline.studies.planning.bench import Bench, Rig, bench_of
from pipeline.studies.simulated import PhysicsFactors, disturbed
from pipeline.verdicts.wording import listed, table

RECORDED, MINIMUM, BEST = "recorded", "minimum_norm", "best_conditioned"
SURE = 0.975  # share of the resamplings
DIGITS = 9  # of a prediction; smaller differences are none
KEYS = ["arm", "physics"]
Motions = Mapping[str, np.ndarray]  # by name: (M+1, n) rad, or (choices,) sums of their noise


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables."""
    benches = {
        arm: bench_of(config.CONF / f"dataset/{arm}.yaml", task, options.pace)
        for arm, task in options.arms.items()
    }
    arms = list(benches.values())
    fixed = trials(settings, "planning: arms", fixed_motions, arms, options=options)
    cases = [(arm, name) for name in options.physics for arm in benches]
    common = {"benches": benches, "fixed": dict(zip(benches, fixed, strict=True))}
    common |= {"options": options, "models": config.model_options(options.models)}
    label = "planning: physics"
    parts = trials(settings, label, tables_of, cases, **common, seed=settings.seed)
    return {name: joined(part[name] for part in parts) for name in parts[0]}


def problem_of(bench: Bench, options: SimpleNamespace, smoothness: float) -> Problem:
    """Return the task path of the recorded motion with the study's margin."""
    least = np.linalg.svd(bench.chain.jacobian(bench.recorded), compute_uv=False)[:, -1].min()
    path = bench.chain.pose(bench.recorded)
    return Problem(bench.chain, path, bench.rate, options.margin * float(least), smoothness)


def fixed_motions(bench: Bench, options: SimpleNamespace) -> Motions:
    """Return the motions that need no model; raises InfeasibleError."""
    problem = problem_of(bench, options, 0.0)
    return {
        RECORDED: bench.recorded,
        MINIMUM: minimum_norm(problem, bench.recorded[0]).joints,
        BEST: best_conditioned(replace(problem, smoothness=options.conditioned)).joints,
    }


def planned(bench: Bench, model: MotionModel, options: SimpleNamespace) -> np.ndarray:
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
    fixed: Mapping[str, Motions],
    options: SimpleNamespace,
    models: Mapping[str, object],
    seed: int,
) -> Tables:
    """Return the tables of one arm in one physics, ``case``; ``fixed`` motions need no model."""
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
    predictions = {
        model: {name: predicted_sum(bench, law, path) for name, path in motions.items()}
        for model, law in laws.items()
    }
    rows = [(model, *each) for model, own in predictions.items() for each in own.items()]
    realised = {name: values[0] for name, values in sums.items()}
    taus = [(model, agreement(own, realised)) for model, own in predictions.items()]
    tables = {
        "planning": sum_rows(sums),
        "planning_predictions": pd.DataFrame(rows, columns=["model", "motion", "sum"]),
        "planning_agreements": pd.DataFrame(taus, columns=["model", "tau"]),
    }
    return {name: rows.assign(arm=arm, physics=physics) for name, rows in tables.items()}


def realised_sums(rig: Rig, motions: Motions, choices: Sequence[np.ndarray]) -> Motions:
    """Return Σ_k tr of the sample covariance of ω_k over each choice of takes, by motion."""
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
    """Kendall's τ_b (Biometrika 33, 1945) of two orders; NaN of < 3 motions, equal predictions."""
    names = [name for name, value in prediction.items() if name in realised and value == value]
    first = [float(f"{prediction[name]:.{DIGITS}g}") for name in names]
    if len(names) < 3 or len(set(first)) == 1:
        return float("nan")
    return float(kendalltau(first, [realised[name] for name in names]).statistic)


def sum_rows(sums: Motions) -> pd.DataFrame:
    """Return the table ``planning`` without arm and physics."""
    if MINIMUM not in sums:
        raise ConfigError("the arm cannot perform the minimum-norm motion", key="arms")
    least = np.array(list(sums))[np.argmin(np.stack(list(sums.values()))[:, 1:], axis=0)]
    rows = []
    for motion, values in sums.items():
        ratios = values / sums[MINIMUM]
        ends, share = percentile_interval(ratios[1:]), float(np.mean(least == motion))
        rows.append((motion, values[0], ratios[0], *ends, share))
    return pd.DataFrame(rows, columns=["motion", "sum", "ratio", "low", "high", "least"])


def motion_label(motion: str) -> str:
    """Return the name of a motion in words."""
    if motion in (RECORDED, MINIMUM, BEST):
        return f"{motion.replace('_', '-')} motion"
    return f"plan of {motion}"


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    rows, taus = tables["planning"], tables["planning_agreements"].dropna(subset="tau")
    ends = zip(rows["ratio"], rows["low"], rows["high"], strict=True)
    rows = rows.assign(
        text=[interval(*each).replace("+", "") for each in ends],
        label=rows["motion"].map(motion_label),
        plan=~rows["motion"].isin([RECORDED, MINIMUM, BEST]),
    )
    least = rows.loc[rows.groupby(KEYS, sort=False)["ratio"].idxmin()]
    best = rows[rows["plan"]]
    best = best.loc[best.groupby(KEYS, sort=False)["ratio"].idxmin()]
    shown = least.merge(best[[*KEYS, "label", "text"]], "left", KEYS, suffixes=("", " of plan"))
    shown["label"] += [f" ({share:.0%})" for share in shown["least"]]
    cells = [*KEYS, "label", "text", "label of plan", "text of plan"]
    header = ["arm", "physics", "least sum (share)", "over minimum norm", "best plan", "over it"]
    sure = (least["plan"] & (least["least"] >= SURE)).sum()
    medians = taus.groupby("model", sort=False)["tau"].median()
    medians = [f"{number(tau)} ({model})" for model, tau in medians.items()]
    few = " These plans do not reliably reduce the uncertainty."
    return {
        "takes": options.takes,
        "sure": sure,
        "pairs": len(least),
        "share": SURE,
        "medians": listed(medians or ["undefined"]),
        "verdict": few if sure < SURE * len(least) else "",
        "table": table(header, shown[cells].fillna(MISSING).to_numpy()),
    }


def draw(planning: pd.DataFrame, planning_predictions: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    norm = planning_predictions[planning_predictions["motion"] == MINIMUM]
    both = planning_predictions.merge(
        norm.drop(columns="motion"), on=[*KEYS, "model"], suffixes=("", " of norm")
    ).dropna()
    both = both.merge(planning[[*KEYS, "motion", "ratio"]], on=[*KEYS, "motion"])
    both["predicted"] = both["sum"] / both["sum of norm"]
    arms, black, grey = list(dict.fromkeys(planning["arm"])), style.BLACK, style.GREY
    colours = (black, grey, style.GREEN, style.BLUE, style.VERMILLION, style.ORANGE, style.PURPLE)
    motions = dict(zip(dict.fromkeys(planning["motion"]), colours, strict=False))
    models = dict(zip(dict.fromkeys(both["model"]), "osD^vP", strict=False))
    figure, grid = style.panels(style.TWO_COLUMNS, 3.2, columns=len(arms))
    dotted = {"color": grey, "ls": ":", "lw": 0.8, "label": "prediction holds"}
    for axes, arm in zip(grid[0], arms, strict=True):
        for row in both[both["arm"] == arm].itertuples():
            look = {"color": motions[row.motion], "marker": models[row.model]}
            axes.plot([row.predicted], [row.ratio], ls="none", ms=4, alpha=0.8, **look)
        axes.set(xscale="log", yscale="log", xlabel="predicted over minimum norm (1)", title=arm)
        axes.axline((1, 1), (2, 2), **dotted)
        for ticks in (axes.xaxis, axes.yaxis):
            ticks.set_major_formatter("{x:g}")
            ticks.set_minor_formatter("{x:g}")
        axes.tick_params(which="both", labelsize=7)
    style.letters(grid[0])
    grid[0, 0].set_ylabel("realised over minimum norm (1)")
    looks = {motion_label(x): {"marker": "o", "color": color} for x, color in motions.items()}
    hollow = {"mfc": "none", "mec": black}
    looks |= {f"predicted by {x}": {"marker": mark} | hollow for x, mark in models.items()}
    entries = [Line2D([], [], ls="none", label=x, **look) for x, look in looks.items()]
    figure.legend(handles=[*entries, Line2D([], [], **dotted)], loc="outside lower center", ncols=3)
    return figure


run = Study(evaluate, facts, draw).run
