"""score: recordings compared with every model: tables behind the figures, numbers of the run."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.cases.evidence import camera_scores, noise_tests, pose_covariances
from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.columns import columns, matrices, members, spread, values
from pipeline.core.errors import ModelDomainError
from pipeline.core.filters import MEMORY, NONE, closed
from pipeline.filtering.linear import autocorrelated_filter
from pipeline.filtering.measurement import measured_takes
from pipeline.models.closed_loop import FOLDER
from pipeline.models.kinds import fitted_model
from pipeline.models.steps import Recorded, recorded_deviation
from pipeline.perception import depth_noise
from pipeline.recordings import quality
from pipeline.recordings.commands import constant_speed, speed_scores
from pipeline.recordings.steps import training_steps, truth_of
from pipeline.statistics import curves
from pipeline.statistics.scores import Filtered, filter_metrics, filter_tables, training_mean
from pipeline.statistics.takes import lag_one_correlation, share_between, wrench_summary
from pipeline.verdicts.run import Run

FILES, INGEST, TRACK = Path("data/files"), Path("data/ingest"), Path("data/track")
MOTION, ARTICULATE, READINGS = INGEST / "motion", Path("data/articulate"), Path("data/readings")
FIT, FILTER, WRENCH = Path("data/fit"), Path("data/filter"), Path("data/wrench")
PREDICT, OUT = Path("data/predict"), Path("data/score")
OF_WRENCH = ("sigma_s", "force_moments", "force_test")  # tables that the report shows unchanged
FITTED = {"ridge": "ridges", "sigma_b_weights": "sigma_b_weights"}  # one model: all models
# share of the recorded variance that lies between recordings of one motion
SHARE_BETWEEN = "recorded_share_of_variance_between_recordings"
LONG = ("deviation",)  # tables that no verdict uses
Tables = dict[str, pd.DataFrame]
Scored = tuple[dict[str, float], Tables]  # numbers, and tables of the report


def run() -> None:
    """Compare every model with the recordings, in mean, in standard deviation and in the filter."""
    settings = config.sections("score")
    with contracts.replacing(OUT) as folder:
        (folder / "tables").mkdir()
        if settings.dataset.robot is None:
            print("score: the dataset has no robot; only its forces are scored")
            scored = {"motion": ({}, {}), "filter": ({}, {}), "recordings": _quality()}
        else:
            scored = _score_robot(settings, folder)
        metrics = {stem: numbers for stem, (numbers, _) in scored.items()}
        files = {"wrench": WRENCH / "wrench.json"}
        for stage, place in {"fit": FIT, "simulate": FIT, "filter": FILTER}.items():
            for model in settings.models:
                files[f"{stage}_{model}"] = place / model / f"{stage}.json"
        metrics |= {stem: json.loads(file.read_text()) for stem, file in files.items()}
        for stem, numbers in metrics.items():
            contracts.write_metrics(numbers, folder / f"metrics/{stem}.json")
        tables = {name: table for _, own in scored.values() for name, table in own.items()}
        shown = [*READINGS.glob("*.parquet"), *PREDICT.glob("*.parquet")]
        shown += [file for file in WRENCH.glob("*.parquet") if file.stem in OF_WRENCH]
        tables |= {file.stem: contracts.read(file.stem, file.parent) for file in shown}
        study = [contracts.read(name, WRENCH) for name in ("wrench_errors", "wrench_spread")]
        tables["wrench_study"] = wrench_summary(*study)
        for name, table in tables.items():
            table.to_csv(folder / f"tables/{name}.csv", index=False)
        contracts.write_text(_evidence(settings, list(metrics), folder), folder / "evidence.json")


def _score_robot(settings, folder: Path) -> dict[str, Scored]:
    """Write the tables of the figures; return the scores of motion, filters and recordings."""
    models = [model for model in settings.models if contracts.exists("moments", FIT / model)]
    for model in settings.models.keys() - {*models}:
        print(f"score: {model} is left out: it has no fit to the recordings")
    for name, together in FITTED.items():
        fitted = [model for model in settings.models if contracts.exists(name, FIT / model)]
        parts = [contracts.read(name, FIT / model).assign(model=model) for model in fitted]
        if parts:
            contracts.write(pd.concat(parts, ignore_index=True), together, folder)
    joints = contracts.read("joints", TRACK)
    takes, q = contracts.stacked(joints[joints.part == "training"], "q")
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    pose, _ = pose_covariances(recorded, q)
    scored = {
        "motion": _score_motion(models, takes, q, recorded, settings),
        "filter": _score_filters(models, q, recorded, joints, settings, folder),
        "recordings": _score_recordings(joints, pose, recorded, settings.dataset),
    }
    contracts.write(scored["motion"][1]["deviation"], "deviation", folder)
    return scored


def _score_motion(
    models: list[str], takes: list[str], q: np.ndarray, recorded: Recorded, settings
) -> Scored:
    """Score mean and standard deviation over time of every model against the recordings."""
    names, noise, mode = recorded.joints, recorded.noise, settings.simulation.mode
    off, bias, std = {}, {}, {"recorded": recorded_deviation(q, noise, mode)}
    for model in models:
        moments = contracts.read("moments", FIT / model)
        off[model] = np.linalg.norm(values(moments, "m") - q.mean(axis=0), axis=1)
        std[model], bias[model] = values(moments, "s"), moments["bias"].to_numpy()
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    rows = [
        grid.assign(
            source=source,
            error=off.get(source, 0.0),
            bias=bias.get(source, 0.0),
            **spread("s", names, own),
        )
        for source, own in std.items()
    ]
    tables = {"deviation": pd.concat(rows, ignore_index=True)}
    # without k = 0, before the first step
    std = {source: own[1:] for source, own in std.items()}
    off = {model: own[1:] for model, own in off.items()}
    stream = rng.stream(settings.seed, "score.constant_noise")
    limits = curves.constant_noise_variation(noise, stream)
    metrics = {
        f"recorded_lag_one_correlation_{name}": lag_one_correlation(noise[..., j])
        for j, name in enumerate(names)
    }
    for name, limit in zip(names, limits, strict=True):
        metrics[f"recorded_std_{name}_variation_of_constant_noise"] = limit
    metrics |= {f"{model}_greatest_bias_rad": own.max() for model, own in bias.items()}
    metrics["recorded_takes"] = len(noise)
    metrics[SHARE_BETWEEN] = share_between(noise, [take.rpartition("_")[0] for take in takes])
    if mode == "one_step":
        modelled, following = {}, {}
        for model in models:
            stream = rng.stream(settings.seed, f"score.following.{model}")
            try:
                tested = noise_tests(fitted_model(FIT / model), recorded, q, stream)
                modelled[model], following[model] = tested
            except ModelDomainError as error:
                print(f"score: {model} cannot have the recorded total variance: {error}")
        # a model without the recorded total variance is not compared
        std = {"recorded": std["recorded"]} | {name: own.std for name, own in modelled.items()}
        tables |= curves.spread_tables(modelled, following, noise, names)
    return curves.std_scores(std, off, names) | metrics, tables


def _score_filters(
    models: list[str],
    training: np.ndarray,
    recorded: Recorded,
    joints: pd.DataFrame,
    settings,
    folder: Path,
) -> Scored:
    """Score errors, bounds and posteriors of all filters, the training mean and a linear filter."""
    dataset, names = settings.dataset, recorded.joints
    places = {model: FILTER / model for model in models}
    places |= {closed(model): FILTER / model / FOLDER for model in models}
    places = {name: place for name, place in places.items() if contracts.exists("posterior", place)}
    if not places:
        return {}, {}
    measured = joints[["take", "k", *columns("q", names)]]
    posteriors = {
        name: contracts.read("posterior", place).merge(measured, on=["take", "k"])
        for name, place in places.items()
    }
    steps = next(iter(posteriors.values()))
    takes, q = contracts.stacked(steps, "q")
    frames = {take.take: take for take in measured_takes(dataset)}
    poses = pose_covariances(recorded, training)
    known = (training, poses[0], [frames[take] for take in takes], 1 / dataset.motion.rate)
    means, covariances, without = autocorrelated_filter(*known)
    noise, closed_noise = poses
    filters = {NONE: training_mean(training, q), MEMORY: Filtered(means - q, covariances, noise)}
    for name, posterior in posteriors.items():
        error = (values(posterior, "m") - values(posterior, "q")).reshape(q.shape)
        covariance = matrices(posterior, "c", names).reshape(*q.shape, len(names))
        filters[name] = Filtered(error, covariance, noise if name in models else closed_noise)
    step = steps[["take", "part", "k", "t"]]
    errors = [
        step.assign(model=name, **spread("e", names, f.error), **spread("s", names, f.bound))
        for name, f in filters.items()
    ]
    contracts.write(pd.concat(errors, ignore_index=True), "filter_error", folder)
    stream = rng.stream(settings.seed, "score.bounds")
    tables, refusals = filter_tables(filters, names, stream)
    for refusal in refusals:
        print(f"score: {refusal}")
    metrics = filter_metrics(filters, names, constant_speed(training))
    return metrics | {"axes_of_training_steps_without_spread": without}, tables


def _score_recordings(
    joints: pd.DataFrame, pose: np.ndarray, recorded: Recorded, dataset
) -> Scored:
    """Score losses, repairs, depth noise and the speeds of the truth; ``pose`` (n, n) rad² is the
    noise of a pose.
    """
    (metrics, tables), rate, chain = _quality(), dataset.motion.rate, recorded.chain
    if contracts.exists("true_joints", truth_of(dataset)):
        _, q = contracts.stacked(contracts.read("true_joints", truth_of(dataset)), "q")
        nominal = chain.nominal_step(q[:, :-1], recorded.v)
        known = chain.max_speed, rate, recorded.joints
        steps, still = np.diff(q, axis=1), ~np.any(recorded.v, axis=-1)
        metrics |= speed_scores(steps, nominal, *known)
        if still.any():
            variances = steps[:, still].var(axis=0, ddof=1).mean(axis=0)
            metrics["true_motion_at_rest_rms_rad"] = float(np.sqrt(variances.sum()))
    takes, counts = contracts.read("takes", TRACK), contracts.read("quality", MOTION)
    tables["takes"] = quality.side_by_side(takes)
    tables["kept"] = quality.account(map(pd.read_csv, sorted(FILES.glob("*.csv"))), counts, takes)
    if contracts.exists("kinect_noise", ARTICULATE):
        metrics |= camera_scores(contracts.read("kinect_noise", ARTICULATE))
        errors = depth_noise.errors_of(contracts.read("angles", ARTICULATE), joints)
        moving = depth_noise.deviations(errors, joints)
        metrics |= depth_noise.slope_scores(depth_noise.error_slopes(moving, 1 / rate, pose))
    return metrics, tables


def _quality() -> Scored:
    """Return the losses and repairs of the instruments, summed over the takes."""
    folders = [*sorted(INGEST.iterdir()), TRACK]
    records = [contracts.read("quality", p) for p in folders if contracts.exists("quality", p)]
    summary = quality.summarise(pd.concat(records, ignore_index=True))
    return quality.metrics(summary), {"recording_quality": summary}


def _evidence(settings, stems: list[str], folder: Path) -> str:
    """Return every metric and every short table of the run as JSON."""
    dataset, csv = settings.dataset, sorted(folder.glob("tables/*.csv"))
    robot = dataset.robot
    return Run(
        dataset=dataset.name,
        scale=settings.scale.name,
        synthetic=truth_of(dataset).is_dir(),  # only a synthetic dataset has a truth
        joints=robot.joints if robot else [],
        task=members(contracts.read("trajectory", MOTION), "v") if robot else [],
        models={name: options.kind for name, options in settings.models.items()},
        metrics={s: json.loads((folder / f"metrics/{s}.json").read_text()) for s in stems},
        tables={file.stem: pd.read_csv(file) for file in csv if file.stem not in LONG},
    ).to_json()
