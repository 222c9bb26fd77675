"""score: recordings compared with every model: tables behind the figures, numbers of the run."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.columns import matrices, members, spread, values
from pipeline.core.errors import ModelDomainError
from pipeline.core.filters import closed
from pipeline.evidence.case import Takes, recorded_takes
from pipeline.evidence.filters import filter_evidence
from pipeline.evidence.instruments import camera_evidence, wrench_evidence
from pipeline.evidence.motion import Outcome, motion_evidence, noise_tests
from pipeline.evidence.outcomes import all_filters, pose_covariances
from pipeline.filtering.measurement import measured_takes
from pipeline.models.closed_loop import FOLDER
from pipeline.models.kinds import fitted_model
from pipeline.models.steps import recorded_deviation
from pipeline.perception import depth_noise
from pipeline.recordings import quality
from pipeline.recordings.commands import constant_speed, speed_scores
from pipeline.recordings.inventory import by_place
from pipeline.recordings.steps import truth_of
from pipeline.statistics.curves import variation_limits
from pipeline.statistics.takes import wrench_summary
from pipeline.verdicts.run import Run

FILES, INGEST, TRACK = Path("data/files"), Path("data/ingest"), Path("data/track")
MOTION, ARTICULATE, READINGS = (
    INGEST / "motion",
    Path("data/articulate"),
    Path("data/readings"),
)
FIT, FILTER, WRENCH = Path("data/fit"), Path("data/filter"), Path("data/wrench")
PREDICT, OUT = Path("data/predict"), Path("data/score")
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
        tables |= {name: wrench[name] for name in OF_WRENCH if name in wrench}
        if listed := [pd.read_csv(file) for file in sorted(FILES.glob("*.csv"))]:
            tables["raw_files"] = by_place(pd.concat(listed))
        tables["wrench_study"] = wrench_summary(
            wrench["wrench_errors"], wrench["wrench_spread"]
        )
        if contracts.exists(FLOORS, folder):
            tables[FLOORS] = contracts.read(FLOORS, folder)
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
        )
        contracts.write_text(own.to_json(), folder / "evidence.json")


def _score_robot(settings, folder: Path) -> dict[str, Scored]:
    """Write the tables of the figures; return the scores of motion, filters and recordings."""
    models = [
        model for model in settings.models if contracts.exists("moments", FIT / model)
    ]
    for model in settings.models.keys() - {*models}:
        print(f"score: {model} is left out: it has no fit to the recordings")
    for name, together in FITTED.items():
        fitted = [
            model for model in settings.models if contracts.exists(name, FIT / model)
        ]
        parts = [
            contracts.read(name, FIT / model).assign(model=model) for model in fitted
        ]
        if parts:
            contracts.write(pd.concat(parts, ignore_index=True), together, folder)
    takes = recorded_takes(settings.dataset.robot, settings.dataset.motion)
    return {
        "motion": _score_motion(models, takes, settings, folder),
        "filter": _score_filters(models, takes, settings, folder),
        "recordings": _score_recordings(takes, settings.dataset),
    }


def _score_motion(models: list[str], takes: Takes, settings, folder: Path) -> Scored:
    """Score mean and standard deviation over time of every model against the recordings."""
    recorded, mode = takes.training, settings.simulation.mode
    std = {"recorded": recorded_deviation(takes.poses, recorded.noise, mode)}
    outcomes, off, bias = {}, {}, {}
    for model in models:
        moments = contracts.read("moments", FIT / model)
        (mean, std[model]), bias[model] = (
            (values(moments, x) for x in "ms"),
            moments["bias"],
        )
        estimates = json.loads((FIT / model / "fit.json").read_text())
        own = outcomes[model] = Outcome(
            estimates=estimates, mean=mean, deviation=std[model]
        )
        off[model] = np.linalg.norm(mean - takes.poses.mean(axis=0), axis=1)
        if mode == "one_step":
            stream = rng.stream(settings.seed, f"score.following.{model}")
            try:
                tested = noise_tests(
                    fitted_model(FIT / model), recorded, takes.poses, stream
                )
                own.modelled, own.following = tested
            except ModelDomainError as error:
                print(
                    f"score: {model} cannot have the recorded total variance: {error}"
                )
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    rows = []
    for source, own in std.items():
        named = {
            "source": source,
            "error": off.get(source, 0.0),
            "bias": bias.get(source, 0.0),
        }
        rows.append(grid.assign(**named, **spread("s", recorded.joints, own)))
    contracts.write(pd.concat(rows, ignore_index=True), "deviation", folder)
    limits = variation_limits(
        recorded.noise, rng.stream(settings.seed, "score.variation")
    )
    metrics = {f"{model}_greatest_bias_rad": own.max() for model, own in bias.items()}
    return metrics, {EVIDENCE: motion_evidence(outcomes, takes, mode, limits)}


def _score_filters(models: list[str], takes: Takes, settings, folder: Path) -> Scored:
    """Score errors, bounds and posteriors of all filters, the training mean and a linear filter."""
    names, posteriors = takes.training.joints, {}
    places = {model: FILTER / model for model in models}
    for name, place in (
        places | {closed(n): p / FOLDER for n, p in places.items()}
    ).items():
        if contracts.exists("posterior", place):
            posteriors[name] = contracts.read("posterior", place)
    if not posteriors:
        return {}, {}
    steps = next(iter(posteriors.values()))[["take", "part", "k", "t"]]
    tested = list(dict.fromkeys(steps["take"]))
    truth = np.stack([takes.test[take] for take in tested])
    frames = {take.take: take for take in measured_takes(settings.dataset)}
    moments = {
        name: (
            values(own, "m").reshape(truth.shape),
            matrices(own, "c", names).reshape(*truth.shape, len(names)),
        )
        for name, own in posteriors.items()
    }
    measured, rate = [frames[take] for take in tested], settings.dataset.motion.rate
    filters = all_filters(takes, truth, moments, measured, rate)
    errors = [
        steps.assign(
            model=name, **spread("e", names, f.error), **spread("s", names, f.bound)
        )
        for name, f in filters.items()
    ]
    contracts.write(pd.concat(errors, ignore_index=True), "filter_error", folder)
    steady, generator = (
        constant_speed(takes.poses),
        partial(rng.stream, settings.seed),
    )
    evidence, against, refusals = filter_evidence(filters, names, steady, generator)
    for refusal in refusals:
        print(f"score: {refusal}")
    return {}, {EVIDENCE: evidence, "filter_against_none": against}


def _score_recordings(takes: Takes, dataset) -> Scored:
    """Score losses, repairs, depth noise and the speeds of the truth."""
    metrics, tables, recorded, rate = (
        {},
        _quality(),
        takes.training,
        dataset.motion.rate,
    )
    if contracts.exists("true_joints", truth_of(dataset)):
        _, q = contracts.stacked(contracts.read("true_joints", truth_of(dataset)), "q")
        nominal = recorded.chain.nominal_step(q[:, :-1], recorded.v)
        steps, still = np.diff(q, axis=1), ~np.any(recorded.v, axis=-1)
        known = recorded.chain.max_speed, rate, recorded.joints
        metrics |= speed_scores(steps, nominal, *known)
        if still.any():
            variances = steps[:, still].var(axis=0, ddof=1).mean(axis=0)
            metrics["true_motion_at_rest_rms_rad"] = float(np.sqrt(variances.sum()))
    kept, counts = contracts.read("takes", TRACK), contracts.read("quality", MOTION)
    tables["takes"] = quality.side_by_side(kept)
    tables["kept"] = quality.account(
        map(pd.read_csv, sorted(FILES.glob("*.csv"))), counts, kept
    )
    if contracts.exists("kinect_noise", ARTICULATE):
        joints, (pose, _) = (
            contracts.read("joints", TRACK),
            pose_covariances(recorded, takes.poses),
        )
        errors = depth_noise.errors_of(contracts.read("angles", ARTICULATE), joints)
        mean = values(errors, "e").mean(axis=0)
        metrics["depth_camera_greatest_mean_error_rad"] = float(np.abs(mean).max())
        moving = depth_noise.deviations(errors, joints)
        slopes = depth_noise.error_slopes(moving, 1 / rate, pose)
        near = slopes[slopes["frames"] == depth_noise.NEAR_A_SAMPLE]
        tables[EVIDENCE] = camera_evidence(
            contracts.read("kinect_noise", ARTICULATE), near
        )
    return metrics, tables


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
