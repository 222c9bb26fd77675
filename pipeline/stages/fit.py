"""fit@model: parameters of one motion model from the training takes, moments of realisations."""

import json
from functools import partial
from pathlib import Path
from typing import NamedTuple

from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.columns import spread
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ModelDomainError
from pipeline.models import bootstrap, kinds
from pipeline.models.closed_loop import FOLDER, SHARE, closed_loop_of
from pipeline.models.draws import mean_bias, realize_recorded
from pipeline.models.model import MotionModel
from pipeline.models.steps import Estimate, Options, Recorded
from pipeline.recordings.steps import training_steps
from pipeline.statistics.takes import NORMAL_QUANTILE

MOTION = Path("data/ingest/motion")
OUT = Path("data/fit")
Metrics = dict[str, float]


def run(model: str) -> None:
    """Write parameters, tables and numbers of ``model`` and its realisations to ``data/fit``."""
    settings = config.sections("fit", item=model)
    metrics = {}
    with contracts.replacing(OUT / model) as folder:
        if settings.dataset.robot is None:
            print("fit: the dataset has no robot; nothing to fit")
        else:
            metrics = _fit(model, settings, folder)
        contracts.write_metrics(metrics, folder / "fit.json")


class Fitted(NamedTuple):
    """Result of one estimator, None with the reason if it has none; estimates from resamplings of
    the takes, and the standard errors and intervals.
    """

    estimate: Estimate | None
    refused: str
    replicates: list[Metrics | None]
    errors: Metrics


def _fit(model: str, settings, folder: Path) -> Metrics:
    """Write parameters and tables to ``folder``; return numbers of fit and realisations."""
    options = vars(settings.models)[model]
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    fitted = _with_model(_fitted(model, recorded, settings, options))
    stream = rng.stream(settings.seed, f"fit.{model}")
    checks = settings.scale.convex_checks
    diagnosed, tables = kinds.diagnose(
        recorded,
        options,
        fitted.estimate,
        checks,
        stream,
    )
    metrics = {}
    for pattern, variant in kinds.estimator_options(options).items():
        by_estimator = fitted
        if variant != options:
            by_estimator = _fitted(model, recorded, settings, variant)
        if by_estimator.estimate is None:
            name = pattern.format("estimate")
            print(f"fit: {model}: no {name}: {by_estimator.refused}")
            continue
        if pattern.startswith("{}"):  # of a control only the estimates are written
            metrics |= by_estimator.estimate.diagnostics
        metrics |= by_estimator.estimate.named(pattern, by_estimator.errors)
    metrics["takes"] = len(recorded.q)
    for name, table in tables.items():
        contracts.write(table, name, folder)
    names, covariance = bootstrap.joint_covariance(fitted.replicates)
    of_estimates = {"estimates": names, "covariance": covariance}
    _write_json(of_estimates, folder / "covariance.json")
    if fitted.estimate is None:
        print(f"fit: no model {model}: {fitted.refused}")
        reason = {"kind": options.kind, kinds.NO_MODEL: fitted.refused}
        _write_json(reason, folder / "parameters.json")
        return metrics | diagnosed
    _write_json(fitted.estimate.parameters, folder / "parameters.json")
    metrics |= _own_numbers(fitted) | diagnosed
    metrics |= _closed_loop(model, recorded, options, fitted.estimate, folder)
    return metrics | _realise(model, fitted.estimate.model, recorded, settings, folder)


def _own_numbers(fitted: Fitted) -> Metrics:
    """Return estimates, errors, counts of resamplings and diagnostics of the model's estimator."""
    replicates = fitted.replicates
    counts = {
        "bootstrap_replicates": len(replicates),
        "bootstrap_replicates_without_an_estimate": replicates.count(None),
    }
    estimate = fitted.estimate
    return estimate.determined | fitted.errors | counts | estimate.diagnostics


def _with_model(fitted: Fitted) -> Fitted:
    """Return ``fitted``, or the reason if its estimate is out of the model's range."""
    try:
        if fitted.estimate is not None:
            _ = fitted.estimate.model
    except ModelDomainError as error:
        return Fitted(None, str(error), [], {})
    return fitted


