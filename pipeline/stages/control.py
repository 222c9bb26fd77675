"""control: every model fitted to recordings whose law is known, and scored on more of them."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng, schema
from pipeline.compute.trials import run_trials
from pipeline.errors import ModelDomainError
from pipeline.motion.additive import AdditiveModel
from pipeline.motion.build import fitted_model
from pipeline.motion.control import CONSISTENT, at_rest, consistent, drawn
from pipeline.motion.estimation import Recorded, estimate
from pipeline.motion.model import MotionModel
from pipeline.motion.prediction import score_steps
from pipeline.recordings.steps import training_steps
from pipeline.statistics.comparison import spread_scores
from pipeline.statistics.scores import paired_difference

FIT, OUT = Path("data/fit"), Path("data/control")
REST, CONSISTENTLY = "rest", ", consistent"
STILL = AdditiveModel(np.zeros((3, 3)))  # a step without command and without noise


class Control(NamedTuple):
    """Recordings of a known law to fit to, and more to score on."""

    training: Recorded
    held_out: Recorded
    truth: MotionModel


class Outcome(NamedTuple):
    """One model on one control."""

    log_score: np.ndarray  # (takes,) nats, mean over the steps of each held-out take
    of_truth: np.ndarray  # (takes,) nats, of the true law with its true parameters
    spread: dict[str, float]  # how its standard deviation over time agrees with that of the drawn noise
    undetermined: bool  # whether the control says nothing of its parameters


def run() -> None:
    """Log scores of every fitted model under every true one, and whether the curves of the standard deviation would tell."""
    settings = config.sections("control")
    options, counts = settings.models, settings.scale.control_takes
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion.rate)
    with contracts.replacing(OUT) as folder:
        try:
            _ = recorded.measurement
        except ModelDomainError as error:
            print(f"control: no control recordings: {error}")
            return
        half = recorded.of(np.arange(counts) % len(recorded.q))
        fits = {name: fitted_model(FIT / name) for name in options}
        truths = [name for name, of_model in options.items() if type(of_model) in CONSISTENT]
        controls = {}
        for name in (*truths, REST):
            truth = STILL if name == REST else fits[name]
            streams = [rng.stream(settings.seed, f"control.{name}", part) for part in (0, 1)]
            controls[name] = Control(*[at_rest(half, s) if name == REST else drawn(truth, half, s) for s in streams], truth)
        changed = {name: consistent(options[name]) for name in truths if consistent(options[name]) != options[name]}
        candidates = options | {f"{name}{CONSISTENTLY}": of_model for name, of_model in changed.items()}
        trials = [(true, fitted) for true in controls for fitted in candidates]
        trial = partial(_outcome, controls=controls, options=candidates, fits=fits, seed=settings.seed)
        outcomes = dict(zip(trials, run_trials(trial, trials, compute=settings.compute, label="control: fits"), strict=True))
        contracts.write(_scores(outcomes, list(controls), list(candidates)), "control_scores", folder)


def _outcome(
    trial: tuple[str, str], controls: dict[str, Control], options: dict[str, schema.Model], fits: dict[str, MotionModel], seed: int
) -> Outcome:
    """Fit one model to one control and score it there; where the control cannot determine it, with the parameters of the recordings."""
    true, fitted = trial
    control = controls[true]
    undetermined = False
    try:
        model = estimate(control.training, options[fitted]).model
    except ModelDomainError:
        model, undetermined = fits[fitted.removesuffix(CONSISTENTLY)], True
    new = control.held_out
    scores, _ = score_steps(model, new.chain, new.q, new.v, new.q_next, new.measurement, rng.stream(seed, f"control.{true}.{fitted}"))
    of_truth = control.truth.log_density(new.chain, new.q, np.broadcast_to(new.v, new.q.shape), new.q_next, new.measurement)
    return Outcome(scores["log_density"].mean(axis=1), of_truth.mean(axis=1), _spread(model, control), undetermined)


def _spread(model: MotionModel, control: Control) -> dict[str, float]:
    """Agreement of the model's standard deviation at the mean poses with that of the drawn noise, joint by joint."""
    drawn_noise = control.training
    try:
        covariance = model.covariance(drawn_noise.chain, drawn_noise.q.mean(axis=0), drawn_noise.v) + drawn_noise.measurement
    except ModelDomainError:
        return {}
    std = {"recorded": drawn_noise.noise.std(axis=0, ddof=1), "model": np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))}
    return spread_scores(std, {})


def _scores(outcomes: dict[tuple[str, str], Outcome], trues: list[str], candidates: list[str]) -> pd.DataFrame:
    """A row for every true and fitted model: the log score, its paired difference to that of the truth, the curves."""
    rows = []
    for true in trues:
        for fitted in candidates:
            found = outcomes[true, fitted]
            difference = paired_difference(found.log_score, found.of_truth)
            row = {"true": true, "fitted": fitted, "undetermined": found.undetermined, "log_score": found.log_score.mean()}
            row |= {"difference": difference.mean, "low": difference.low, "high": difference.high}
            for j in (1, 2, 3):
                row[f"std_correlation_q{j}"] = found.spread.get(f"model_std_q{j}_correlation_with_recorded", np.nan)
                row[f"std_relative_error_q{j}"] = found.spread.get(f"model_std_q{j}_relative_error", np.nan)
            rows.append(row)
    return pd.DataFrame(rows)
