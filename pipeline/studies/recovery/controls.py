"""Every model fitted to recordings of each known law, and scored on more of them, against the law
itself with its true parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.core import rng
from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.closed_loop import measured_poses
from pipeline.models.kinds import estimate
from pipeline.models.model import MotionModel
from pipeline.models.options import Options
from pipeline.models.steps import Recorded
from pipeline.recordings.commands import constant_speed
from pipeline.statistics.joint_scores import spread_scores
from pipeline.statistics.scores import paired_difference
from pipeline.studies.consistent import CONSISTENT, consistent
from pipeline.studies.recovery.known_laws import at_rest, drawn

REST, CONSISTENTLY = "rest", ", consistent"


class Control(NamedTuple):
    """Recordings of a known law to fit to, and more to score on."""

    training: Recorded
    held_out: Recorded
    truth: MotionModel


@dataclass(frozen=True)
class Controls:
    """What every trial needs: the controls by name, the models to fit by name, and the parameters
    of the recordings for a control that determines none.
    """

    controls: Mapping[str, Control]
    models: Mapping[str, Options]
    fitted: Mapping[str, MotionModel]


class Outcome(NamedTuple):
    """One model on one control."""

    log_score: np.ndarray  # (takes,) nats, mean over the steps of each held-out take
    truth_score: np.ndarray  # (takes,) nats, the true law with its true parameters
    # how its standard deviation over time agrees with that of the drawn noise
    spread: dict[str, float]
    undetermined: bool  # whether the control gives no estimate of its parameters


def control_scores(
    recorded: Recorded,
    options: Mapping[str, Options],
    fitted: Mapping[str, MotionModel],
    seed: int,
    run: Callable[[Callable, Sequence], Iterable],
) -> pd.DataFrame:
    """The table ``control_scores``.

    Args:
        recorded: takes whose poses and commands every control has.
        options: of the models, by name; those with a consistent estimator are drawn from.
        fitted: the same models as the recordings have them.
        seed: of the experiment.
        run: maps a function over trials.
    """
    n = recorded.q.shape[-1]
    truths = [name for name, model in options.items() if model.kind in CONSISTENT]
    controls = {}
    for name in (*truths, REST):
        streams = [rng.stream(seed, f"control.{name}", part) for part in (0, 1)]
        if name == REST:
            halves = [at_rest(recorded, stream) for stream in streams]
            controls[name] = Control(*halves, AdditiveModel(np.zeros((n, n))))
        else:
            halves = [drawn(fitted[name], recorded, stream) for stream in streams]
            controls[name] = Control(*halves, fitted[name])
    models = dict(options) | {
        f"{name}{CONSISTENTLY}": consistent(options[name])
        for name in truths
        if consistent(options[name]) != options[name]
    }
    trials = [(true, model) for true in controls for model in models]
    outcomes = run(partial(_outcome, study=Controls(controls, models, fitted)), trials)
    return pd.DataFrame(
        [
            _row(*trial, outcome, recorded.joints)
            for trial, outcome in zip(trials, outcomes, strict=True)
        ]
    )


def _outcome(trial: tuple[str, str], study: Controls) -> Outcome:
    """Fit one model to one control and score it there; where the control cannot determine it, with
    the parameters of the recordings.
    """
    true, name = trial
    control, undetermined = study.controls[true], False
    try:
        model = estimate(control.training, study.models[name]).model
        own = _log_scores(model, control.held_out)
    except (ModelDomainError, SolverError):
        model, undetermined = study.fitted[name.removesuffix(CONSISTENTLY)], True
        own = _log_scores(model, control.held_out)
    scores = own, _log_scores(control.truth, control.held_out)
    return Outcome(*scores, _spread(model, control), undetermined)


def _log_scores(model: MotionModel, recorded: Recorded) -> np.ndarray:
    density = model.log_density(
        recorded.chain, recorded.q, recorded.v, recorded.q_next, recorded.measurement
    )
    return density.mean(axis=1)


def _spread(model: MotionModel, control: Control) -> dict[str, float]:
    """Agreement of the model's standard deviation at the mean poses with that of the drawn noise,
    joint by joint.
    """
    noisy = control.training
    try:
        covariance = model.covariance(noisy.chain, noisy.q.mean(axis=0), noisy.v)
    except ModelDomainError:
        return {}
    variance = np.diagonal(covariance + noisy.measurement, axis1=1, axis2=2)
    std = {"recorded": noisy.noise.std(axis=0, ddof=1), "model": np.sqrt(variance)}
    return spread_scores(std, {}, noisy.joints, constant_speed(measured_poses(noisy)))


def _row(true: str, name: str, outcome: Outcome, joints: Sequence[str]) -> dict[str, object]:
    difference = paired_difference(outcome.log_score, outcome.truth_score)
    row = {"true": true, "fitted": name, "undetermined": outcome.undetermined}
    row |= {"log_score": outcome.log_score.mean()}
    row |= {"difference": difference.mean, "low": difference.low, "high": difference.high}
    for column, score in (
        ("std_correlation", "correlation_with_recorded"),
        ("std_relative_error", "relative_error"),
    ):
        for joint in joints:
            row[f"{column}:{joint}"] = outcome.spread.get(f"model_std_{joint}_{score}", np.nan)
    return row
