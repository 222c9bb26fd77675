"""score: recordings against models, as the tables behind the figures and the numbers the paper states."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts
from pipeline.errors import ModelDomainError
from pipeline.motion.noise import measurement_covariance
from pipeline.statistics.agreement import correlation, coverage, root_mean_square
from pipeline.statistics.scores import in_region, log_determinant, nees, nees_band, normal_log_score, paired_difference, relative_error

INGEST, TRACK, NOISE, SIMULATE = Path("data/ingest"), Path("data/track"), Path("data/noise"), Path("data/simulate")
EVALUATE, FILTER, WRENCH, OUT = Path("data/evaluate"), Path("data/filter"), Path("data/wrench"), Path("data/score")
METRICS, TABLES = Path("reports/metrics"), Path("reports/tables")
JOINTS = ("q1", "q2", "q3")


def run() -> None:
    """Compare every model with the recordings, in mean, in spread and in the filter."""
    settings = config.sections("score")
    models = list(settings.models)
    joints = contracts.read("joints", TRACK)
    with contracts.replacing(OUT) as folder, contracts.replacing(TABLES) as tables:
        deviation = _deviation(models, joints, settings.simulation.mode)
        contracts.write(deviation, "deviation", folder)
        contracts.write_metrics(_motion_metrics(deviation, models), METRICS / "motion.json")
        filtered = [model for model in models if contracts.exists("posterior", FILTER / model)]
        metrics = {}
        evaluated = [model for model in models if contracts.exists("one_step_scores", EVALUATE / model)]
        if evaluated:
            compared = {steps: _compared({model: _one_step_scores(model, steps) for model in evaluated}) for steps in ("all", "moving")}
            pd.concat(compared, names=["steps"]).reset_index("steps").to_csv(tables / "one_step_scores.csv", index=False)
        if filtered:
            _compared(_posterior_scores(filtered, joints)).to_csv(tables / "filter_comparison.csv", index=False)
            errors = pd.concat([_filter_errors(model, joints) for model in filtered], ignore_index=True)
            contracts.write(errors, "filter_error", folder)
            scores = _filter_scores(errors)
            scores.to_csv(tables / "filter_scores.csv", index=False)
            names = scores.columns.drop(["model", "joint"])
            metrics = {f"{row.model}_q{row.joint}_{name}": getattr(row, name) for row in scores.itertuples() for name in names}
        contracts.write_metrics(metrics, METRICS / "filter.json")
        truth = Path(settings.dataset.recordings).parent / "truth"
        contracts.write_metrics(_quality(tables) | _truth(joints, truth), METRICS / "recordings.json")
        for name in ("sigma_s", "force_moments", "force_test"):
            if contracts.exists(name, WRENCH):
                contracts.read(name, WRENCH).to_csv(tables / f"{name}.csv", index=False)
        study = contracts.read("wrench_errors", WRENCH).groupby("agents")["error"].agg(["mean", "max"]).reset_index()
        study.to_csv(tables / "wrench_study.csv", index=False)
        deviation.to_csv(tables / "deviation.csv", index=False)


def _deviation(models: list[str], joints: pd.DataFrame, mode: str) -> pd.DataFrame:
    """Mean error and standard deviation over time of every model, and the standard deviation recorded."""
    names, q = contracts.stacked(joints[joints.part == "training"], list(JOINTS))
    mean = q.mean(axis=0)
    first = joints[joints["take"] == names[0]]
    grid = {"k": first["k"].to_numpy(), "t": first["t"].to_numpy()}
    if mode == "one_step":
        _, noise = contracts.stacked(contracts.read("process_noise", NOISE), ["w1", "w2", "w3"])
        spread = np.vstack([np.zeros((1, 3)), noise.std(axis=0, ddof=1)])
    else:
        spread = q.std(axis=0, ddof=1)
    tables = [pd.DataFrame(grid | {"source": "recorded", "error": 0.0} | {f"s{j + 1}": spread[:, j] for j in range(3)})]
    for model in models:
        moments = contracts.read("moments", SIMULATE / model)
        error = np.linalg.norm(moments[["m1", "m2", "m3"]].to_numpy() - mean, axis=1)
        tables.append(moments[["k", "t", "s1", "s2", "s3"]].assign(source=model, error=error))
    return pd.concat(tables, ignore_index=True)


def _motion_metrics(deviation: pd.DataFrame, models: list[str]) -> dict:
    # at k = 0 nothing has moved yet
    by_source = {source: rows[rows.k > 0] for source, rows in deviation.groupby("source")}
    recorded = by_source["recorded"]
    metrics = {f"{model}_greatest_mean_error_rad": by_source[model]["error"].max() for model in models}
    for j in (1, 2, 3):
        metrics[f"recorded_std_q{j}_rms_rad"] = root_mean_square(recorded[f"s{j}"].to_numpy())
        for model in models:
            std = by_source[model][f"s{j}"].to_numpy()
            metrics[f"{model}_std_q{j}_rms_rad"] = root_mean_square(std)
            metrics[f"{model}_std_q{j}_correlation_with_recorded"] = correlation(std, recorded[f"s{j}"].to_numpy())
            metrics[f"{model}_std_q{j}_relative_error"] = relative_error(std, recorded[f"s{j}"].to_numpy())
    return metrics


def _filter_errors(model: str, joints: pd.DataFrame) -> pd.DataFrame:
    posterior = contracts.read("posterior", FILTER / model).merge(joints[["take", "k", *JOINTS]], on=["take", "k"])
    errors = {f"e{j}": posterior[f"m{j}"] - posterior[f"q{j}"] for j in (1, 2, 3)}
    spread = {f"s{j}": np.sqrt(posterior[f"c{j}{j}"]) for j in (1, 2, 3)}
    return posterior[["take", "part", "k", "t"]].assign(model=model, **errors, **spread)


def _filter_scores(errors: pd.DataFrame) -> pd.DataFrame:
    """Accuracy, width of the ±1σ bound, and whether the bound follows the error over time, per model and joint."""
    rows = []
    for model, of_model in errors.groupby("model", sort=False):
        for j in (1, 2, 3):
            error, bound = (of_model.pivot(index="take", columns="k", values=f"{name}{j}").to_numpy() for name in "es")
            running, width = np.sqrt(np.mean(error**2, axis=0)), bound.mean(axis=0)
            rows.append(
                {
                    "model": model,
                    "joint": j,
                    "rms_error_rad": root_mean_square(error),
                    "mean_bound_rad": bound.mean(),
                    "coverage_of_the_bound": coverage(error, bound),
                    "bound_greatest_over_least": width.max() / width.min(),
                    "correlation_of_bound_with_error": correlation(width, running),
                    "relative_error_of_bound": relative_error(width, running),
                }
            )
    return pd.DataFrame(rows)


Scores = dict[str, np.ndarray]  # score → (takes,) values, or one value of all takes together


def _one_step_scores(model: str, steps: str) -> Scores:
    """Scores of the predictions of one step, each the mean over the steps of a take: all of them, or those that were to move."""
    table = contracts.read("one_step_scores", EVALUATE / model)
    if steps == "moving":
        table = table[table.moving]
    columns = ["log_density", "log_density_noiseless", "energy", "nees", "log_determinant", "z1", "z2", "z3"]
    log, noiseless, energy, squared, sharpness, *errors = np.moveaxis(contracts.stacked(table, columns)[1], -1, 0)
    scores = {"log_score": log}
    if steps == "moving":
        scores |= {"log_score_without_measurement_noise": noiseless, "ruled_out_without_measurement_noise": _share(np.isneginf, noiseless)}
    scores |= {"energy_score_rad": energy}
    scores |= {f"coverage_of_one_sigma_q{j}": _share(lambda z: np.abs(z) <= 1, error) for j, error in enumerate(errors, 1)}
    return {name: values.mean(axis=1) for name, values in scores.items()} | _consistency(squared, sharpness)


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
    _, mean = contracts.stacked(posterior, ["m1", "m2", "m3"])
    entries = [f"c{min(i, j)}{max(i, j)}" for i in (1, 2, 3) for j in (1, 2, 3)]
    error = mean - contracts.stacked(posterior, list(JOINTS))[1]
    covariance = contracts.stacked(posterior, entries)[1].reshape(*error.shape, 3) + of_pose
    rms = {f"rms_error_q{j}_rad": np.sqrt(np.mean(error[..., j - 1] ** 2, axis=1)) for j in (1, 2, 3)}
    try:
        log, squared, sharpness = normal_log_score(error, covariance), nees(error, covariance), log_determinant(covariance)
    except ModelDomainError as refused:
        print(f"score: the posterior of {model} is not scored as a normal law: {refused}")
        log = squared = sharpness = np.full(error.shape[:2], np.nan)
    return rms | {"log_score": log.mean(axis=1)} | _consistency(squared, sharpness)


def _consistency(squared: np.ndarray, sharpness: np.ndarray) -> Scores:
    """Calibration and sharpness from the NEES (takes, K) of errors of three joints and the log determinant (takes, K) of their law.

    The band of the NEES is for the mean over takes at one step, for takes are independent and steps are not.
    """
    low, high = nees_band(len(squared), 3)
    by_step = squared.mean(axis=0)
    return {
        "coverage_of_the_95_percent_region": _share(lambda x: in_region(x, 3), squared).mean(axis=1),
        "nees": squared.mean(axis=1),
        "share_of_steps_with_nees_in_its_95_percent_band": _share(lambda x: (low <= x) & (x <= high), by_step).mean(),
        "log_determinant": sharpness.mean(axis=1),
    }


def _share(holds: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
    """1 where ``holds`` does, 0 where it does not, and a gap where there is no value."""
    return np.where(np.isnan(values), np.nan, holds(values))


def _compared(scores: dict[str, Scores]) -> pd.DataFrame:
    """Every score of every model, and its paired difference over the takes to the first model with the 95 % interval."""
    first, *_ = scores
    rows = []
    for model, of_model in scores.items():
        for name, values in of_model.items():
            row = {"model": model, "score": name, "mean": values.mean()}
            if model != first and values.ndim:
                difference = paired_difference(values, scores[first][name])
                row |= {"difference": difference.mean, "low": difference.low, "high": difference.high}
            rows.append(row)
    return pd.DataFrame(rows, columns=["model", "score", "mean", "difference", "low", "high"])


def _quality(tables: Path) -> dict:
    """Totals over the takes of what the instruments lost and what was repaired."""
    records = [contracts.read("quality", folder) for folder in (INGEST, TRACK) if contracts.exists("quality", folder)]
    quality = pd.concat(records, ignore_index=True)
    summary = quality.groupby(["instrument", "quantity", "unit"])["value"].agg(["sum", "mean", "min", "max"]).reset_index()
    summary.to_csv(tables / "recording_quality.csv", index=False)
    counted = summary[summary["unit"] == "1"]
    name = counted["instrument"].str.replace(" ", "_") + "_" + counted["quantity"]
    return dict(zip(name, counted["sum"], strict=True))


def _truth(joints: pd.DataFrame, truth: Path) -> dict:
    """How far the measured joint angles are off the true ones, which only a synthetic dataset has."""
    if not contracts.exists("true_joints", truth):
        return {}
    both = joints.merge(contracts.read("true_joints", truth), on=["take", "k"], suffixes=("", "_true"))
    error = both[list(JOINTS)].to_numpy() - both[[f"{q}_true" for q in JOINTS]].to_numpy()
    metrics = {f"tracking_bias_q{j + 1}_rad": error[:, j].mean() for j in range(3)}
    return metrics | {f"tracking_std_q{j + 1}_rad": error[:, j].std() for j in range(3)}
