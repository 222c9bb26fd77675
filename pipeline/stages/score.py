"""score: tables behind the figures and all numbers of the run, recordings compared with every
model.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.arm.model import chain_of
from pipeline.core import config, contracts, rng
from pipeline.core.columns import columns, matrices, members, spread, values
from pipeline.core.errors import ModelDomainError
from pipeline.core.filters import MEMORY, NONE, closed
from pipeline.filtering.instruments import measured_takes
from pipeline.filtering.linear import autocorrelated_filter
from pipeline.models.closed_loop import FOLDER
from pipeline.models.kinds import fitted_model
from pipeline.models.noise import measurement_covariance, recorded_deviation, rest_covariance
from pipeline.models.prediction import modelled_noise
from pipeline.perception import depth_noise
from pipeline.recordings import quality
from pipeline.recordings.commands import commanded_steps, constant_speed
from pipeline.recordings.steps import held_against, training_steps, truth_of
from pipeline.statistics import curves
from pipeline.statistics.filters import (
    Filtered,
    filter_metrics,
    filter_tables,
    no_filter,
    sensor_scores,
)
from pipeline.statistics.takes import lag_one_correlation, share_between, wrench_summary
from pipeline.verdicts.run import Run

FILES, INGEST, TRACK = Path("data/files"), Path("data/ingest"), Path("data/track")
MOTION, ARTICULATE, READINGS = INGEST / "motion", Path("data/articulate"), Path("data/readings")
FIT, FILTER, WRENCH = Path("data/fit"), Path("data/filter"), Path("data/wrench")
OUT = Path("data/score")
# tables that the report shows as they are
SHOWN = dict.fromkeys(("sigma_s", "force_moments", "force_test"), WRENCH) | {"readings": READINGS}
PREDICTED = (
    *("ranges", "predictions", "prediction_pairs", "other_motions", "motion_spread", "tails"),
    *("noise_quantiles", "plain_parameters", "untold", "motions", "motion_ranges"),
)
SHOWN |= dict.fromkeys(PREDICTED, Path("data/predict"))
# share of the recorded variance that lies between recordings of one motion
SHARE_BETWEEN = "recorded_share_of_variance_between_recordings"
LONG = ("deviation",)  # a table that no verdict is read from


def run() -> None:
    """Compare every model with the recordings, in mean, in standard deviation and in the filter."""
    settings = config.sections("score")
    with contracts.replacing(OUT) as folder:
        tables = folder / "tables"
        tables.mkdir()
        if settings.dataset.robot is None:
            print("score: the dataset has no robot; its forces alone are scored")
            metrics = {"motion": {}, "filter": {}, "recordings": _quality(tables)}
        else:
            metrics = _score_robot(settings, folder, tables)
        files = {"wrench": WRENCH / "wrench.json"}
        for stage, place in {"fit": FIT, "simulate": FIT, "filter": FILTER}.items():
            files |= {
                f"{stage}_{model}": place / model / f"{stage}.json" for model in settings.models
            }
        metrics |= {stem: json.loads(file.read_text()) for stem, file in files.items()}
        for stem, numbers in metrics.items():
            contracts.write_metrics(numbers, folder / f"metrics/{stem}.json")
        for name, place in SHOWN.items():
            if contracts.exists(name, place):
                contracts.read(name, place).to_csv(tables / f"{name}.csv", index=False)
        study = [contracts.read(name, WRENCH) for name in ("wrench_errors", "wrench_spread")]
        wrench_summary(*study).to_csv(tables / "wrench_study.csv", index=False)
        contracts.write_text(_evidence(settings, list(metrics), folder), folder / "evidence.json")


def _score_robot(settings, folder: Path, tables: Path) -> dict[str, dict[str, float]]:
    """Return the numbers of the motion, of the filters and of the recordings."""
    models = [model for model in settings.models if contracts.exists("moments", FIT / model)]
    for model in settings.models.keys() - {*models}:
        print(f"score: {model} is left out: the recordings give it no fit")
    joints, names = contracts.read("joints", TRACK), settings.dataset.robot.joints
    takes, q = contracts.stacked(joints[joints.part == "training"], "q")
    metrics = {
        "motion": _score_motion(models, takes, q, settings, folder, tables),
        "filter": _score_filters(models, q, joints, settings, folder, tables),
    }
    for name, together in (("ridge", "ridges"), ("sigma_b_weights", "sigma_b_weights")):
        kept = [model for model in settings.models if contracts.exists(name, FIT / model)]
        parts = [contracts.read(name, FIT / model).assign(model=model) for model in kept]
        if parts:
            contracts.write(pd.concat(parts, ignore_index=True), together, folder)
    takes, counts = contracts.read("takes", TRACK), contracts.read("quality", MOTION)
    quality.side_by_side(takes).to_csv(tables / "takes.csv", index=False)
    kept = quality.account(map(pd.read_csv, sorted(FILES.glob("*.csv"))), counts, takes)
    kept.to_csv(tables / "kept.csv", index=False)
    metrics["recordings"] = _quality(tables) | _kinect(joints, q, names, settings)
    truth = truth_of(settings.dataset)
    if contracts.exists("true_joints", truth):  # which synthetic data alone have
        both = joints.merge(contracts.read("true_joints", truth), on=["take", "k"])
        ends = (both[[f"{column}{end}" for column in columns("q", names)]] for end in ("_x", "_y"))
        errors = dict(zip(names, np.subtract(*(each.to_numpy() for each in ends)).T, strict=True))
        bias = {f"tracking_bias_{name}_rad": error.mean() for name, error in errors.items()}
        std = {f"tracking_std_{name}_rad": error.std() for name, error in errors.items()}
        metrics["recordings"] |= bias | std
    return metrics


def _score_motion(
    models: list[str], takes: list[str], q: np.ndarray, settings, folder: Path, tables: Path
) -> dict[str, float]:
    """Mean error and standard deviation over time of every model beside what was recorded; with
    one-step realisations their comparison at the recorded level of noise.
    """
    names, mode = settings.dataset.robot.joints, settings.simulation.mode
    _, noise = contracts.stacked(contracts.read("process_noise", TRACK), "w")
    moments = {model: contracts.read("moments", FIT / model) for model in models}
    mean = {model: values(own, "m") for model, own in moments.items()}
    error = {model: np.linalg.norm(own - q.mean(axis=0), axis=1) for model, own in mean.items()}
    std = {"recorded": recorded_deviation(q, noise, mode)}
    std |= {model: values(own, "s") for model, own in moments.items()}
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    rows = [
        grid.assign(source=source, error=error.get(source, 0.0), **spread("s", names, own))
        for source, own in std.items()
    ]
    deviation = pd.concat(rows, ignore_index=True)
    contracts.write(deviation, "deviation", folder)
    deviation.to_csv(tables / "deviation.csv", index=False)
    # at k = 0 nothing has moved yet
    std = {source: own[1:] for source, own in std.items()}
    error = {model: own[1:] for model, own in error.items()}
    stream = rng.stream(settings.seed, "score.constant_noise")
    limits = curves.constant_noise_variation(noise, stream)
    metrics = {
        f"recorded_lag_one_correlation_{name}": lag_one_correlation(noise[..., j])
        for j, name in enumerate(names)
    }
    for name, limit in zip(names, limits, strict=True):
        metrics[f"recorded_std_{name}_variation_of_constant_noise"] = limit
    metrics["recorded_takes"] = len(noise)
    metrics[SHARE_BETWEEN] = share_between(noise, [take.rpartition("_")[0] for take in takes])
    steady = constant_speed(q)
    if mode == "one_step":
        modelled, following = _modelled(models, steady, settings)
        # a model without a level has no spread that could be compared
        std = {"recorded": std["recorded"]} | {name: own.std for name, own in modelled.items()}
        compared = curves.spread_tables(modelled, following, noise, names)
        for name, table in compared.items():
            table.to_csv(tables / f"{name}.csv", index=False)
    return curves.std_scores(std, error, names) | metrics


def _modelled(
    models: list[str], steady: np.ndarray, settings
) -> tuple[dict[str, curves.ModelledNoise], dict[str, pd.DataFrame]]:
    """Noise of every model at the recorded level, and the test that the recordings follow it."""
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    modelled, following = {}, {}
    for model in models:
        stream = rng.stream(settings.seed, f"score.following.{model}")
        try:
            noise = modelled_noise(fitted_model(FIT / model), recorded, stream)
        except ModelDomainError as error:
            print(f"score: {model} has no spread at the recorded level: {error}")
            continue
        test = (noise, recorded.noise, steady, recorded.joints, stream)
        modelled[model], following[model] = noise, curves.following_tests(*test)
    return modelled, following


def _score_filters(
    models: list[str], training: np.ndarray, joints: pd.DataFrame, settings, folder, tables: Path
) -> dict[str, float]:
    """Errors and bounds of every filter, and its posterior as a law of the measured pose, beside
    those of no filter and of the linear one of the training takes.
    """
    dataset, names = settings.dataset, settings.dataset.robot.joints
    places = {model: FILTER / model for model in models}
    places |= {closed(model): FILTER / model / FOLDER for model in models}
    places = {name: place for name, place in places.items() if contracts.exists("posterior", place)}
    if not places:
        return {}
    measured, true = held_against(joints, dataset)
    measured = measured[["take", "k", *columns("q", names)]]
    posteriors = {
        name: contracts.read("posterior", place).merge(measured, on=["take", "k"])
        for name, place in places.items()
    }
    steps = next(iter(posteriors.values()))
    takes, q = contracts.stacked(steps, "q")
    pose, held = _pose_covariances(training, settings)
    frames = {take.take: take for take in measured_takes(dataset)}
    own, dt = [frames[take] for take in takes], 1 / dataset.motion.rate
    filtered = autocorrelated_filter(training, pose, own, dt, chain_of(dataset.robot))
    means, covariances, without = filtered
    # what is true has no noise that a bound would have to hold
    pose, held = (0 * pose, 0 * held) if true else (pose, held)
    filters = {NONE: no_filter(training, q), MEMORY: Filtered(means - q, covariances, pose)}
    for name, posterior in posteriors.items():
        error = (values(posterior, "m") - values(posterior, "q")).reshape(q.shape)
        covariance = matrices(posterior, "c", names).reshape(*q.shape, len(names))
        filters[name] = Filtered(error, covariance, pose if name in models else held)
    step = steps[["take", "part", "k", "t"]]
    errors = [
        step.assign(model=name, **spread("e", names, f.error), **spread("s", names, f.bound))
        for name, f in filters.items()
    ]
    contracts.write(pd.concat(errors, ignore_index=True), "filter_error", folder)
    stream = rng.stream(settings.seed, "score.bounds")
    compared, refusals = filter_tables(filters, names, stream)
    for refusal in refusals:
        print(f"score: {refusal}")
    for name, table in compared.items():
        table.to_csv(tables / f"{name}.csv", index=False)
    metrics = filter_metrics(filters, names, constant_speed(training))
    return metrics | {"axes_of_training_steps_without_spread": without}


def _pose_covariances(training: np.ndarray, settings) -> tuple[np.ndarray, np.ndarray]:
    """(n, n) rad² each, noise of one measured pose: half the covariance of steps at rest, as ω
    holds the noise of two; and to a closed loop that of poses at rest.
    """
    size, motion = training.shape[-1], settings.dataset.motion
    if motion.pose_noise is not None:
        return (motion.pose_noise**2 * np.eye(size),) * 2
    _, noise = contracts.stacked(contracts.read("process_noise", TRACK), "w")
    try:
        v = commanded_steps(contracts.read("trajectory", MOTION), motion.rate)
        return measurement_covariance(noise, v) / 2, rest_covariance(training, v)
    except ModelDomainError as error:
        print(f"score: the noise of a measured pose counts as none: {error}")
        return (np.zeros((size, size)),) * 2


def _quality(tables: Path) -> dict[str, float]:
    """Sums of what the instruments lost and what was repaired, summed up over the takes."""
    folders = [*sorted(INGEST.iterdir()), TRACK]
    records = [contracts.read("quality", p) for p in folders if contracts.exists("quality", p)]
    summary = quality.summarised(pd.concat(records, ignore_index=True))
    summary.to_csv(tables / "recording_quality.csv", index=False)
    return quality.metrics(summary)


def _kinect(
    joints: pd.DataFrame, training: np.ndarray, names: list[str], settings
) -> dict[str, float]:
    """Scores of the depth camera's noise, and the dependence of its errors on the state."""
    if not contracts.exists("kinect_noise", ARTICULATE):
        return {}
    noise = contracts.read("kinect_noise", ARTICULATE)
    everywhere = noise[noise["take"] == "none"]
    variance = np.diagonal(matrices(everywhere, "r", names), axis1=1, axis2=2)
    takes = noise["take"].nunique() - 1
    scores = sensor_scores(values(everywhere, "b"), variance, takes, names)
    errors = depth_noise.errors_of(contracts.read("angles", ARTICULATE), joints)
    errors, pose = depth_noise.deviations(errors, joints), _pose_covariances(training, settings)[0]
    slopes = depth_noise.error_slopes(errors, 1 / settings.dataset.motion.rate, pose)
    return scores | depth_noise.slope_scores(slopes)


def _evidence(settings, stems: list[str], folder: Path) -> str:
    """Every metric and every short table of the run as JSON."""
    dataset, csv = settings.dataset, sorted(folder.glob("tables/*.csv"))
    robot = dataset.robot
    return Run(
        dataset=dataset.name,
        scale=settings.scale.name,
        # a synthetic dataset alone has a place for what is true
        synthetic=truth_of(dataset).is_dir(),
        joints=robot.joints if robot else [],
        task=members(contracts.read("trajectory", MOTION), "v") if robot else [],
        models={name: options.kind for name, options in settings.models.items()},
        metrics={s: json.loads((folder / f"metrics/{s}.json").read_text()) for s in stems},
        tables={file.stem: pd.read_csv(file) for file in csv if file.stem not in LONG},
    ).to_json()
