"""recover: data drawn with known parameters through every estimator, and the paper's σ̂_B over the choices that the paper leaves open."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng, schema
from pipeline.compute.trials import run_trials
from pipeline.motion.build import build_model
from pipeline.motion.control import drawn
from pipeline.motion.estimation import Recorded
from pipeline.motion.perturbation import objective_weights
from pipeline.motion.recovery import Trial, Truth, recover, recovery_table, thinned, truths
from pipeline.motion.weights import sigma_b_over_choices
from pipeline.motion.wishart_fit import rest_noise
from pipeline.recordings.steps import training_steps

OUT = Path("data/recover")
SHARES = np.geomspace(1e-5, 1e3, 33)  # of the α₂/α₁ that the stage fit takes
FLOORS = np.linspace(0.05, 0.4, 8)

Case = tuple[str, schema.Model, Truth]  # name of the estimator's option, the option, what is drawn


def run() -> None:
    """Draw, estimate, and compare with what was drawn."""
    settings = config.sections("recover")
    recovery = settings.recovery
    steps = training_steps(settings.dataset.robot, settings.dataset.motion.rate)
    with contracts.replacing(OUT) as folder:
        if np.all(np.any(steps.v, axis=1)):
            print("recover: the motion never rests, so that the measurement noise is not known; nothing is drawn")
            return
        recorded = thinned(steps, recovery.takes, recovery.stride)
        cases = [
            (name, options, truth)
            for name, options in recovery.estimators.items()
            for truth in truths(recorded, options, recovery.dispersions)
        ]
        trials = [(case, number) for number in range(recovery.datasets) for case in cases]
        trial = partial(_recover, recorded=recorded, seed=settings.seed)
        found = list(run_trials(trial, trials, compute=settings.compute, label="recover: data sets"))
        tables = [
            recovery_table(truth, found[i :: len(cases)]).assign(data=truth.label, estimator=name)
            for i, (name, _, truth) in enumerate(cases)
        ]
        contracts.write(pd.concat(tables, ignore_index=True), "parameter_recovery", folder)
        sweeps = [
            sweep
            for name, options in recovery.estimators.items()
            if isinstance(options, schema.Wishart) and options.estimator == "paper"
            for sweep in _sweeps(recorded, name, options, recovery.dispersions, settings.seed)
        ]
        choices = run_trials(partial(_sweep, recorded=recorded), sweeps, compute=settings.compute, label="recover: choices")
        contracts.write(pd.concat(choices, ignore_index=True), "sigma_b_choices", folder)


def _recover(trial: tuple[Case, int], recorded: Recorded, seed: int) -> Trial | None:
    (_, options, truth), number = trial
    # of the data's label and not of the estimator's, so that all estimators are given the same data
    return recover(recorded, truth, options, rng.stream(seed, f"recover.{truth.label}", number))


def _sweeps(
    recorded: Recorded, name: str, options: schema.Wishart, dispersions: list[float], seed: int
) -> list[tuple[dict[str, object], schema.Wishart, Recorded]]:
    """Whose σ̂_B is to be seen over the choices: the recordings', and data's of known σ_B, with the measurement noise and without."""
    sweeps = [({"estimator": name, "source": "recorded", "truth": np.nan}, options, recorded)]
    exact = replace(recorded, known_measurement=np.zeros((3, 3)))
    for truth in truths(recorded, options, dispersions):
        for source, geometry in (("drawn", recorded), ("drawn without measurement noise", exact)):
            data = drawn(build_model(truth.parameters), geometry, rng.stream(seed, f"recover.{truth.label}"))
            sweeps.append(({"estimator": name, "source": source, "truth": truth.values["sigma_b"]}, options, data))
    return sweeps


def _sweep(trial: tuple[dict[str, object], schema.Wishart, Recorded], recorded: Recorded) -> pd.DataFrame:
    """At the weights that the noise at rest gives the recordings, and at shares of their ratio."""
    names, options, data = trial
    alpha1, alpha2 = objective_weights(rest_noise(recorded.noise, recorded.v), 3)
    return sigma_b_over_choices(data, options, alpha2 / alpha1, SHARES, FLOORS).assign(**names)
