"""evaluate@model: the one-step predictions of one motion model, scored on takes that its fit has not seen."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng, schema
from pipeline.compute.trials import run_trials
from pipeline.errors import SingularJacobianError
from pipeline.motion.build import fitted_model
from pipeline.motion.estimation import Recorded, estimate
from pipeline.motion.model import MotionModel
from pipeline.motion.prediction import score_steps
from pipeline.recordings.steps import training_steps

TRACK, FIT, OUT = Path("data/track"), Path("data/fit"), Path("data/evaluate")
JOINTS = ["q1", "q2", "q3"]


def run(model: str) -> None:
    """Score every step of the test takes; without test takes each training take, predicted by a fit to the others.

    To each model the measurement noise recorded at rest is added alike.
    """
    settings = config.sections("evaluate", item=model)
    options = vars(settings.models)[model]
    joints = contracts.read("joints", TRACK)
    training, test = joints[joints.part == "training"], joints[joints.part == "test"]
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion.rate)
    with contracts.replacing(OUT / model) as folder:
        if np.all(np.any(recorded.v, axis=1)):
            print("evaluate: the motion never rests, so that the measurement noise is not known; no prediction is scored")
            return
        trial = partial(_score_take, recorded=recorded, stream=(settings.seed, f"evaluate.{model}"))
        held_out = training if test.empty else test
        if test.empty:
            print("evaluate: the dataset has no test takes; each take is predicted by the fit to the others")
            trial = partial(trial, options=options)
        else:
            trial = partial(trial, model=fitted_model(FIT / model))
        names, q = contracts.stacked(held_out, JOINTS)
        trials = list(zip(range(len(names)), names, q, strict=True))
        scored = list(run_trials(trial, trials, compute=settings.compute, label=f"evaluate {model}: takes"))
        rows = held_out.loc[held_out.k > 0, ["take", "part", "k", "t"]].reset_index(drop=True)
        table = pd.concat([pd.DataFrame(scores) for scores, _ in scored], ignore_index=True)
        contracts.write(pd.concat([rows, table], axis=1), "one_step_scores", folder)
    for what in dict.fromkeys(what for _, reasons in scored for what in reasons):
        found = [reasons[what] for _, reasons in scored if what in reasons]
        print(f"evaluate: {model} gives no {what} in {len(found)} of {len(names)} takes: {found[0]}")


def _score_take(
    trial: tuple[int, str, np.ndarray], recorded: Recorded, stream: tuple[int, str],
    model: MotionModel | None = None, options: schema.Model | None = None,
) -> tuple[dict[str, np.ndarray], dict[str, str]]:  # fmt: skip
    """The scores of the steps of one take under ``model``, or, where that is not given, under the fit of ``options`` to the others."""
    number, take, poses = trial
    if model is None:
        recorded = recorded.of(np.delete(np.arange(len(recorded.q)), number))
        model = estimate(recorded, options).model
    try:
        return score_steps(model, recorded.chain, poses[:-1], recorded.v, poses[1:], recorded.measurement, rng.stream(*stream, number))
    except SingularJacobianError as error:
        raise SingularJacobianError(error.message, **error.evidence | {"take": take}) from None
