"""predict: scores of models and baselines for the next pose of held-out takes and motions."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ModelDomainError, RecordingError, SingularJacobianError
from pipeline.core.filters import MEMORY, NONE
from pipeline.evidence.pose import pose_table
from pipeline.evidence.step_noise import noise_by_speed, step_noise
from pipeline.filtering.linear import baseline_predictions
from pipeline.models.joint_error.fit import FAMILY, runs_of
from pipeline.models.joint_error.held_out import joint_tables, of_first_motions
from pipeline.models.kinds import estimate, fitted_models
from pipeline.models.model import MotionModel
from pipeline.models.other_motions import matrix_scores
from pipeline.models.prediction import Steps, groups_by_speed, normal_steps, score_take
from pipeline.models.steps import Options, Recorded
from pipeline.recordings.motions import logged_motions
from pipeline.recordings.runs import runs_of_dataset
from pipeline.recordings.steps import fitted_ranges, training_steps
from pipeline.statistics.scores import (
    log_score_differences,
    prediction_scores,
    score_comparison,
)

TRACK = Path("data/track")
FIT = Path("data/fit")
OUT = Path("data/predict")
# models without a random matrix, added to the models of the run
BESIDE = ("joint_step_t", "speed")
CONTROL = "wishart_qr_transposed"  # added if the run has a Wishart model
MATRIX_KINDS = ("gaussian", "wishart")
PLAIN = (NONE, MEMORY)
Models = dict[str, Options]  # options by name, of the run's and the added models
Tables = dict[str, pd.DataFrame]
Predicted = dict[str, tuple[np.ndarray, np.ndarray]]  # error and covariance by baseline


def run() -> None:
    """Write the ranges of the fits, and all scores where the measurement noise is known."""
    settings = config.sections("predict")
    with contracts.replacing(OUT) as folder:
        if settings.dataset.robot is not None:
            tables = _tables_of_robot(settings)
        else:
            print("predict: the dataset has no robot; there is no pose to predict")
            tables = {}
            if settings.dataset.joint_log is not None:
                tables = _tables_of_logs(settings)
        for name, table in tables.items():
            contracts.write(table, name, folder)


def _tables_of_robot(settings) -> Tables:
    """Return all tables of a dataset with a robot."""
    motion = settings.dataset.motion
    recorded = training_steps(settings.dataset.robot, motion)
    kinds = {model.kind for model in settings.models.values()}
    beside = {*BESIDE, CONTROL} if "wishart" in kinds else {*BESIDE}
    added = sorted(beside - settings.models.keys())
    options = settings.models | config.model_options(added)
    return {
        "ranges": fitted_ranges(recorded, motion.rate),
        **_joint_tables(settings, recorded, options),
        **_predictions(settings, recorded, options),
    }


def _tables_of_logs(settings) -> Tables:
    """Return the tables of the joint error laws, of the noise of a step and of its growth with the
    speed, on all runs of logs whose motions need not repeat.
    """
    runs, unused = runs_of_dataset(settings.dataset)
    runs = of_first_motions(runs, settings.scale.held_out_motions)
    laws = config.model_options(FAMILY)
    tables = joint_tables(runs, laws, unused, _trials(settings, "held-out motions"))
    of_steps = {"step_noise": step_noise(runs), "noise_by_speed": noise_by_speed(runs)}
    return tables | of_steps


def _trials(settings, label: str) -> Callable:
    """Return the function that maps a function over trials, shown as ``label``."""
    return partial(run_trials, compute=settings.compute, label=f"predict: {label}")


def _joint_tables(settings, recorded: Recorded, options: Models) -> Tables:
    """Return the tables of the joint error laws on all runs of the dataset's logs, or its takes,
    and the scores of matrix models on the motions of the logs.
    """
    dataset = settings.dataset
    most = settings.scale.held_out_motions
    motions = []
    try:
        if dataset.joint_log is None:
            runs = runs_of(recorded)
            unused = {}
        else:
            runs, unused = runs_of_dataset(dataset)
        runs = of_first_motions(runs, most)
        laws = config.model_options(FAMILY)
        tables = joint_tables(runs, laws, unused, _trials(settings, "held-out motions"))
    except (ModelDomainError, RecordingError) as error:
        print(f"predict: no joint error law: {error}")
        return {}
    if dataset.joint_log is not None:
        motions = logged_motions(dataset)[:most]
    matrix = matrix_models(options)
    shapes = fitted_models(matrix_models(settings.models), FIT, "predict")
    generator = partial(rng.stream, settings.seed)
    tables["pose_effect"] = pose_table(runs, recorded.chain, shapes, generator)
    noise = dataset.motion.pose_noise
    tables["other_motions"] = matrix_scores(
        motions,
        recorded.joints,
        noise,
        recorded.chain,
        matrix,
    )
    return tables


def matrix_models(options: Models) -> Models:
    """Return the options of the models with a random matrix."""
    return {name: o for name, o in options.items() if o.kind in MATRIX_KINDS}


def _predictions(settings, recorded: Recorded, options: Models) -> Tables:
    """Return scores by group of steps, and differences of log scores with intervals."""
    try:
        pose_noise = recorded.measurement / 2
    except ModelDomainError as error:
        remedy = "state dataset.motion.pose_noise"
        print(f"predict: no prediction is scored: {error}; {remedy}")
        return {}
    scored = _scores(settings, recorded, options, pose_noise)
    predictions = {}
    pairs = {}
    groups = groups_by_speed(recorded, settings.dataset.motion.rate)
    for steps, inside in groups.items():
        scores = {}
        for model, of_all in scored.items():
            within = {key: value[:, inside] for key, value in of_all.items()}
            scores[model] = prediction_scores(within, recorded.joints)
        predictions[steps] = score_comparison(scores, NONE)
        pairs[steps] = log_score_differences(scores)
    return {
        "predictions": _by_steps(predictions),
        "prediction_pairs": _by_steps(pairs),
    }


def _by_steps(groups: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the tables of ``groups`` of steps as one table with the column ``steps``."""
    return pd.concat(groups, names=["steps"]).reset_index("steps")


