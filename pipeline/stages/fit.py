"""fit@model: parameters of one motion model from the process noise of the training takes, and
realisations of it along the commanded motion.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core import config, contracts, rng
from pipeline.core.columns import spread
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ModelDomainError
from pipeline.models import bootstrap, kinds
from pipeline.models.closed_loop import FOLDER, SHARE, closed_loop_of
from pipeline.models.draws import realize, realized_moments
from pipeline.models.model import MotionModel
from pipeline.models.options import Options
from pipeline.models.steps import Estimate, Recorded, mean_log_likelihood
from pipeline.recordings.steps import training_steps
from pipeline.statistics.takes import NORMAL_QUANTILE

MOTION, TRACK, OUT = Path("data/ingest/motion"), Path("data/track"), Path("data/fit")
OF_EACH = ("u_unbounded",)  # diagnostics that are written of every estimator
Replicates = list[dict[str, float] | None]


def run(model: str) -> None:
    """Fit ``model`` and realise it; tables and numbers go to ``data/fit``."""
    settings = config.sections("fit", item=model)
    with contracts.replacing(OUT / model) as folder:
        fitted, realised = {}, {}
        if settings.dataset.robot is None:
            print("fit: the dataset has no robot; nothing to fit")
        else:
            fitted, realised = _fit(model, settings, folder)
        contracts.write_metrics(fitted, folder / "fit.json")
        contracts.write_metrics(realised, folder / "simulate.json")


def _fit(model: str, settings, folder: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Write parameters and tables below ``folder``; numbers of the fit and of its realisations."""
    options = vars(settings.models)[model]
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    estimate, reason = _estimate(recorded, options, model=True)
    stream = rng.stream(settings.seed, f"fit.{model}")
    takes, tables = len(recorded.q), kinds.examined(recorded, options, estimate, stream)
    own, replicates = {"takes": takes}, []
    if estimate is not None:
        replicates = _replicates(model, recorded, estimate, options, settings)
        own |= estimate.estimates | _uncertainty(estimate, replicates, takes)
        own |= estimate.diagnostics
    metrics = _compared(model, recorded, options, estimate, settings) | own
    metrics |= _likelihood(recorded, estimate)
    for name, table in tables.items():
        contracts.write(table, name, folder)
    names, covariance = bootstrap.joint_covariance(replicates)
    _write_json({"estimates": names, "covariance": covariance}, folder / "covariance.json")
    if estimate is None:
        print(f"fit: no model {model}: {reason}")
        parameters = {"kind": options.kind, kinds.NO_MODEL: reason}
        _write_json(parameters, folder / "parameters.json")
        return metrics, {}
    _write_json(estimate.parameters, folder / "parameters.json")
    metrics |= _closed_loop(model, recorded, options, estimate, settings, folder)
    return metrics, _realise(model, estimate.model, recorded, settings, folder)


def _estimate(
    recorded: Recorded, options: Options, *, model: bool = False
) -> tuple[Estimate | None, str]:
    """The estimate of ``options``, or why the recordings give none, or none that is a ``model``."""
    try:
        found = kinds.estimate(recorded, options)
        if model:
            _ = found.model
        return found, ""
    except ModelDomainError as error:
        return None, str(error)


def _compared(
    model: str, recorded: Recorded, options: Options, estimate: Estimate | None, settings
) -> dict[str, float]:
    """Estimates of every estimator with uncertainty; the reason of a refused one is printed."""
    metrics = {}
    for pattern, each in kinds.compared(options).items():
        own, reason = (estimate, "") if each == options else _estimate(recorded, each)
        if own is None:
            print(f"fit: {model}: no {pattern.format('estimate')}: {reason}")
            continue
        replicates = _replicates(model, recorded, own, each, settings)
        known = own.estimates | _uncertainty(own, replicates, len(recorded.q), counts=False)
        known |= {name: own.diagnostics[name] for name in OF_EACH if name in own.diagnostics}
        if pattern.startswith("{}"):  # of the control its estimates alone
            metrics |= own.diagnostics
        for name, value in known.items():
            stem = next(base for base in (*own.estimates, *OF_EACH) if name.startswith(base))
            metrics[pattern.format(stem) + name.removeprefix(stem)] = value
    return metrics


