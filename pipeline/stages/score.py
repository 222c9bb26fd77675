"""score: recordings compared with every model: tables behind the figures, numbers of the run."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.columns import matrices, members, spread, values
from pipeline.core.filters import closed
from pipeline.core.options.dataset import Dataset
from pipeline.evidence.case import Camera, Choices, Recordings, Takes, recorded_takes
from pipeline.evidence.instruments import wrench_evidence
from pipeline.evidence.motion import Outcome, prediction_evidence
from pipeline.evidence.outcomes import (
    PosteriorMoments,
    case_evidence,
    compare_noise,
    pose_covariances,
)
from pipeline.evidence.step_noise import run_evidence
from pipeline.filtering.measurement import measured_takes
from pipeline.models.closed_loop import FOLDER
from pipeline.models.kinds import fitted_model
from pipeline.models.steps import recorded_deviation
from pipeline.perception import depth_noise
from pipeline.recordings import quality
from pipeline.recordings.commands import speed_scores
from pipeline.recordings.inventory import by_place
from pipeline.recordings.steps import truth_of
from pipeline.statistics.scores import Filtered
from pipeline.statistics.takes import wrench_summary
from pipeline.verdicts.run import Run, project_version

FILES = Path("data/files")
INGEST = Path("data/ingest")
TRACK = Path("data/track")
MOTION = INGEST / "motion"
ARTICULATE = Path("data/articulate")
READINGS = Path("data/readings")
FIT = Path("data/fit")
FILTER = Path("data/filter")
WRENCH = Path("data/wrench")
PREDICT = Path("data/predict")
OUT = Path("data/score")
ONLY_DRAWN = "held_out_run"  # table of a figure that no page prints
# tables that the report shows unchanged
OF_WRENCH = (
    "sigma_s",
    "force_moments",
    "force_test",
)
# one model: all models
FITTED = {
    "ridge": "ridges",
    "sigma_b_weights": "sigma_b_weights",
    "sigma_b_floors": "sigma_b_floors",
}
FLOORS = "sigma_b_floors"  # of these the one that the report shows
EVIDENCE = "evidence"
WITHIN_RUNS = "noise_by_speed"  # table of logs without a robot
Tables = dict[str, pd.DataFrame]
Scored = tuple[dict[str, float], Tables]  # numbers, and tables of the report


def run() -> None:
    """Compare every model with the recordings, in mean, in standard deviation and in the filter."""
    settings = config.sections("score")
    with contracts.replacing(OUT) as folder:
        if settings.dataset.robot is None:
            print(
                "score: the dataset has no robot; only its logs and forces are scored",
            )
            scored = {
                "motion": ({}, {}),
                "filter": ({}, {}),
                "recordings": ({}, _quality()),
            }
        else:
            scored = _score_robot(settings, folder)
        metrics = {stem: numbers for stem, (numbers, _) in scored.items()}
        metrics |= _metrics_of_stages(list(settings.models))
        tables = _tables(scored, folder)
        contracts.write(tables[EVIDENCE], EVIDENCE, folder)
        for stem, numbers in metrics.items():
            contracts.write_metrics(numbers, folder / f"metrics/{stem}.json")
        for name, table in tables.items():
            text = table.to_csv(index=False)
            contracts.write_text(text, folder / f"tables/{name}.csv")
        result = _result(settings, metrics, tables)
        contracts.write_text(result.to_json(), folder / "evidence.json")


def _metrics_of_stages(models: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the numbers that the stages wrench, fit and filter wrote."""
    files = {"wrench": WRENCH / "wrench.json"}
    files |= {f"fit_{model}": FIT / model / "fit.json" for model in models}
    files |= {f"filter_{model}": FILTER / model / "filter.json" for model in models}
    return {stem: json.loads(file.read_text()) for stem, file in files.items()}


def _tables(scored: dict[str, Scored], folder: Path) -> Tables:
    """Return the tables of the report: those ``scored``, and tables of the earlier stages."""
    tables: Tables = {}
    evidence = []
    for _, more in scored.values():
        evidence += [table for name, table in more.items() if name == EVIDENCE]
        tables |= {name: table for name, table in more.items() if name != EVIDENCE}
    tables |= _read_all(READINGS) | _read_all(PREDICT)
    tables.pop(ONLY_DRAWN, None)
    wrench = _read_all(WRENCH)
    tables |= {name: wrench[name] for name in OF_WRENCH if name in wrench}
    if listed := _listed_files():
        tables["raw_files"] = by_place(pd.concat(listed))
    errors = wrench["wrench_errors"]
    repeats = wrench["wrench_spread"]
    tables["wrench_study"] = wrench_summary(errors, repeats)
    if contracts.exists(FLOORS, folder):
        tables[FLOORS] = contracts.read(FLOORS, folder)
    if "prediction_pairs" in tables:
        pairs = tables["prediction_pairs"]
        evidence.append(prediction_evidence(tables["predictions"], pairs))
    if WITHIN_RUNS in tables:
        evidence.append(run_evidence(tables[WITHIN_RUNS]))
    evidence.append(wrench_evidence(wrench))
    tables[EVIDENCE] = pd.concat(evidence, ignore_index=True)
    return tables


