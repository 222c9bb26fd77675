"""score: recordings against models, as the tables behind the figures and the numbers the paper states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng
from pipeline.errors import ModelDomainError
from pipeline.motion.noise import measurement_covariance, recorded_deviation
from pipeline.statistics.comparison import (
    Scores,
    compared,
    filter_metrics,
    filter_scores,
    log_score_differences,
    posterior_scores,
    prediction_scores,
    sensor_scores,
    spread_scores,
)
from pipeline.statistics.resampling import bound_quantities, resampled_differences, spread_quantities
from pipeline.tables import STEP, TAKE

INGEST, TRACK, NOISE, SIMULATE = Path("data/ingest"), Path("data/track"), Path("data/noise"), Path("data/simulate")
EVALUATE, FILTER, WRENCH, OUT = Path("data/evaluate"), Path("data/filter"), Path("data/wrench"), Path("data/score")
CONTROL, SENSITIVITY, FAULTS = Path("data/control"), Path("data/sensitivity"), Path("data/faults")
METRICS, TABLES = Path("reports/metrics"), Path("reports/tables")
FIT, RECOVER = Path("data/fit"), Path("data/recover")
JOINTS = ("q1", "q2", "q3")
FILTERED = "particle filter"
# tables of other stages that the report shows as they are
SHOWN = {
    "parameter_recovery": RECOVER,
    "sigma_b_choices": RECOVER,
    "control_scores": CONTROL,
    "sensitivity": SENSITIVITY,
    "faults": FAULTS,
    "sigma_s": WRENCH,
    "force_moments": WRENCH,
    "force_test": WRENCH,
}


def run() -> None:
    """Compare every model with the recordings, in mean, in spread and in the filter."""
    settings = config.sections("score")
    models = list(settings.models)
    joints = contracts.read("joints", TRACK)
    with contracts.replacing(OUT) as folder, contracts.replacing(TABLES) as tables:
        deviation = _deviation(models, joints, settings.simulation.mode)
        contracts.write(deviation, "deviation", folder)
        contracts.write_metrics(_motion_metrics(deviation, models), METRICS / "motion.json")
        if settings.simulation.mode == "one_step":
            _spread_comparison(models, deviation, settings.seed).to_csv(tables / "spread_comparison.csv", index=False)
        filtered = [model for model in models if contracts.exists("posterior", FILTER / model)]
        metrics = {}
        evaluated = [model for model in models if contracts.exists("one_step_scores", EVALUATE / model)]
        groups = _one_step_scores(evaluated) if evaluated else {}
        if filtered:
            groups[FILTERED] = _posterior_scores(filtered, joints)
            errors = pd.concat([_filter_errors(model, joints) for model in filtered], ignore_index=True)
            contracts.write(errors, "filter_error", folder)
            error, bound = _by_take(errors)
            scores = filter_scores(error, bound)
            scores.to_csv(tables / "filter_scores.csv", index=False)
            metrics = filter_metrics(scores)
            takes = len(error[filtered[0]])
            followed = resampled_differences(bound_quantities(error, bound), filtered, takes, rng.stream(settings.seed, "score.bounds"))
            followed.to_csv(tables / "bound_comparison.csv", index=False)
        contracts.write_metrics(metrics, METRICS / "filter.json")
        if groups:
            comparisons = _by_steps({steps: compared(scores) for steps, scores in groups.items()})
            contracts.write(comparisons, "model_scores", folder)
            of_filter = comparisons["steps"] == FILTERED
            comparisons[~of_filter].to_csv(tables / "one_step_scores.csv", index=False)
            if filtered:
                comparisons[of_filter].drop(columns="steps").to_csv(tables / "filter_comparison.csv", index=False)
            differences = _by_steps({steps: log_score_differences(scores) for steps, scores in groups.items()})
            differences.to_csv(tables / "log_score_differences.csv", index=False)
        ridges = [contracts.read("ridge", FIT / model).assign(model=model) for model in models if contracts.exists("ridge", FIT / model)]
        if ridges:
            contracts.write(pd.concat(ridges, ignore_index=True), "ridges", folder)
        truth = Path(settings.dataset.recordings).parent / "truth"
        contracts.write_metrics(_quality(tables) | _kinect() | _truth(joints, truth), METRICS / "recordings.json")
        for name, place in SHOWN.items():
            if contracts.exists(name, place):
                contracts.read(name, place).to_csv(tables / f"{name}.csv", index=False)
        study = contracts.read("wrench_errors", WRENCH).groupby("agents")["error"].agg(["mean", "max"])
        # the greatest of many errors is a random number: where 95 % of the repeats of the study have it
        maxima = contracts.read("wrench_spread", WRENCH).groupby("agents")["maximum"]
        study = study.assign(max_low=maxima.quantile(0.025), max_high=maxima.quantile(0.975)).reset_index()
        study.to_csv(tables / "wrench_study.csv", index=False)
        deviation.to_csv(tables / "deviation.csv", index=False)
        _side_by_side(contracts.read("takes", TRACK)).to_csv(tables / "takes.csv", index=False)


def _deviation(models: list[str], joints: pd.DataFrame, mode: str) -> pd.DataFrame:
    """Mean error and standard deviation over time of every model, and the standard deviation recorded."""
    names, q = contracts.stacked(joints[joints.part == "training"], list(JOINTS))
    mean = q.mean(axis=0)
    first = joints[joints["take"] == names[0]]
    grid = {"k": first["k"].to_numpy(), "t": first["t"].to_numpy()}
    _, noise = contracts.stacked(contracts.read("process_noise", NOISE), ["w1", "w2", "w3"])
    spread = recorded_deviation(q, noise, mode)
    tables = [pd.DataFrame(grid | {"source": "recorded", "error": 0.0} | {f"s{j + 1}": spread[:, j] for j in range(3)})]
    for model in models:
        moments = contracts.read("moments", SIMULATE / model)
        error = np.linalg.norm(moments[["m1", "m2", "m3"]].to_numpy() - mean, axis=1)
        tables.append(moments[["k", "t", "s1", "s2", "s3"]].assign(source=model, error=error))
    return pd.concat(tables, ignore_index=True)


def _motion_metrics(deviation: pd.DataFrame, models: list[str]) -> dict:
    # at k = 0 nothing has moved yet
    by_source = {source: rows[rows.k > 0] for source, rows in deviation.groupby("source")}
    errors = {model: by_source[model]["error"].to_numpy() for model in models}
    return spread_scores({source: rows[["s1", "s2", "s3"]].to_numpy() for source, rows in by_source.items()}, errors)


def _filter_errors(model: str, joints: pd.DataFrame) -> pd.DataFrame:
    posterior = contracts.read("posterior", FILTER / model).merge(joints[["take", "k", *JOINTS]], on=["take", "k"])
    errors = {f"e{j}": posterior[f"m{j}"] - posterior[f"q{j}"] for j in (1, 2, 3)}
    spread = {f"s{j}": np.sqrt(posterior[f"c{j}{j}"]) for j in (1, 2, 3)}
    return posterior[["take", "part", "k", "t"]].assign(model=model, **errors, **spread)


def _by_take(errors: pd.DataFrame) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Error and bound (takes, K, 3) of every filter, in rad."""
    by_model = dict(list(errors.groupby("model", sort=False)))
    error, bound = (
        {model: contracts.stacked(rows, [f"{name}{j}" for j in (1, 2, 3)])[1] for model, rows in by_model.items()} for name in "es"
    )
    return error, bound