def _closed_loop(
    model: str, recorded: Recorded, options: Options, estimate: Estimate, settings, folder: Path
) -> dict[str, float]:
    """Write the closed loop's parameters; return κ and K with standard errors and intervals."""
    closed, refused = closed_loop_of(recorded, options, estimate)
    if refused:
        print(f"fit: {model} has no closed loop: {refused}")
    if closed is None:
        return {}
    parameters = closed.estimate.parameters | {SHARE: closed.share}
    _write_json(parameters, folder / FOLDER / "parameters.json")
    units, metrics = {SHARE: 1.0, "closed_loop_gain_per_s": settings.dataset.motion.rate}, {}
    for name, unit in units.items():
        value, error = unit * closed.share, unit * closed.standard_error
        metrics |= {name: value, f"{name}_standard_error": error}
        metrics[f"{name}_interval_low"] = value - NORMAL_QUANTILE * error
        metrics[f"{name}_interval_high"] = value + NORMAL_QUANTILE * error
    own = {f"closed_loop_{name}": value for name, value in closed.estimate.estimates.items()}
    return metrics | {"closed_loop_rounds": closed.rounds} | own


def _write_json(values: dict[str, object], file: Path) -> None:
    contracts.write_text(json.dumps(values, indent=2) + "\n", file)


def _replicates(
    model: str, recorded: Recorded, estimate: Estimate, options: Options, settings
) -> Replicates:
    """The estimates from resamplings of the takes, the same takes for every estimator."""
    estimator = bootstrap.resampled_estimator(recorded, options, estimate)
    stream = (settings.seed, f"fit.{model}.bootstrap")
    trial = partial(_replicate, estimator=estimator, takes=len(recorded.q), stream=stream)
    numbers, label = range(settings.scale.bootstrap_replicates), f"fit {model}: resamplings"
    if estimate.from_takes is not None:  # too quick for workers
        return [trial(number) for number in numbers]
    return list(run_trials(trial, numbers, compute=settings.compute, label=label))


def _replicate(
    number: int, estimator: bootstrap.Estimator, takes: int, stream: tuple[int, str]
) -> dict[str, float] | None:
    return bootstrap.replicate(estimator, takes, rng.stream(*stream, number))


def _uncertainty(
    estimate: Estimate, replicates: Replicates, takes: int, *, counts: bool = True
) -> dict[str, float]:
    """Standard errors by the bootstrap over takes, with the ends of 95 % intervals where there are
    enough takes; neither of an estimate at an end of its search.
    """
    by_name, lost = bootstrap.spreads(replicates)
    metrics = {}
    for name, values in by_name.items():
        if name in estimate.undetermined:
            continue
        metrics[f"{name}_standard_error"] = values.standard_error
        if takes >= bootstrap.LEAST_TAKES:
            metrics |= {f"{name}_interval_low": values.low, f"{name}_interval_high": values.high}
    numbers = {"bootstrap_replicates": len(replicates)}
    numbers["bootstrap_replicates_without_an_estimate"] = lost
    return metrics | numbers if counts else metrics


def _likelihood(recorded: Recorded, estimate: Estimate | None) -> dict[str, float]:
    """Measurement noise of every step, and the training takes' log-likelihood with it."""
    try:
        std = np.sqrt(np.diag(recorded.measurement))
    except ModelDomainError as error:
        print(f"fit: no log-likelihood of the training takes: {error}")
        return {}
    names = [f"measurement_noise_std_{joint}_rad" for joint in recorded.joints]
    measured = dict(zip(names, std, strict=True))
    if estimate is not None:
        likelihood = mean_log_likelihood(recorded, estimate.model)
        measured["log_likelihood_per_step_nat"] = likelihood
    return measured


def _realise(
    model: str, fitted: MotionModel, recorded: Recorded, settings, folder: Path
) -> dict[str, float]:
    """Write realisations from the training takes' poses in turn, and their moments."""
    options, joints = settings.simulation, contracts.read("joints", TRACK)
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    _, q = contracts.stacked(joints[joints.part == "training"], "q")
    starts = np.resize(q, (options.realizations, *q.shape[1:]))
    course = (recorded.chain, starts, recorded.v, options.mode)
    simulated, clipped, lost = realize(
        fitted, *course, rng.stream(settings.seed, f"simulate.{model}")
    )
    try:
        mean, deviation, refused = realized_moments(fitted, *course, simulated)
    except ModelDomainError as error:
        raise ModelDomainError(error.message, **{"model": model} | error.evidence) from None
    if refused:
        print(f"fit: the spread of {model} is a gap, as a sample's would mean nothing: {refused}")
    numbers = np.repeat(np.arange(len(simulated)), len(grid))
    rows = pd.concat([grid] * len(simulated), ignore_index=True)
    rows = rows.assign(realization=numbers, **spread("q", recorded.joints, simulated))
    contracts.write(rows.dropna(), "realizations", folder)
    moments = spread("m", recorded.joints, mean) | spread("s", recorded.joints, deviation)
    contracts.write(grid.assign(**moments), "moments", folder)
    return {
        "steps": simulated[:, 1:, 0].size,
        "steps_with_clipped_noise": clipped,
        "realizations_lost_at_a_singular_pose": lost,
    }