def _fitted(model: str, recorded: Recorded, settings, options: Options) -> Fitted:
    """Return the estimate by ``options`` with the spread of resampled takes."""
    try:
        estimate = kinds.estimate(recorded, options)
    except ModelDomainError as error:
        return Fitted(None, str(error), [], {})
    takes = len(recorded.q)
    scale = settings.scale
    stream = (settings.seed, f"fit.{model}.bootstrap")
    fit = (recorded, options, estimate.from_takes)
    trial = partial(_replicate, fit=fit, stream=stream)
    if estimate.from_takes is not None:  # too quick for workers
        replicates = [trial(number) for number in range(scale.bootstrap_replicates)]
    else:
        workers = {"compute": settings.compute, "label": f"fit {model}: resamplings"}
        replicates = [*run_trials(trial, range(scale.bootstrap_refits), **workers)]
    spreads = bootstrap.spreads(replicates, estimate.estimates, takes)
    for name in estimate.undetermined:
        spreads.pop(name, None)
    errors = _uncertainty(spreads, takes >= bootstrap.LEAST_TAKES)
    return Fitted(estimate, "", replicates, errors)


def _replicate(number: int, fit: tuple, stream: tuple[int, str]) -> Metrics | None:
    return bootstrap.replicate(*fit, rng.stream(*stream, number))


def _uncertainty(
    spreads: dict[str, bootstrap.Spread],
    with_ends: bool = True,
) -> Metrics:
    """Return standard errors and, ``with_ends``, 95 % intervals by the names of the estimates."""
    metrics = {}
    for name, spread_of_takes in spreads.items():
        metrics[f"{name}_standard_error"] = spread_of_takes.standard_error
        if with_ends:
            metrics[f"{name}_interval_low"] = spread_of_takes.low
            metrics[f"{name}_interval_high"] = spread_of_takes.high
    return metrics


def _closed_loop(
    model: str,
    recorded: Recorded,
    options: Options,
    estimate: Estimate,
    folder: Path,
) -> Metrics:
    """Write the closed loop's parameters; return κ with its interval, and the estimates."""
    closed, refused = closed_loop_of(recorded, options, estimate)
    if refused:
        print(f"fit: {model} has no closed loop: {refused}")
    if closed is None:
        return {}
    parameters = closed.estimate.parameters | {SHARE: closed.share}
    _write_json(parameters, folder / FOLDER / "parameters.json")
    half = NORMAL_QUANTILE * closed.standard_error
    spread = bootstrap.Spread(
        closed.standard_error,
        closed.share - half,
        closed.share + half,
    )
    estimates = {
        f"closed_loop_{name}": n for name, n in closed.estimate.determined.items()
    }
    return {SHARE: closed.share} | _uncertainty({SHARE: spread}) | estimates


def _write_json(values: dict[str, object], file: Path) -> None:
    contracts.write_text(json.dumps(values, indent=2) + "\n", file)


def _realise(
    model: str,
    fitted: MotionModel,
    recorded: Recorded,
    settings,
    folder: Path,
) -> Metrics:
    """Write the moments of realisations that start at the training takes' poses in turn."""
    options = settings.simulation
    stream = rng.stream(settings.seed, f"simulate.{model}")
    try:
        realized = realize_recorded(
            fitted,
            recorded,
            options.mode,
            options.realizations,
            stream,
        )
    except ModelDomainError as error:
        evidence = {"model": model} | error.evidence
        raise ModelDomainError(error.message, **evidence) from None
    if realized.refused:
        print(f"fit: {model} has no standard deviation: {realized.refused}")
    moments = spread("m", recorded.joints, realized.mean)
    moments |= spread("s", recorded.joints, realized.deviation)
    moments["bias"] = mean_bias(fitted, recorded.chain, recorded.poses, recorded.v)
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    contracts.write(grid.assign(**moments), "moments", folder)
    return {
        "simulated_steps_with_clipped_noise": realized.clipped,
        "realizations_lost_at_a_singular_pose": realized.lost,
    }
