"""evaluate@model: the one-step predictions of one fitted motion model, scored on the test takes, which no fit has seen."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng
from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import load_arm
from pipeline.compute import run_trials
from pipeline.errors import ModelDomainError, SingularJacobianError
from pipeline.motion.build import fitted_model
from pipeline.motion.model import MotionModel
from pipeline.motion.noise import measurement_covariance
from pipeline.statistics.scores import energy_score, log_determinant, nees

INGEST, TRACK, NOISE = Path("data/ingest"), Path("data/track"), Path("data/noise")
FIT, OUT = Path("data/fit"), Path("data/evaluate")
ENSEMBLE = 50  # draws per step for the energy score, whose estimate is unbiased for any number
JOINTS = ["q1", "q2", "q3"]


def run(model: str) -> None:
    """Score every step of every test take; to each model the measurement noise recorded at rest is added alike."""
    settings = config.sections("evaluate", item=model)
    robot, rate = settings.dataset.robot, settings.dataset.motion.rate
    joints = contracts.read("joints", TRACK)
    held_out = joints[joints.part == "test"]
    with contracts.replacing(OUT / model) as folder:
        if held_out.empty:
            print("evaluate: the dataset has no test takes; no prediction is scored")
            return
        v = contracts.read("trajectory", INGEST)[["vx", "vz", "vphi"]].to_numpy()[:-1] / rate
        if np.all(np.any(v, axis=1)):
            print("evaluate: the motion never rests, so that the measurement noise is not known; no prediction is scored")
            return
        _, noise = contracts.stacked(contracts.read("process_noise", NOISE), ["w1", "w2", "w3"])
        names, q = contracts.stacked(held_out, JOINTS)
        trial = partial(
            _score_take, model=fitted_model(FIT / model), chain=load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain,
            v=v, measurement=measurement_covariance(noise, v), stream=(settings.seed, f"evaluate.{model}"),
        )  # fmt: skip
        trials = list(zip(range(len(names)), names, q, strict=True))
        scored = run_trials(trial, trials, workers=settings.compute.workers, label=f"evaluate {model}: takes")
        rows = held_out.loc[held_out.k > 0, ["take", "part", "k", "t"]].reset_index(drop=True)
        table = pd.concat([scores for scores, _ in scored], ignore_index=True)
        contracts.write(pd.concat([rows, table], axis=1), "one_step_scores", folder)
    for what in dict.fromkeys(what for _, reasons in scored for what in reasons):
        found = [reasons[what] for _, reasons in scored if what in reasons]
        print(f"evaluate: {model} gives no {what} in {len(found)} of {len(names)} takes: {found[0]}")


def _score_take(
    trial: tuple[int, str, np.ndarray], model: MotionModel, chain: PlanarChain, v: np.ndarray, measurement: np.ndarray,
    stream: tuple[int, str],
) -> tuple[pd.DataFrame, dict[str, str]]:  # fmt: skip
    """The scores of the steps of one take, and why those that the model cannot give are missing."""
    number, take, poses = trial
    q, after, moving = poses[:-1], poses[1:], np.any(v, axis=1)
    reasons: dict[str, str] = {}
    try:
        table = {
            "moving": moving,
            "log_density": _existing(lambda: model.log_density(chain, q, v, after, measurement), moving.shape, "log density", reasons),
            "log_density_noiseless": np.full(len(q), np.nan),
            "energy": _energy(model, chain, q, v, after, measurement, rng.stream(*stream, number)),
        }
        table["log_density_noiseless"][moving] = _existing(
            lambda: model.log_density(chain, q[moving], v[moving], after[moving]),
            moving.sum(), "log density without measurement noise", reasons,
        )  # fmt: skip
        calibration = _existing(lambda: _calibration(model, chain, q, v, after, measurement), (5, len(q)), "mean and covariance", reasons)
    except SingularJacobianError as error:
        raise SingularJacobianError(error.message, **error.evidence | {"take": take}) from None
    table |= dict(zip(("z1", "z2", "z3", "nees", "log_determinant"), calibration, strict=True))
    return pd.DataFrame(table), reasons


def _existing(values: Callable[[], np.ndarray], shape: object, what: str, reasons: dict[str, str]) -> np.ndarray:
    """``values``, or a gap of ``shape`` where the model has none; then the reason is kept under ``what``."""
    try:
        return values()
    except ModelDomainError as error:
        reasons[what] = str(error)
        return np.full(shape, np.nan)


def _energy(
    model: MotionModel, chain: PlanarChain, q: np.ndarray, v: np.ndarray, after: np.ndarray, measurement: np.ndarray,
    stream: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    shape = (ENSEMBLE, *q.shape)
    drawn, _ = model.sample(chain, np.broadcast_to(q, shape), np.broadcast_to(v, shape), stream)
    return energy_score(drawn + stream.multivariate_normal(np.zeros(3), measurement, shape[:-1]), after)


def _calibration(
    model: MotionModel, chain: PlanarChain, q: np.ndarray, v: np.ndarray, after: np.ndarray, measurement: np.ndarray
) -> np.ndarray:
    """(5, M) the error in standard deviations of each joint, its NEES, and the log determinant of the covariance."""
    error, covariance = after - model.mean(chain, q, v), model.covariance(chain, q, v) + measurement
    scaled = error / np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return np.vstack([scaled.T, nees(error, covariance), log_determinant(covariance)])
