"""score: tables behind the figures and all numbers of the run, recordings compared with every
model.
"""

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
from pipeline.statistics.scores import (
    Filtered,
    filter_metrics,
    filter_tables,
    sensor_scores,
    training_mean,
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
FITTED = {"ridge": "ridges", "sigma_b_weights": "sigma_b_weights"}  # by model, and of all together
# share of the recorded variance that lies between recordings of one motion
SHARE_BETWEEN = "recorded_share_of_variance_between_recordings"
LONG = ("deviation",)  # a table that no verdict is read from
Tables = dict[str, pd.DataFrame]
Scored = tuple[dict[str, float], Tables]  # numbers, and tables of the report


def run() -> None:
    """Compare every model with the recordings, in mean, in standard deviation and in the filter."""
    settings = config.sections("score")
    with contracts.replacing(OUT) as folder:
        (folder / "tables").mkdir()
        if settings.dataset.robot is None:
            print("score: the dataset has no robot; its forces alone are scored")
            scored = {"motion": ({}, {}), "filter": ({}, {}), "recordings": _quality()}
        else:
            scored = _score_robot(settings, folder)
        metrics = {stem: numbers for stem, (numbers, _) in scored.items()}
        files = {"wrench": WRENCH / "wrench.json"}
        for stage, place in {"fit": FIT, "simulate": FIT, "filter": FILTER}.items():
            own = {model: place / model / f"{stage}.json" for model in settings.models}
            files |= {f"{stage}_{model}": file for model, file in own.items()}
        metrics |= {stem: json.loads(file.read_text()) for stem, file in files.items()}
        for stem, numbers in metrics.items():
            contracts.write_metrics(numbers, folder / f"metrics/{stem}.json")
        tables = {name: table for _, own in scored.values() for name, table in own.items()}
        there = {name: place for name, place in SHOWN.items() if contracts.exists(name, place)}
        tables |= {name: contracts.read(name, place) for name, place in there.items()}
        study = [contracts.read(name, WRENCH) for name in ("wrench_errors", "wrench_spread")]
        for name, table in (tables | {"wrench_study": wrench_summary(*study)}).items():
            table.to_csv(folder / f"tables/{name}.csv", index=False)
        contracts.write_text(_evidence(settings, list(metrics), folder), folder / "evidence.json")


def _score_robot(settings, folder: Path) -> dict[str, Scored]:
    """Write the tables of the figures; return numbers and tables of the motion, of the filters and
    of the recordings.
    """
    models = [model for model in settings.models if contracts.exists("moments", FIT / model)]
    for model in settings.models.keys() - {*models}:
        print(f"score: {model} is left out: the recordings give it no fit")
    for name, together in FITTED.items():
        kept = [model for model in settings.models if contracts.exists(name, FIT / model)]
        parts = [contracts.read(name, FIT / model).assign(model=model) for model in kept]
        if parts:
            contracts.write(pd.concat(parts, ignore_index=True), together, folder)
    joints = contracts.read("joints", TRACK)
    takes, q = contracts.stacked(joints[joints.part == "training"], "q")
    scored = {
        "motion": _score_motion(models, takes, q, settings),
        "filter": _score_filters(models, q, joints, settings, folder),
        "recordings": _score_recordings(joints, q, settings),
    }
    contracts.write(scored["motion"][1]["deviation"], "deviation", folder)
    return scored


def _score_motion(models: list[str], takes: list[str], q: np.ndarray, settings) -> Scored:
    """Mean error and standard deviation over time of every model beside what was recorded; with
    one-step realisations their comparison at the recorded level of noise.
    """
    names, mode = settings.dataset.robot.joints, settings.simulation.mode
    _, noise = contracts.stacked(contracts.read("process_noise", TRACK), "w")
    error, std = {}, {"recorded": recorded_deviation(q, noise, mode)}
    for model in models:
        moments = contracts.read("moments", FIT / model)
        error[model] = np.linalg.norm(values(moments, "m") - q.mean(axis=0), axis=1)
        std[model] = values(moments, "s")
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    rows = [
        grid.assign(source=source, error=error.get(source, 0.0), **spread("s", names, own))
        for source, own in std.items()
    ]
    tables = {"deviation": pd.concat(rows, ignore_index=True)}
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
        tables |= curves.spread_tables(modelled, following, noise, names)
    return curves.std_scores(std, error, names) | metrics, tables


def _modelled(
    models: list[str], steady: np.ndarray, settings
) -> tuple[dict[str, curves.ModelledNoise], Tables]:
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
    models: list[str], training: np.ndarray, joints: pd.DataFrame, settings, folder: Path
) -> Scored:
    """Errors and bounds of every filter, and its posterior as a law of the measured pose, beside
    no filter and the linear one of the training takes.
    """
    dataset, names = settings.dataset, settings.dataset.robot.joints
    places = {model: FILTER / model for model in models}
    places |= {closed(model): FILTER / model / FOLDER for model in models}
    places = {name: place for name, place in places.items() if contracts.exists("posterior", place)}
    if not places:
        return {}, {}
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
    filters = {NONE: training_mean(training, q), MEMORY: Filtered(means - q, covariances, pose)}
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
    metrics = filter_metrics(filters, names, constant_speed(training))
    return metrics | {"axes_of_training_steps_without_spread": without}, compared


