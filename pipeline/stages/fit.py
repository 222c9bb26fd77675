"""fit@model: parameters of one motion model from the process noise of the training takes, and
moments of its realisations along the commanded motion.
"""

import json
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.core import config, contracts, rng
from pipeline.core.columns import spread
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ModelDomainError
from pipeline.models import bootstrap, kinds
from pipeline.models.closed_loop import FOLDER, SHARE, closed_loop_of
from pipeline.models.draws import realize, realized_moments
from pipeline.models.model import MotionModel
from pipeline.models.steps import Estimate, Options, Recorded, mean_log_likelihood
from pipeline.recordings.steps import training_steps
from pipeline.statistics.takes import NORMAL_QUANTILE

MOTION, TRACK, OUT = Path("data/ingest/motion"), Path("data/track"), Path("data/fit")
UNBOUNDED = "u_unbounded"  # diagnostic that is written of every estimator
Metrics = dict[str, float]


def run(model: str) -> None:
    """Fit ``model`` and realise it; tables and numbers go to ``data/fit``."""
    settings, metrics = config.sections("fit", item=model), ({}, {})
    with contracts.replacing(OUT / model) as folder:
        if settings.dataset.robot is None:
            print("fit: the dataset has no robot; nothing to fit")
        else:
            metrics = _fit(model, settings, folder)
        for name, numbers in zip(("fit", "simulate"), metrics, strict=True):
            contracts.write_metrics(numbers, folder / f"{name}.json")


def _fit(model: str, settings, folder: Path) -> tuple[Metrics, Metrics]:
    """Write parameters and tables below ``folder``; numbers of the fit and of its realisations."""
    options, scale = vars(settings.models)[model], settings.scale
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    resampled = partial(_resampled, model, recorded, settings)
    estimate, reason = _estimate(recorded, options, model=True)
    stream = rng.stream(settings.seed, f"fit.{model}")
    looked_at, tables = kinds.diagnose(recorded, options, estimate, scale.convex_checks, stream)
    replicates, uncertainty = resampled(estimate, options)
    metrics = {}
    for pattern, each in kinds.estimator_options(options).items():
        own, refused, errors = estimate, reason, uncertainty
        if each != options:
            own, refused = _estimate(recorded, each)
            _, errors = resampled(own, each)
        if own is None:
            print(f"fit: {model}: no {pattern.format('estimate')}: {refused}")
            continue
        if pattern.startswith("{}"):  # of the control its estimates alone
            metrics |= own.diagnostics
        unbounded = {name: n for name, n in own.diagnostics.items() if name == UNBOUNDED}
        for name, value in (own.estimates | errors | unbounded).items():
            stem = next(base for base in (*own.estimates, UNBOUNDED) if name.startswith(base))
            metrics[pattern.format(stem) + name.removeprefix(stem)] = value
    metrics["takes"] = len(recorded.q)
    if estimate is not None:
        metrics |= estimate.estimates | uncertainty
        metrics["bootstrap_replicates"] = len(replicates)
        metrics["bootstrap_replicates_without_an_estimate"] = replicates.count(None)
        metrics |= estimate.diagnostics
    metrics |= _likelihood(recorded, estimate) | looked_at
    for name, table in tables.items():
        contracts.write(table, name, folder)
    names, covariance = bootstrap.joint_covariance(replicates)
    _write_json({"estimates": names, "covariance": covariance}, folder / "covariance.json")
    if estimate is None:
        print(f"fit: no model {model}: {reason}")
        parameters, realised = {"kind": options.kind, kinds.NO_MODEL: reason}, {}
    else:
        parameters = estimate.parameters
        metrics |= _closed_loop(model, recorded, options, estimate, folder, settings)
        realised = _realise(model, estimate.model, recorded, settings, folder)
    _write_json(parameters, folder / "parameters.json")
    return metrics, realised


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


def _resampled(
    model: str, recorded: Recorded, settings, estimate: Estimate | None, options: Options
) -> tuple[list[Metrics | None], Metrics]:
    """Estimates from resamplings of the takes, the same takes for every estimator; their standard
    errors, with the ends of 95 % intervals where there are enough takes. Neither for an estimate at
    an end of its search.
    """
    if estimate is None:
        return [], {}
    takes, numbers = len(recorded.q), range(settings.scale.bootstrap_replicates)
    estimator = bootstrap.resampled_estimator(recorded, options, estimate)
    stream = (settings.seed, f"fit.{model}.bootstrap")
    trial = partial(_replicate, estimator=estimator, takes=takes, stream=stream)
    if estimate.from_takes is not None:  # too quick for workers
        replicates = [trial(number) for number in numbers]
    else:
        label = f"fit {model}: resamplings"
        replicates = list(run_trials(trial, numbers, compute=settings.compute, label=label))
    metrics = {}
    for name, values in bootstrap.spreads(replicates)[0].items():
        if name not in estimate.undetermined:
            ends = {"standard_error": values.standard_error}
            if takes >= bootstrap.LEAST_TAKES:
                ends |= {"interval_low": values.low, "interval_high": values.high}
            metrics |= {f"{name}_{end}": value for end, value in ends.items()}
    return replicates, metrics


def _replicate(
    number: int, estimator: bootstrap.Estimator, takes: int, stream: tuple[int, str]
) -> Metrics | None:
    return bootstrap.replicate(estimator, takes, rng.stream(*stream, number))


def _closed_loop(
    model: str, recorded: Recorded, options: Options, estimate: Estimate, folder: Path, settings
) -> Metrics:
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


def _likelihood(recorded: Recorded, estimate: Estimate | None) -> Metrics:
    """Measurement noise of every step, and the training takes' log-likelihood with it."""
    try:
        std = np.sqrt(np.diag(recorded.measurement))
    except ModelDomainError as error:
        print(f"fit: no log-likelihood of the training takes: {error}")
        return {}
    names = [f"measurement_noise_std_{joint}_rad" for joint in recorded.joints]
    measured = dict(zip(names, std, strict=True))
    if estimate is not None:
        measured["log_likelihood_per_step_nat"] = mean_log_likelihood(recorded, estimate.model)
    return measured


def _realise(
    model: str, fitted: MotionModel, recorded: Recorded, settings, folder: Path
) -> Metrics:
    """Write the moments of realisations from the training takes' poses in turn."""
    options, joints = settings.simulation, contracts.read("joints", TRACK)
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    _, q = contracts.stacked(joints[joints.part == "training"], "q")
    starts = np.resize(q, (options.realizations, *q.shape[1:]))
    course = (recorded.chain, starts, recorded.v, options.mode)
    stream = rng.stream(settings.seed, f"simulate.{model}")
    simulated, clipped, lost = realize(fitted, *course, stream)
    try:
        mean, deviation, refused = realized_moments(fitted, *course, simulated)
    except ModelDomainError as error:
        raise ModelDomainError(error.message, **{"model": model} | error.evidence) from None
    if refused:
        print(f"fit: the spread of {model} is a gap, as a sample's would mean nothing: {refused}")
    moments = spread("m", recorded.joints, mean) | spread("s", recorded.joints, deviation)
    contracts.write(grid.assign(**moments), "moments", folder)
    return {
        "steps": simulated[:, 1:, 0].size,
        "steps_with_clipped_noise": clipped,
        "realizations_lost_at_a_singular_pose": lost,
    }
