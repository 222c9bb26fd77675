"""fit@model: parameters of one motion model from the training takes, moments of realisations."""

import json
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.columns import spread
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ModelDomainError
from pipeline.models import bootstrap, kinds
from pipeline.models.closed_loop import FOLDER, SHARE, closed_loop_of
from pipeline.models.draws import mean_bias, realize, realized_moments
from pipeline.models.model import MotionModel
from pipeline.models.steps import Estimate, Options, Recorded
from pipeline.recordings.steps import training_steps
from pipeline.statistics.takes import NORMAL_QUANTILE

MOTION, TRACK, OUT = Path("data/ingest/motion"), Path("data/track"), Path("data/fit")
UNBOUNDED = "u_unbounded"  # diagnostic that is written for every estimator
Metrics = dict[str, float]


def run(model: str) -> None:
    """Write parameters, tables and numbers of ``model`` and its realisations to ``data/fit``."""
    settings, metrics = config.sections("fit", item=model), {}
    with contracts.replacing(OUT / model) as folder:
        if settings.dataset.robot is None:
            print("fit: the dataset has no robot; nothing to fit")
        else:
            metrics = _fit(model, settings, folder)
        contracts.write_metrics(metrics, folder / "fit.json")


def _fit(model: str, settings, folder: Path) -> Metrics:
    """Write parameters and tables to ``folder``; return numbers of fit and realisations."""
    options = vars(settings.models)[model]
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    estimated, metrics = partial(_estimated, model, recorded, settings), {}
    estimate, reason, replicates, uncertainty = estimated(options, build=True)
    stream = rng.stream(settings.seed, f"fit.{model}")
    checks = settings.scale.convex_checks
    numbers, tables = kinds.diagnose(recorded, options, estimate, checks, stream)
    for pattern, variant in kinds.estimator_options(options).items():
        result, refused, errors = estimate, reason, uncertainty
        if variant != options:
            result, refused, _, errors = estimated(variant)
        if result is None:
            print(f"fit: {model}: no {pattern.format('estimate')}: {refused}")
            continue
        if pattern.startswith(
            "{}"
        ):  # else a control, of which only the estimates are written
            metrics |= result.diagnostics
        unbounded = {
            name: n for name, n in result.diagnostics.items() if name == UNBOUNDED
        }
        for name, value in (result.determined | errors | unbounded).items():
            stem = next(
                base for base in (*result.estimates, UNBOUNDED) if name.startswith(base)
            )
            metrics[pattern.format(stem) + name.removeprefix(stem)] = value
    metrics["takes"] = len(recorded.q)
    for name, table in tables.items():
        contracts.write(table, name, folder)
    names, covariance = bootstrap.joint_covariance(replicates)
    _write_json(
        {"estimates": names, "covariance": covariance}, folder / "covariance.json"
    )
    if estimate is None:
        print(f"fit: no model {model}: {reason}")
        _write_json(
            {"kind": options.kind, kinds.NO_MODEL: reason}, folder / "parameters.json"
        )
        return metrics | numbers
    _write_json(estimate.parameters, folder / "parameters.json")
    counts = {"bootstrap_replicates": len(replicates)}
    counts["bootstrap_replicates_without_an_estimate"] = replicates.count(None)
    metrics |= (
        estimate.determined | uncertainty | counts | estimate.diagnostics | numbers
    )
    metrics |= _closed_loop(model, recorded, options, estimate, folder)
    return metrics | _realise(model, estimate.model, recorded, settings, folder)


def _estimated(
    model: str, recorded: Recorded, settings, options: Options, *, build: bool = False
) -> tuple[Estimate | None, str, list[Metrics | None], Metrics]:
    """Return the estimate by ``options``, or None and the reason; then estimates from resamplings
    of the takes, and the standard errors and intervals. ``build`` requires a model too.
    """
    try:
        estimate = kinds.estimate(recorded, options)
        _ = build and estimate.model
    except ModelDomainError as error:
        return None, str(error), [], {}
    takes, scale = len(recorded.q), settings.scale
    stream = (settings.seed, f"fit.{model}.bootstrap")
    trial = partial(
        _replicate, fit=(recorded, options, estimate.from_takes), stream=stream
    )
    if estimate.from_takes is not None:  # too quick for workers
        replicates = [*map(trial, range(scale.bootstrap_replicates))]
    else:
        workers = {"compute": settings.compute, "label": f"fit {model}: resamplings"}
        replicates = [*run_trials(trial, range(scale.bootstrap_refits), **workers)]
    spreads = bootstrap.spreads(replicates, estimate.estimates, takes)
    known = {
        name: own for name, own in spreads.items() if name not in estimate.undetermined
    }
    return estimate, "", replicates, _uncertainty(known, takes >= bootstrap.LEAST_TAKES)


def _replicate(number: int, fit: tuple, stream: tuple[int, str]) -> Metrics | None:
    return bootstrap.replicate(*fit, rng.stream(*stream, number))


def _uncertainty(
    spreads: dict[str, bootstrap.Spread], with_ends: bool = True
) -> Metrics:
    """Return standard errors and, ``with_ends``, 95 % intervals by the names of the estimates."""
    metrics = {}
    for name, own in spreads.items():
        metrics[f"{name}_standard_error"] = own.standard_error
        if with_ends:
            metrics |= {
                f"{name}_interval_low": own.low,
                f"{name}_interval_high": own.high,
            }
    return metrics


def _closed_loop(
    model: str, recorded: Recorded, options: Options, estimate: Estimate, folder: Path
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
        closed.standard_error, closed.share - half, closed.share + half
    )
    estimates = {
        f"closed_loop_{name}": n for name, n in closed.estimate.determined.items()
    }
    return {SHARE: closed.share} | _uncertainty({SHARE: spread}) | estimates


def _write_json(values: dict[str, object], file: Path) -> None:
    contracts.write_text(json.dumps(values, indent=2) + "\n", file)


def _realise(
    model: str, fitted: MotionModel, recorded: Recorded, settings, folder: Path
) -> Metrics:
    """Write the moments of realisations that start at the training takes' poses in turn."""
    options, joints = settings.simulation, contracts.read("joints", TRACK)
    _, q = contracts.stacked(joints[joints.part == "training"], "q")
    starts = np.resize(q, (options.realizations, *q.shape[1:]))
    course = (fitted, recorded.chain, starts, recorded.v, options.mode)
    simulated, clipped, lost = realize(
        *course, rng.stream(settings.seed, f"simulate.{model}")
    )
    try:
        mean, deviation, refused = realized_moments(*course, simulated)
    except ModelDomainError as error:
        raise ModelDomainError(
            error.message, **{"model": model} | error.evidence
        ) from None
    if refused:
        print(f"fit: {model} has no standard deviation: {refused}")
    moments = spread("m", recorded.joints, mean) | spread(
        "s", recorded.joints, deviation
    )
    moments["bias"] = mean_bias(fitted, recorded.chain, q, recorded.v)
    grid = contracts.read("trajectory", MOTION)[["k", "t"]]
    contracts.write(grid.assign(**moments), "moments", folder)
    return {
        "simulated_steps_with_clipped_noise": clipped,
        "realizations_lost_at_a_singular_pose": lost,
    }
