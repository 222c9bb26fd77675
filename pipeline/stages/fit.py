"""fit@model: the parameters of one motion model from the process noise of the training takes."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng, schema
from pipeline.compute.trials import run_trials
from pipeline.errors import ModelDomainError
from pipeline.motion.bootstrap import Estimator, estimator_of_takes, replicate, spreads
from pipeline.motion.decomposition import chosen
from pipeline.motion.estimation import Estimate, Recorded, estimate, mean_log_likelihood
from pipeline.motion.gaussian import frobenius
from pipeline.motion.gaussian_fit import GaussianFit
from pipeline.motion.wishart_fit import WishartFit
from pipeline.recordings.steps import training_steps

NOISE, OUT = Path("data/noise"), Path("data/fit")


def run(model: str) -> None:
    """Fit ``model`` and write ``data/fit/MODEL`` and the numbers the paper states to ``reports/metrics``."""
    settings = config.sections("fit", item=model)
    options, checks = vars(settings.models)[model], settings.scale.convex_checks
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion.rate)
    found = estimate(recorded, options)
    estimator = estimator_of_takes(recorded, options, found)
    trial = partial(_replicate, estimator=estimator, takes=len(recorded.q), stream=(settings.seed, f"fit.{model}.bootstrap"))
    numbers = range(settings.scale.bootstrap_replicates)
    replicates = list(run_trials(trial, numbers, compute=settings.compute, label=f"fit {model}: resamplings of the takes"))
    metrics = found.estimates | _standard_errors(replicates) | found.diagnostics | _likelihood(recorded, found)
    tables = {}
    match found.details:
        case WishartFit():
            metrics |= _convex_check(recorded, found.details, options, checks, rng.stream(settings.seed, f"fit.{model}"))
            norms, bound = frobenius(found.details.perturbations.s), found.details.perturbations.bound
            tables["perturbation"] = contracts.read("process_noise", NOISE)[["take", "part", "k", "t"]].assign(norm=norms, bound=bound)
        case GaussianFit() as ridge:
            largest = ridge.u - ridge.extension
            if options.estimator == "paper":
                from pipeline.motion.convex_check import noise_covariance_gap  # as below

                norms = frobenius(recorded.chain.inverse_jacobian(recorded.q.mean(axis=0)))
                checked = norms[np.linspace(0, len(norms) - 1, min(checks, len(norms))).astype(int)]
                metrics["convex_problems_checked"] = len(checked)
                metrics["convex_check_greatest_relative_gap"] = noise_covariance_gap(checked, ridge.alpha, ridge.u)
            excess = ridge.objectives - min(ridge.objective, ridge.objectives.min())
            u, mean_square = largest + ridge.extensions, found.diagnostics["rms_norm_of_the_inverse_jacobian"] ** 2
            level = ridge.alphas * np.sqrt(u**2 - mean_square)
            tables["ridge"] = pd.DataFrame({"u": u, "alpha": ridge.alphas, "level": level, "excess": excess})
    with contracts.replacing(OUT / model) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder)
        (folder / "parameters.json").write_text(json.dumps(found.parameters, indent=2) + "\n")
    contracts.write_metrics(metrics, Path(f"reports/metrics/fit_{model}.json"))


def _replicate(number: int, estimator: Estimator, takes: int, stream: tuple[int, str]) -> dict[str, float] | None:
    return replicate(estimator, takes, rng.stream(*stream, number))


def _standard_errors(replicates: list[dict[str, float] | None]) -> dict[str, float]:
    """By the bootstrap over takes, with the ends of the 95 % interval of each estimate."""
    found, lost = spreads(replicates)
    metrics = {}
    for name, spread in found.items():
        ends = {f"{name}_interval_low": spread.low, f"{name}_interval_high": spread.high}
        metrics |= {f"{name}_standard_error": spread.standard_error} | ends
    return metrics | {"bootstrap_replicates": len(replicates), "bootstrap_replicates_without_an_estimate": lost}


def _likelihood(recorded: Recorded, found: Estimate) -> dict[str, float]:
    """The measurement noise that is added to every step, and how likely the training takes are with it."""
    try:
        std = np.sqrt(np.diag(recorded.measurement))
    except ModelDomainError as error:
        print(f"fit: no log-likelihood of the training takes: {error}")
        return {}
    metrics = {f"measurement_noise_std_q{j + 1}_rad": std[j] for j in range(3)}
    return metrics | {"log_likelihood_per_step_nat": mean_log_likelihood(recorded, found.model)}


def _convex_check(
    recorded: Recorded, fit: WishartFit, options: schema.Wishart, checks: int, stream: np.random.Generator
) -> dict[str, float]:
    """How far the closed forms are from the convex problems as printed, at ``checks`` of the steps that move."""
    # imported here: CVXPY takes longer to import than most models to fit
    from pipeline.motion.convex_check import perturbation_gap

    q, noise = recorded.q.reshape(-1, 3), recorded.noise.reshape(-1, 3)
    problems = np.broadcast_to(recorded.v, recorded.q.shape).reshape(-1, 3)
    moving = np.flatnonzero(np.any(problems, axis=1))
    checked = np.sort(stream.choice(moving, min(checks, len(moving)), replace=False))
    decomposition = chosen(options.decomposition, options.left)
    gap = perturbation_gap(fit.perturbations, recorded.chain, q, problems, noise, decomposition, fit.weights, options.floor, checked)
    return {"convex_problems_checked": len(checked), "convex_check_greatest_relative_gap": gap}