def _result(settings, metrics: dict[str, dict], tables: Tables) -> Run:
    """Return the result of the run, which the report compares with other datasets."""
    dataset = settings.dataset
    joints = []
    task = []
    if WITHIN_RUNS in tables:
        joints = [*tables[WITHIN_RUNS]["joint"]]
    if dataset.robot is not None:
        joints = dataset.robot.joints
        task = members(contracts.read("trajectory", MOTION), "v")
    return Run(
        dataset=dataset.name,
        scale=settings.scale.name,
        synthetic=truth_of(dataset).is_dir(),  # only a synthetic dataset has a truth
        joints=joints,
        task=task,
        models={name: options.kind for name, options in settings.models.items()},
        metrics=metrics,
        tables=tables,
        cause=(dataset.laboratory or {}).get("cause") or "",
        version=project_version(),
    )


def _listed_files() -> list[pd.DataFrame]:
    """Return the lists of raw files by part."""
    return [pd.read_csv(file) for file in sorted(FILES.glob("*.csv"))]


def _score_robot(settings, folder: Path) -> dict[str, Scored]:
    """Write the tables of the figures; return the scores of motion, filters and recordings."""
    models = [
        model for model in settings.models if contracts.exists("moments", FIT / model)
    ]
    for model in settings.models.keys() - {*models}:
        print(f"score: {model} is left out: it has no fit to the recordings")
    _write_fitted(list(settings.models), folder)
    mode = settings.simulation.mode
    recordings, metrics = _recordings(settings)
    takes = recordings.takes
    moments = {model: contracts.read("moments", FIT / model) for model in models}
    outcomes = {}
    for model in models:
        outcomes[model] = _fitted_outcome(model, moments[model])
        if mode == "one_step":
            compare_noise(model, outcomes[model], recordings)
    case = Choices(settings.models, None, mode, closed=True)
    posteriors = _posteriors(models, takes.training.joints)
    result = case_evidence(case, recordings, outcomes, posteriors)
    for refusal in result.refusals:
        print(f"score: {refusal}")
    deviation = _deviation(takes, outcomes, moments, mode)
    contracts.write(deviation, "deviation", folder)
    if result.filters:
        tested = next(iter(posteriors.values()))
        errors = _filter_errors(result.filters, [*tested], recordings)
        contracts.write(errors, "filter_error", folder)
    bias = {
        f"{model}_greatest_bias_rad": table["bias"].max()
        for model, table in moments.items()
    }
    tables = {EVIDENCE: result.evidence}
    if result.against_mean is not None:
        tables["filter_against_none"] = result.against_mean
    return {
        "motion": (bias, {}),
        "filter": ({}, tables),
        "recordings": (metrics, _recording_tables()),
    }


def _write_fitted(models: list[str], folder: Path) -> None:
    """Write the tables FITTED of all ``models`` that have them."""
    for name, together in FITTED.items():
        tables = [
            contracts.read(name, FIT / model).assign(model=model)
            for model in models
            if contracts.exists(name, FIT / model)
        ]
        if tables:
            contracts.write(pd.concat(tables, ignore_index=True), together, folder)


def _recordings(settings) -> tuple[Recordings, dict[str, float]]:
    """Return takes and measurements of the run, and numbers of the camera and of the truth."""
    dataset = settings.dataset
    takes = recorded_takes(dataset.robot, dataset.motion)
    measured = {take.take: take for take in measured_takes(dataset)}
    metrics = _true_speeds(takes, dataset)
    noise = None
    slopes = None
    if contracts.exists("kinect_noise", ARTICULATE):
        noise = contracts.read("kinect_noise", ARTICULATE)
        greatest, slopes = _camera_errors(takes, dataset.motion.rate)
        metrics["depth_camera_greatest_mean_error_rad"] = greatest
    cameras = {}
    if measured or noise is not None:
        cameras[Choices.clock] = Camera(noise, measured, slopes)
    sizes = (dataset.motion.rate, len(measured), settings.simulation.realizations)
    return Recordings(takes, cameras, *sizes, settings.seed), metrics


def _fitted_outcome(model: str, moments: pd.DataFrame) -> Outcome:
    """Return what the stage fit wrote of ``model``, with its table ``moments``."""
    return Outcome(
        model=fitted_model(FIT / model),
        estimates=json.loads((FIT / model / "fit.json").read_text()),
        mean=values(moments, "m"),
        deviation=values(moments, "s"),
    )