def _spread_comparison(models: list[str], deviation: pd.DataFrame, seed: int) -> pd.DataFrame:
    """Whether the models' standard deviations of one step follow the recorded one, which varies with the takes."""
    _, noise = contracts.stacked(contracts.read("process_noise", NOISE), ["w1", "w2", "w3"])
    std = {source: rows.loc[rows.k > 0, ["s1", "s2", "s3"]].to_numpy() for source, rows in deviation.groupby("source")}
    return resampled_differences(spread_quantities(std, noise), models, len(noise), rng.stream(seed, "score.spread"))


def _step_scores(model: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The scores (takes, M) of every step of the takes that ``model`` was to predict, and which steps (M,) were commanded to move."""
    table = contracts.read("one_step_scores", EVALUATE / model)
    columns = [name for name in table.columns if name not in TAKE | STEP]
    values = dict(zip(columns, np.moveaxis(contracts.stacked(table.astype({"moving": float}), columns)[1], -1, 0), strict=True))
    return values, values["moving"].all(axis=0)


def _one_step_scores(models: list[str]) -> dict[str, dict[str, Scores]]:
    """Every model's predictions of one step: of all steps, of those that were to move, and of these by how well the arm is conditioned."""
    by_model, moving = {}, {}
    for model in models:
        by_model[model], moving[model] = _step_scores(model)
    groups = {"all": np.ones_like(moving[models[0]]), "moving": moving[models[0]]}
    norms = by_model[models[0]]["inverse_norm"].mean(axis=0)
    ends = np.quantile(norms[groups["moving"]], [0, 1 / 3, 2 / 3, 1])
    for name, low, high in zip(("least", "middle", "greatest"), ends, ends[1:], strict=False):
        third = groups["moving"] & (low <= norms) & ((norms < high) | (high == ends[-1]))
        groups[f"moving, {name} third of ‖J⁻¹‖: {low:.3g} to {high:.3g}"] = third
    return {
        name: {
            model: prediction_scores({score: values[:, steps] for score, values in scores.items()}, moving=name != "all")
            for model, scores in by_model.items()
        }
        for name, steps in groups.items()
    }


def _by_steps(rows: dict[str, pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(rows, names=["steps"]).reset_index("steps")


def _posterior_scores(models: list[str], joints: pd.DataFrame) -> dict[str, Scores]:
    """Scores of every filter's posterior as a normal law of the pose that the motion capture measures, over the steps of each take.

    To each posterior half the covariance at rest is added: ω holds the noise of two poses, a measured pose that of one.
    """
    v = contracts.read("trajectory", INGEST)[["vx", "vz", "vphi"]].to_numpy()[:-1]
    _, noise = contracts.stacked(contracts.read("process_noise", NOISE), ["w1", "w2", "w3"])
    try:
        of_pose = measurement_covariance(noise, v) / 2
    except ModelDomainError as error:
        print(f"score: no measurement noise is added to the filters' posteriors: {error}")
        of_pose = np.zeros((3, 3))
    return {model: _of_posterior(model, joints, of_pose) for model in models}


def _of_posterior(model: str, joints: pd.DataFrame, of_pose: np.ndarray) -> Scores:
    posterior = contracts.read("posterior", FILTER / model).merge(joints[["take", "k", *JOINTS]], on=["take", "k"])
    entries = [f"c{min(i, j)}{max(i, j)}" for i in (1, 2, 3) for j in (1, 2, 3)]
    error = contracts.stacked(posterior, ["m1", "m2", "m3"])[1] - contracts.stacked(posterior, list(JOINTS))[1]
    scores, refused = posterior_scores(error, contracts.stacked(posterior, entries)[1].reshape(*error.shape, 3) + of_pose)
    if refused:
        print(f"score: the posterior of {model} is not scored as a normal law: {refused}")
    return scores


def _quality(tables: Path) -> dict:
    """Totals over the takes of what the instruments lost and what was repaired."""
    records = [contracts.read("quality", folder) for folder in (INGEST, TRACK) if contracts.exists("quality", folder)]
    quality = pd.concat(records, ignore_index=True)
    summary = quality.groupby(["instrument", "quantity", "unit"])["value"].agg(["sum", "mean", "min", "max"]).reset_index()
    summary.to_csv(tables / "recording_quality.csv", index=False)
    counted = summary[summary["unit"] == "1"]
    name = counted["instrument"].str.replace(" ", "_") + "_" + counted["quantity"]
    return dict(zip(name, counted["sum"], strict=True))


def _side_by_side(takes: pd.DataFrame) -> pd.DataFrame:
    """One row a take: what tells how good it is, whether it is left out, and why."""
    unit = takes["unit"].map(lambda unit: "" if unit in ("1", "share") else f" ({unit})")
    found = takes["value"].map("{:.3g}".format) + " beyond " + takes["limit"].map("{:g}".format)
    reasons = (takes["measure"] + " " + found)[takes["beyond"]].groupby(takes["take"]).agg("; ".join)
    columns = list(dict.fromkeys(takes["measure"] + unit))
    wide = takes.assign(column=takes["measure"] + unit).pivot(index="take", columns="column", values="value")[columns]
    order = takes.drop_duplicates("take").set_index("take")[["part", "left_out"]]
    return order[["part"]].join(wide).assign(left_out=order["left_out"], reason=reasons).reset_index()


def _kinect() -> dict:
    """The scores of the depth camera's noise, where there is one."""
    if not contracts.exists("kinect_noise", NOISE):
        return {}
    noise = contracts.read("kinect_noise", NOISE)
    of_all = noise[noise["take"] == "none"]
    bias, variance = (of_all[columns].to_numpy() for columns in (["b1", "b2", "b3"], ["r11", "r22", "r33"]))
    return sensor_scores(bias, variance, noise["take"].nunique() - 1)


def _truth(joints: pd.DataFrame, truth: Path) -> dict:
    """How far the measured joint angles are off the true ones, which only a synthetic dataset has."""
    if not contracts.exists("true_joints", truth):
        return {}
    both = joints.merge(contracts.read("true_joints", truth), on=["take", "k"], suffixes=("", "_true"))
    error = both[list(JOINTS)].to_numpy() - both[[f"{q}_true" for q in JOINTS]].to_numpy()
    metrics = {f"tracking_bias_q{j + 1}_rad": error[:, j].mean() for j in range(3)}
    return metrics | {f"tracking_std_q{j + 1}_rad": error[:, j].std() for j in range(3)}
