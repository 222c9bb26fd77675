"""score: recordings against models, as the tables behind the figures and the numbers the paper
states; all numbers of the run in one file, so that datasets stand side by side.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
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
from pipeline.perception.depth_noise import deviations, error_slopes, errors_of, slope_scores
from pipeline.recordings import quality
from pipeline.recordings.commands import commanded_steps, constant_speed
from pipeline.recordings.quality import account
from pipeline.recordings.steps import held_against, training_steps, truth_of
from pipeline.statistics.curves import (
    ModelledNoise,
    constant_noise_variation,
    following_tests,
    spread_tables,
    std_scores,
)
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
ARTICULATE, READINGS = Path("data/articulate"), Path("data/readings")
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
        for stem, file in _metrics_of_stages(settings.models):
            metrics[stem] = json.loads(file.read_text(encoding="utf-8"))
        for stem, numbers in metrics.items():
            contracts.write_metrics(numbers, folder / f"metrics/{stem}.json")
        for name, place in SHOWN.items():
            if contracts.exists(name, place):
                contracts.read(name, place).to_csv(tables / f"{name}.csv", index=False)
        study = [contracts.read(name, WRENCH) for name in ("wrench_errors", "wrench_spread")]
        wrench_summary(*study).to_csv(tables / "wrench_study.csv", index=False)
        _write_evidence(settings, list(metrics), folder)


def _metrics_of_stages(models: Iterable[str]) -> Iterator[tuple[str, Path]]:
    """Yield the name and file of the numbers that the stages before this one wrote."""
    yield "wrench", WRENCH / "wrench.json"
    for stage, place in {"fit": FIT, "simulate": FIT, "filter": FILTER}.items():
        for model in models:
            yield f"{stage}_{model}", place / model / f"{stage}.json"


def _score_robot(settings, folder: Path, tables: Path) -> dict[str, dict[str, float]]:
    """Return the numbers of the motion, of the filters and of the recordings."""
    models, names = list(settings.models), settings.dataset.robot.joints
    models = [model for model in models if contracts.exists("moments", FIT / model)]
    for model in settings.models.keys() - {*models}:
        print(f"score: {model} is left out: the recordings give it no fit")
    joints = contracts.read("joints", TRACK)
    metrics = {
        "motion": _score_motion(models, names, joints, settings, folder, tables),
        "filter": _score_filters(models, names, joints, settings, folder, tables),
    }
    for name, together in (("ridge", "ridges"), ("sigma_b_weights", "sigma_b_weights")):
        tables_of = [
            contracts.read(name, FIT / model).assign(model=model)
            for model in settings.models
            if contracts.exists(name, FIT / model)
        ]
        if tables_of:
            contracts.write(pd.concat(tables_of, ignore_index=True), together, folder)
    takes = contracts.read("takes", TRACK)
    quality.side_by_side(takes).to_csv(tables / "takes.csv", index=False)
    files, counts = sorted(FILES.glob("*.csv")), contracts.read("quality", INGEST / "motion")
    account(map(pd.read_csv, files), counts, takes).to_csv(tables / "kept.csv", index=False)
    recordings = _quality(tables) | _kinect(joints, names, settings)
    return metrics | {"recordings": recordings | _truth(joints, names, settings)}


def _score_motion(models, names, joints, settings, folder: Path, tables: Path) -> dict[str, float]:
    """Mean error and standard deviation over time of every model beside what was recorded; with
    one-step realisations their comparison at the recorded level of noise.
    """
    takes, q = contracts.stacked(joints[joints.part == "training"], "q")
    _, noise = contracts.stacked(contracts.read("process_noise", TRACK), "w")
    mode = settings.simulation.mode
    rows, errors, std = [], {}, {"recorded": recorded_deviation(q, noise, mode)}
    for model in models:
        moments = contracts.read("moments", FIT / model)
        errors[model] = np.linalg.norm(values(moments, "m") - q.mean(axis=0), axis=1)
        std[model] = values(moments, "s")
    for source, deviation in std.items():
        step = {"k": moments["k"], "t": moments["t"], "source": source}
        step["error"] = errors.get(source, 0.0)
        rows.append(pd.DataFrame(step | spread("s", names, deviation)))
    deviation = pd.concat(rows, ignore_index=True)
    contracts.write(deviation, "deviation", folder)
    deviation.to_csv(tables / "deviation.csv", index=False)
    # at k = 0 nothing has moved yet
    std = {source: deviation[1:] for source, deviation in std.items()}
    errors = {model: error[1:] for model, error in errors.items()}
    metrics = {
        f"recorded_lag_one_correlation_{name}": lag_one_correlation(noise[..., j])
        for j, name in enumerate(names)
    }
    stream = rng.stream(settings.seed, "score.constant_noise")
    for name, limit in zip(names, constant_noise_variation(noise, stream), strict=True):
        metrics[f"recorded_std_{name}_variation_of_constant_noise"] = limit
    metrics["recorded_takes"] = len(noise)
    metrics[SHARE_BETWEEN] = share_between(noise, [take.rpartition("_")[0] for take in takes])
    steady = constant_speed(q)
    if mode == "one_step":
        modelled, following = _modelled(models, steady, settings)
        # a model without a level has no spread that could be compared
        std = {"recorded": std["recorded"]} | {name: each.std for name, each in modelled.items()}
        for name, table in spread_tables(modelled, following, noise, names).items():
            table.to_csv(tables / f"{name}.csv", index=False)
    return std_scores(std, errors, names, steady) | metrics


def _modelled(
    models, steady: np.ndarray, settings
) -> tuple[dict[str, ModelledNoise], dict[str, pd.DataFrame]]:
    """The noise at the recorded level of every model that has one, and the test of whether it is
    followed; why the others have none is printed.
    """
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    modelled, following = {}, {}
    for model in models:
        stream = rng.stream(settings.seed, f"score.following.{model}")
        try:
            noise = modelled_noise(fitted_model(FIT / model), recorded, stream)
        except ModelDomainError as error:
            print(f"score: {model} has no spread at the recorded level: {error}")
            continue
        following[model] = following_tests(noise, recorded.noise, steady, recorded.joints, stream)
        modelled[model] = noise
    return modelled, following


def _score_filters(models, names, joints, settings, folder: Path, tables: Path) -> dict[str, float]:
    """Errors and bounds of every filter, and its posterior as a law of the measured pose, beside
    those of no filter and of the linear one of the training takes.
    """
    metrics = {}
    places = {model: FILTER / model for model in models}
    places |= {closed(model): FILTER / model / FOLDER for model in models}
    places = {name: place for name, place in places.items() if contracts.exists("posterior", place)}
    if places:
        measured, true = held_against(joints, settings.dataset)
        measured = measured[["take", "k", *columns("q", names)]]
        posteriors = {
            name: contracts.read("posterior", place).merge(measured, on=["take", "k"])
            for name, place in places.items()
        }
        steps = next(iter(posteriors.values()))
        _, training = contracts.stacked(joints[joints.part == "training"], "q")
        takes, q = contracts.stacked(steps, "q")
        pose, held = _pose_covariances(joints, settings)
        frames = {take.take: take for take in measured_takes(settings.dataset)}
        dt, own = 1 / settings.dataset.motion.rate, [frames[take] for take in takes]
        chain = chain_of(settings.dataset.robot)
        filtered = autocorrelated_filter(training, pose, own, dt, chain)
        means, covariances, without = filtered
        # what is true has no noise that a bound would have to hold
        pose, held = (0 * pose, 0 * held) if true else (pose, held)
        filters = {NONE: no_filter(training, q), MEMORY: Filtered(means - q, covariances, pose)}
        filters |= {
            name: Filtered(
                (values(posterior, "m") - values(posterior, "q")).reshape(q.shape),
                matrices(posterior, "c", names).reshape(*q.shape, len(names)),
                pose if name in models else held,
            )
            for name, posterior in posteriors.items()
        }
        step = steps[["take", "part", "k", "t"]]
        errors = [
            step.assign(model=name, **spread("e", names, f.error), **spread("s", names, f.bound))
            for name, f in filters.items()
        ]
        contracts.write(pd.concat(errors, ignore_index=True), "filter_error", folder)
        stream = rng.stream(settings.seed, "score.bounds")
        compared, refusals = filter_tables(filters, names, constant_speed(training), stream)
        for refusal in refusals:
            print(f"score: {refusal}")
        for name, table in compared.items():
            table.to_csv(tables / f"{name}.csv", index=False)
        metrics = filter_metrics(compared["filter_scores"])
        metrics["axes_of_training_steps_without_spread"] = without
    return metrics


def _pose_covariances(joints: pd.DataFrame, settings) -> tuple[np.ndarray, np.ndarray]:
    """(n, n) rad² each, noise of one measured pose: half the covariance of steps at rest, as ω
    holds the noise of two; and to a closed loop that of poses at rest.
    """
    if (stated := settings.dataset.motion.pose_noise) is not None:
        pose = stated**2 * np.eye(len(settings.dataset.robot.joints))
        return pose, pose
    trajectory = contracts.read("trajectory", INGEST / "motion")
    _, training = contracts.stacked(joints[joints.part == "training"], "q")
    _, noise = contracts.stacked(contracts.read("process_noise", TRACK), "w")
    try:
        v = commanded_steps(trajectory, settings.dataset.motion.rate)
        return measurement_covariance(noise, v) / 2, rest_covariance(training, v)
    except ModelDomainError as error:
        print(f"score: the noise of a measured pose counts as none: {error}")
        return tuple(np.zeros((2, *(noise.shape[-1],) * 2)))


def _quality(tables: Path) -> dict[str, float]:
    """Sums of what the instruments lost and what was repaired, summed up over the takes."""
    folders = [*sorted(INGEST.iterdir()), TRACK]
    records = [contracts.read("quality", p) for p in folders if contracts.exists("quality", p)]
    summary = quality.summarised(pd.concat(records, ignore_index=True))
    summary.to_csv(tables / "recording_quality.csv", index=False)
    return quality.metrics(summary)


def _kinect(joints: pd.DataFrame, names: list[str], settings) -> dict[str, float]:
    """The scores of the depth camera's noise, where there is one, and how its errors depend on the
    state.
    """
    if not contracts.exists("kinect_noise", ARTICULATE):
        return {}
    noise = contracts.read("kinect_noise", ARTICULATE)
    everywhere = noise[noise["take"] == "none"]
    variance = np.diagonal(matrices(everywhere, "r", names), axis1=1, axis2=2)
    takes = noise["take"].nunique() - 1
    scores = sensor_scores(values(everywhere, "b"), variance, takes, names)
    errors = deviations(errors_of(contracts.read("angles", ARTICULATE), joints), joints)
    step = 1 / settings.dataset.motion.rate
    return scores | slope_scores(error_slopes(errors, step, _pose_covariances(joints, settings)[0]))


def _truth(joints: pd.DataFrame, names: list[str], settings) -> dict[str, float]:
    """Errors of measured joint angles against the true ones, which synthetic data alone have."""
    truth = truth_of(settings.dataset)
    if not contracts.exists("true_joints", truth):
        return {}
    both = joints.merge(
        contracts.read("true_joints", truth), on=["take", "k"], suffixes=("", ":true")
    )
    true = both[[f"{column}:true" for column in columns("q", names)]].to_numpy()
    error = dict(zip(names, (both[columns("q", names)].to_numpy() - true).T, strict=True))
    bias = {f"tracking_bias_{name}_rad": values.mean() for name, values in error.items()}
    return bias | {f"tracking_std_{name}_rad": values.std() for name, values in error.items()}


def _write_evidence(settings, stems: Sequence[str], folder: Path) -> None:
    """Write every metric and every short table of the run into one committed file."""
    models = {name: options.kind for name, options in settings.models.items()}
    metrics = {stem: json.loads((folder / f"metrics/{stem}.json").read_text()) for stem in stems}
    csv = [file for file in sorted(folder.glob("tables/*.csv")) if file.stem not in LONG]
    tables = {file.stem: pd.read_csv(file) for file in csv}
    dataset = settings.dataset
    here = Run(
        dataset=dataset.name,
        scale=settings.scale.name,
        # a synthetic dataset alone has a place for what is true
        synthetic=truth_of(dataset).is_dir(),
        joints=list(dataset.robot.joints) if dataset.robot else [],
        task=members(contracts.read("trajectory", INGEST / "motion"), "v") if dataset.robot else [],
        models=models,
        metrics=metrics,
        tables=tables,
    )
    contracts.write_text(here.to_json(), folder / "evidence.json")
