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

FILES, INGEST, TRACK = Path("data/files"), Path("data/ingest"), Path("data/track")
MOTION, ARTICULATE, READINGS = (
    INGEST / "motion",
    Path("data/articulate"),
    Path("data/readings"),
)
FIT, FILTER, WRENCH = Path("data/fit"), Path("data/filter"), Path("data/wrench")
PREDICT, OUT = Path("data/predict"), Path("data/score")
ONLY_DRAWN = "held_out_run"  # table of a figure that no page prints
OF_WRENCH = (
    "sigma_s",
    "force_moments",
    "force_test",
)  # tables that the report shows unchanged
FITTED = {
    "ridge": "ridges",
    "sigma_b_weights": "sigma_b_weights",
    "sigma_b_floors": "sigma_b_floors",
}  # one model: all models
FLOORS = "sigma_b_floors"  # of these the one that the report shows
EVIDENCE = "evidence"
Tables = dict[str, pd.DataFrame]
Scored = tuple[dict[str, float], Tables]  # numbers, and tables of the report


def run() -> None:
    """Compare every model with the recordings, in mean, in standard deviation and in the filter."""
    settings = config.sections("score")
    dataset, robot = settings.dataset, settings.dataset.robot
    with contracts.replacing(OUT) as folder:
        if robot is None:
            print("score: the dataset has no robot; only its forces are scored")
            scored = {
                "motion": ({}, {}),
                "filter": ({}, {}),
                "recordings": ({}, _quality()),
            }
        else:
            scored = _score_robot(settings, folder)
        metrics = {stem: numbers for stem, (numbers, _) in scored.items()}
        files = {"wrench": WRENCH / "wrench.json"}
        for stage, place in {"fit": FIT, "filter": FILTER}.items():
            files |= {
                f"{stage}_{n}": place / n / f"{stage}.json" for n in settings.models
            }
        metrics |= {stem: json.loads(file.read_text()) for stem, file in files.items()}
        wrench = _read_all(WRENCH)
        evidence = [own.pop(EVIDENCE) for _, own in scored.values() if EVIDENCE in own]
        tables = {
            name: table for _, own in scored.values() for name, table in own.items()
        }
        tables |= _read_all(READINGS) | _read_all(PREDICT)
        tables.pop(ONLY_DRAWN, None)
        tables |= {name: wrench[name] for name in OF_WRENCH if name in wrench}
        if listed := [pd.read_csv(file) for file in sorted(FILES.glob("*.csv"))]:
            tables["raw_files"] = by_place(pd.concat(listed))
        tables["wrench_study"] = wrench_summary(
            wrench["wrench_errors"], wrench["wrench_spread"]
        )
        if contracts.exists(FLOORS, folder):
            tables[FLOORS] = contracts.read(FLOORS, folder)
        if "prediction_pairs" in tables:
            pairs = tables["prediction_pairs"]
            evidence.append(prediction_evidence(tables["predictions"], pairs))
        tables[EVIDENCE] = pd.concat(
            [*evidence, wrench_evidence(wrench)], ignore_index=True
        )
        contracts.write(tables[EVIDENCE], EVIDENCE, folder)
        for stem, numbers in metrics.items():
            contracts.write_metrics(numbers, folder / f"metrics/{stem}.json")
        for name, table in tables.items():
            contracts.write_text(
                table.to_csv(index=False), folder / f"tables/{name}.csv"
            )
        own = Run(
            dataset=dataset.name,
            scale=settings.scale.name,
            synthetic=truth_of(
                dataset
            ).is_dir(),  # only a synthetic dataset has a truth
            joints=robot.joints if robot else [],
            task=members(contracts.read("trajectory", MOTION), "v") if robot else [],
            models={name: options.kind for name, options in settings.models.items()},
            metrics=metrics,
            tables=tables,
            cause=(dataset.laboratory or {}).get("cause") or "",
            version=project_version(),
        )
        contracts.write_text(own.to_json(), folder / "evidence.json")


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
    noise, slopes = None, None
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
    models: list[str], joints: Sequence[str]
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
    filters: dict[str, Filtered], tested: list[str], recordings: Recordings
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
    if not contracts.exists("true_joints", truth_of(dataset)):
        return {}
    recorded, rate = takes.training, dataset.motion.rate
    _, q = contracts.stacked(contracts.read("true_joints", truth_of(dataset)), "q")
    nominal = recorded.chain.nominal_step(q[:, :-1], recorded.v)
    steps, still = np.diff(q, axis=1), ~np.any(recorded.v, axis=-1)
    limits = recorded.chain.max_speed
    metrics = speed_scores(steps, nominal, limits, rate, recorded.joints)
    if still.any():
        variances = steps[:, still].var(axis=0, ddof=1).mean(axis=0)
        metrics["true_motion_at_rest_rms_rad"] = float(np.sqrt(variances.sum()))
    return metrics


def _camera_errors(takes: Takes, rate: float) -> tuple[float, pd.DataFrame]:
    """Return the greatest mean error of the depth camera in rad, and the slopes of its error over
    the joint speed near a sample.
    """
    joints = contracts.read("joints", TRACK)
    errors = depth_noise.errors_of(contracts.read("angles", ARTICULATE), joints)
    mean = values(errors, "e").mean(axis=0)
    pose, _ = pose_covariances(takes.training, takes.poses)
    moving = depth_noise.deviations(errors, joints)
    slopes = depth_noise.error_slopes(moving, 1 / rate, pose)
    near = slopes[slopes["frames"] == depth_noise.NEAR_A_SAMPLE]
    return float(np.abs(mean).max()), near


def _recording_tables() -> Tables:
    """Return the tables of losses and repairs, of the takes and of what is left out."""
    takes, counts = contracts.read("takes", TRACK), contracts.read("quality", MOTION)
    listed = [pd.read_csv(file) for file in sorted(FILES.glob("*.csv"))]
    return _quality() | {
        "takes": quality.side_by_side(takes),
        "kept": quality.account(listed, counts, takes),
    }


def _read_all(folder: Path) -> Tables:
    """Return the tables of a stage by name."""
    names = sorted(file.stem for file in folder.glob("*.parquet"))
    return {name: contracts.read(name, folder) for name in names}


def _quality() -> Tables:
    """Return the table of the losses and repairs of the instruments, summed over the takes."""
    folders = [*sorted(INGEST.iterdir()), TRACK]
    records = [
        contracts.read("quality", p) for p in folders if contracts.exists("quality", p)
    ]
    return {
        "recording_quality": quality.summarise(pd.concat(records, ignore_index=True))
    }