def _deviation(
    takes: Takes,
    outcomes: dict[str, Outcome],
    moments: dict[str, pd.DataFrame],
    mode: str,
) -> pd.DataFrame:
    """Return the table ``deviation`` of the recordings and of every model."""
    recorded = takes.training
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    std = recorded_deviation(takes.poses, recorded.noise, mode)
    curves = spread("s", recorded.joints, std)
    rows = [grid.assign(source="recorded", error=0.0, bias=0.0, **curves)]
    for model, result in outcomes.items():
        off = np.linalg.norm(result.mean - takes.poses.mean(axis=0), axis=1)
        curves = spread("s", recorded.joints, result.deviation)
        bias = moments[model]["bias"]
        rows.append(grid.assign(source=model, error=off, bias=bias, **curves))
    return pd.concat(rows, ignore_index=True)


def _posteriors(
    models: list[str],
    joints: Sequence[str],
) -> dict[str, dict[str, PosteriorMoments]]:
    """Return the posteriors of the stage filter, by filter and take."""
    places = {model: FILTER / model for model in models}
    places |= {closed(model): FILTER / model / FOLDER for model in models}
    posteriors = {}
    for name, place in places.items():
        if not contracts.exists("posterior", place):
            continue
        posteriors[name] = {}
        table = contracts.read("posterior", place)
        for take, rows in table.groupby("take", sort=False):
            covariance = matrices(rows, "c", joints)
            posteriors[name][take] = PosteriorMoments(values(rows, "m"), covariance)
    return posteriors


def _filter_errors(
    filters: dict[str, Filtered],
    tested: list[str],
    recordings: Recordings,
) -> pd.DataFrame:
    """Return the table ``filter_error`` of the takes ``tested``."""
    joints = recordings.takes.training.joints
    grid = recordings.takes.poses.shape[1]
    k = np.tile(np.arange(grid), len(tested))
    steps = {"take": np.repeat(tested, grid), "part": "test", "k": k}
    steps = pd.DataFrame(steps | {"t": k / recordings.rate})
    tables = []
    for name, compared in filters.items():
        curves = spread("e", joints, compared.error)
        curves |= spread("s", joints, compared.bound)
        tables.append(steps.assign(model=name, **curves))
    return pd.concat(tables, ignore_index=True)


def _true_speeds(takes: Takes, dataset: Dataset) -> dict[str, float]:
    """Return scores of the speeds of the truth; {} for a dataset without a truth."""
    truth = truth_of(dataset)
    if not contracts.exists("true_joints", truth):
        return {}
    recorded = takes.training
    rate = dataset.motion.rate
    chain = recorded.chain
    true_joints = contracts.read("true_joints", truth)
    _, q = contracts.stacked(true_joints, "q")
    nominal = chain.nominal_step(q[:, :-1], recorded.v)
    steps = np.diff(q, axis=1)
    metrics = speed_scores(steps, nominal, chain.max_speed, rate, recorded.joints)
    still = ~np.any(recorded.v, axis=-1)
    if still.any():
        variances = steps[:, still].var(axis=0, ddof=1).mean(axis=0)
        metrics["true_motion_at_rest_rms_rad"] = float(np.sqrt(variances.sum()))
    return metrics


def _camera_errors(takes: Takes, rate: float) -> tuple[float, pd.DataFrame]:
    """Return the greatest mean error of the depth camera in rad, and the slopes of its error over
    the joint speed near a sample.
    """
    joints = contracts.read("joints", TRACK)
    angles = contracts.read("angles", ARTICULATE)
    errors = depth_noise.errors_of(angles, joints)
    mean = values(errors, "e").mean(axis=0)
    greatest = np.abs(mean).max()
    pose, _ = pose_covariances(takes.training, takes.poses)
    moving = depth_noise.deviations(errors, joints)
    slopes = depth_noise.error_slopes(moving, 1 / rate, pose)
    near_a_sample = slopes["frames"] == depth_noise.NEAR_A_SAMPLE
    return float(greatest), slopes[near_a_sample]


def _recording_tables() -> Tables:
    """Return the tables of losses and repairs, of the takes and of what is left out."""
    takes = contracts.read("takes", TRACK)
    counts = contracts.read("quality", MOTION)
    return _quality() | {
        "takes": quality.side_by_side(takes),
        "kept": quality.account(_listed_files(), counts, takes),
    }


def _read_all(folder: Path) -> Tables:
    """Return the tables of a stage by name."""
    names = sorted(file.stem for file in folder.glob("*.parquet"))
    return {name: contracts.read(name, folder) for name in names}


def _quality() -> Tables:
    """Return the table of the losses and repairs of the instruments, summed over the takes."""
    records = []
    for folder in [*sorted(INGEST.iterdir()), TRACK]:
        if contracts.exists("quality", folder):
            records.append(contracts.read("quality", folder))
    together = pd.concat(records, ignore_index=True)
    return {"recording_quality": quality.summarise(together)}
