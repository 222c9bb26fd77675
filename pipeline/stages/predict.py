"""predict: scores of models and baselines for the next pose of held-out takes and motions."""

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
from pipeline.evidence.step_noise import step_noise
from pipeline.filtering.linear import baseline_predictions
from pipeline.models.joint_error.fit import FAMILY, runs_of
from pipeline.models.joint_error.held_out import joint_tables, of_first_motions
from pipeline.models.kinds import estimate, fitted_models
from pipeline.models.other_motions import matrix_scores
from pipeline.models.prediction import Steps, groups_by_speed, normal_steps, score_take
from pipeline.models.steps import Options, Recorded
from pipeline.recordings.runs import logged_motions, runs_of_dataset
from pipeline.recordings.steps import fitted_ranges, training_steps
from pipeline.statistics.scores import (
    log_score_differences,
    prediction_scores,
    score_comparison,
)

TRACK, FIT, OUT = Path("data/track"), Path("data/fit"), Path("data/predict")
# models without a random matrix, added to the models of the run
BESIDE = ("joint_step_t", "speed")
CONTROL = "wishart_qr_transposed"  # added if the run has a Wishart model
MATRIX_KINDS = ("gaussian", "wishart")
Models = dict[str, Options]  # options by name, of the run's and the added models


def run() -> None:
    """Write the ranges of the fits, and all scores where the measurement noise is known."""
    settings = config.sections("predict")
    with contracts.replacing(OUT) as folder:
        if settings.dataset.robot is None:
            print("predict: the dataset has no robot; there is no pose to predict")
            if settings.dataset.joint_log is not None:
                tables = _tables_of_logs(settings)
                for name, table in tables.items():
                    contracts.write(table, name, folder)
            return
        recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
        options = settings.models
        control = any(own.kind == "wishart" for own in options.values())
        added = {*BESIDE, *[CONTROL] * control} - options.keys()
        options = options | config.model_options(sorted(added))
        ranges = fitted_ranges(recorded, settings.dataset.motion.rate)
        tables = {"ranges": ranges} | _joint_tables(settings, recorded, options)
        for name, table in (tables | _predictions(settings, recorded, options)).items():
            contracts.write(table, name, folder)


def _tables_of_logs(settings) -> dict[str, pd.DataFrame]:
    """Return the tables of the joint error laws and of the noise of a step, on all runs of logs
    whose motions need not repeat.
    """
    runs, unused = runs_of_dataset(settings.dataset)
    runs = of_first_motions(runs, settings.scale.held_out_motions)
    each = partial(
        run_trials, compute=settings.compute, label="predict: held-out motions"
    )
    tables = joint_tables(runs, config.model_options(FAMILY), unused, each)
    return tables | {"step_noise": step_noise(runs)}


def _joint_tables(
    settings, recorded: Recorded, options: Models
) -> dict[str, pd.DataFrame]:
    """Return the tables of the joint error laws on all runs of the dataset's logs, or its takes,
    and the scores of matrix models on the motions of the logs.
    """
    each = partial(
        run_trials, compute=settings.compute, label="predict: held-out motions"
    )
    try:
        logged = (
            runs_of_dataset(settings.dataset) if settings.dataset.joint_log else None
        )
        runs, unused = (runs_of(recorded), {}) if logged is None else logged
        runs = of_first_motions(runs, settings.scale.held_out_motions)
        tables = joint_tables(runs, config.model_options(FAMILY), unused, each)
    except (ModelDomainError, RecordingError) as error:
        print(f"predict: no joint error law: {error}")
        return {}
    dataset = settings.dataset
    motions = logged_motions(dataset) if dataset.joint_log else []
    motions = motions[: settings.scale.held_out_motions]
    matrix = {name: own for name, own in options.items() if own.kind in MATRIX_KINDS}
    of_motions = recorded.joints, dataset.motion.pose_noise, recorded.chain, matrix
    named = [name for name, own in settings.models.items() if own.kind in MATRIX_KINDS]
    shapes = fitted_models(named, FIT, "predict")
    generator = partial(rng.stream, settings.seed)
    tables["pose_effect"] = pose_table(runs, recorded.chain, shapes, generator)
    return tables | {"other_motions": matrix_scores(motions, *of_motions)}


def _predictions(
    settings, recorded: Recorded, options: Models
) -> dict[str, pd.DataFrame]:
    """Return scores by group of steps, and differences of log scores with intervals."""
    try:
        pose = recorded.measurement / 2
    except ModelDomainError as error:
        print(
            f"predict: no prediction is scored: {error}; state dataset.motion.pose_noise"
        )
        return {}
    scored = _scores(settings, recorded, options, pose)
    tables = {"predictions": {}, "prediction_pairs": {}}
    for steps, inside in groups_by_speed(
        recorded, settings.dataset.motion.rate
    ).items():
        scores = {}
        for model, own in scored.items():
            within = {key: value[:, inside] for key, value in own.items()}
            scores[model] = prediction_scores(within, recorded.joints)
        tables["predictions"][steps] = score_comparison(scores, NONE)
        tables["prediction_pairs"][steps] = log_score_differences(scores)
    return {
        name: pd.concat(groups, names=["steps"]).reset_index("steps")
        for name, groups in tables.items()
    }


def _scores(
    settings, recorded: Recorded, options: Models, pose: np.ndarray
) -> dict[str, Steps]:
    """Return the scores (takes, M) by baseline and model; ``pose`` (n, n) rad² is the noise of a
    measured pose. Without test takes each training take is scored under a fit to the others.
    """
    joints, of_run = contracts.read("joints", TRACK), settings.models
    test = joints[joints.part == "test"]
    names, q = contracts.stacked(joints if test.empty else test, "q")
    training, fitted = recorded.poses, fitted_models(of_run, FIT, "predict")
    models = {n: own for n, own in options.items() if n in fitted or n not in of_run}
    if test.empty:
        others = [np.delete(training, number, axis=0) for number in range(len(q))]
        alone = [
            baseline_predictions(*each, pose) for each in zip(others, q, strict=True)
        ]
    else:
        for name, own in list(models.items()):
            try:
                models[name] = fitted.get(name) or estimate(recorded, own).model
            except (ModelDomainError, SingularJacobianError) as error:
                del models[name]
                print(f"predict: {name} is left out: {error.message}")
        together = baseline_predictions(training, q, pose).items()
        alone = [
            {n: (error[k], c) for n, (error, c) in together} for k in range(len(q))
        ]
    takes = dict(enumerate(zip(names, q, strict=True)))
    score = partial(score_take, takes=takes, recorded=recorded, models=models)
    trials = [(model, number) for model in models for number in takes]
    results = run_trials(
        score, trials, compute=settings.compute, label="predict: takes"
    )
    rows = {
        name: [normal_steps(*each[name]) for each in alone] for name in (NONE, MEMORY)
    }
    for (model, _), result in zip(trials, results, strict=True):
        rows.setdefault(model, []).append(result)
    scored = {}
    for name, of_takes in rows.items():
        for what, reason in {
            k: v for _, missing in of_takes for k, v in missing.items()
        }.items():
            print(f"predict: {name} gives no {what}: {reason}")
        steps = [each for each, _ in of_takes]
        if all(
            steps
        ):  # else it lacks scores of a model without a fit to the other takes
            scored[name] = {
                key: np.stack([each[key] for each in steps]) for key in steps[0]
            }
    return scored