def _pose_covariances(training: np.ndarray, settings) -> tuple[np.ndarray, np.ndarray]:
    """(n, n) rad² each, noise of one measured pose: half the covariance of steps at rest, as ω
    holds the noise of two; and in a closed loop the covariance of poses at rest.
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


def _score_recordings(joints: pd.DataFrame, training: np.ndarray, settings) -> Scored:
    """Losses and repairs, noise of the depth camera, its dependence on the state, and errors of the
    tracked angles where there is a truth.
    """
    names, (metrics, tables) = settings.dataset.robot.joints, _quality()
    takes, counts = contracts.read("takes", TRACK), contracts.read("quality", MOTION)
    tables["takes"] = quality.side_by_side(takes)
    tables["kept"] = quality.account(map(pd.read_csv, sorted(FILES.glob("*.csv"))), counts, takes)
    if contracts.exists("kinect_noise", ARTICULATE):
        noise = contracts.read("kinect_noise", ARTICULATE)
        everywhere = noise[noise["take"] == "none"]
        variance = np.diagonal(matrices(everywhere, "r", names), axis1=1, axis2=2)
        number = noise["take"].nunique() - 1
        metrics |= sensor_scores(values(everywhere, "b"), variance, number, names)
        errors = depth_noise.errors_of(contracts.read("angles", ARTICULATE), joints)
        moving = depth_noise.deviations(errors, joints)
        pose, dt = _pose_covariances(training, settings)[0], 1 / settings.dataset.motion.rate
        metrics |= depth_noise.slope_scores(depth_noise.error_slopes(moving, dt, pose))
    truth = truth_of(settings.dataset)
    if contracts.exists("true_joints", truth):  # which synthetic data alone have
        both = joints.merge(contracts.read("true_joints", truth), on=["take", "k"])
        ends = (both[[f"{column}{end}" for column in columns("q", names)]] for end in ("_x", "_y"))
        errors = dict(zip(names, np.subtract(*(each.to_numpy() for each in ends)).T, strict=True))
        metrics |= {f"tracking_bias_{name}_rad": error.mean() for name, error in errors.items()}
        metrics |= {f"tracking_std_{name}_rad": error.std() for name, error in errors.items()}
    return metrics, tables


def _quality() -> Scored:
    """Sums of what the instruments lost and what was repaired, summed up over the takes."""
    folders = [*sorted(INGEST.iterdir()), TRACK]
    records = [contracts.read("quality", p) for p in folders if contracts.exists("quality", p)]
    summary = quality.summarised(pd.concat(records, ignore_index=True))
    return quality.metrics(summary), {"recording_quality": summary}


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