def _scores(
    settings,
    recorded: Recorded,
    options: Models,
    pose_noise: np.ndarray,
) -> dict[str, Steps]:
    """Return the scores (takes, M) by baseline and model; ``pose_noise`` (n, n) rad² is the noise
    of a measured pose. Without test takes each training take is scored under a fit to the others.
    """
    joints = contracts.read("joints", TRACK)
    test = joints[joints.part == "test"]
    held_out = not test.empty
    names, q = contracts.stacked(test if held_out else joints, "q")
    fitted = fitted_models(settings.models, FIT, "predict")
    models = {}
    for name, model_options in options.items():
        if name in fitted or name not in settings.models:
            models[name] = model_options
    if held_out:
        models = _fitted_laws(models, fitted, recorded)
        baselines = _baselines_of_test(recorded.poses, q, pose_noise)
    else:
        baselines = _baselines_of_training(recorded.poses, q, pose_noise)

    takes = dict(enumerate(zip(names, q, strict=True)))
    score = partial(score_take, takes=takes, recorded=recorded, models=models)
    trials = [(model, number) for model in models for number in takes]
    results = list(_trials(settings, "takes")(score, trials))
    rows = {name: [normal_steps(*take[name]) for take in baselines] for name in PLAIN}
    for (model, _), result in zip(trials, results, strict=True):
        rows.setdefault(model, []).append(result)
    scored = {name: _stacked_steps(name, of_takes) for name, of_takes in rows.items()}
    return {name: steps for name, steps in scored.items() if steps is not None}


def _fitted_laws(
    models: Models,
    fitted: dict[str, MotionModel],
    recorded: Recorded,
) -> dict[str, MotionModel]:
    """Return the laws of ``models``: those ``fitted``, others from an estimate that succeeds."""
    laws = {}
    for name, options in models.items():
        try:
            laws[name] = fitted.get(name) or estimate(recorded, options).model
        except (ModelDomainError, SingularJacobianError) as error:
            print(f"predict: {name} is left out: {error.message}")
    return laws


def _baselines_of_test(
    training: np.ndarray,
    q: np.ndarray,
    pose_noise: np.ndarray,
) -> list[Predicted]:
    """Return the baselines' predictions of each test take (takes, M+1, n) ``q`` in rad."""
    together = baseline_predictions(training, q, pose_noise)
    of_takes = []
    for number in range(len(q)):
        take = {}
        for name, (error, covariance) in together.items():
            take[name] = error[number], covariance
        of_takes.append(take)
    return of_takes


def _baselines_of_training(
    training: np.ndarray,
    q: np.ndarray,
    pose_noise: np.ndarray,
) -> list[Predicted]:
    """Return the baselines' predictions of each training take (takes, M+1, n) ``q`` in rad from the
    other training takes.
    """
    of_takes = []
    for number, take in enumerate(q):
        rest = np.delete(training, number, axis=0)
        of_takes.append(baseline_predictions(rest, take, pose_noise))
    return of_takes


def _stacked_steps(
    name: str,
    of_takes: list[tuple[Steps, dict[str, str]]],
) -> Steps | None:
    """Return the scores (takes, M) of all takes; None for a model without a fit to the other takes
    of one of them. Prints the scores that are missing, with the reasons.
    """
    reasons = {}
    for _, missing in of_takes:
        reasons |= missing
    for score, reason in reasons.items():
        print(f"predict: {name} gives no {score}: {reason}")
    steps = [take for take, _ in of_takes]
    if not all(steps):
        return None
    return {key: np.stack([take[key] for take in steps]) for key in steps[0]}
