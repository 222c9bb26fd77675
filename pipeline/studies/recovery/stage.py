"""recovery: what the estimators and the scores say of data whose law is known: parameters returned,
the paper's σ̂_B over the choices that the paper leaves open, and every model against the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import MISSING

from pipeline.core import config, contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import SolverError
from pipeline.core.options.analysis import Compute
from pipeline.models.kinds import build_model, estimate, fitted_model, truths
from pipeline.models.options import Options as Model
from pipeline.models.steps import Recorded, Truth
from pipeline.models.wishart.dispersion import rest_noise
from pipeline.models.wishart.perturbation import objective_weights
from pipeline.recordings.steps import training_steps
from pipeline.studies import page
from pipeline.studies.recovery.choices import sigma_b_over_choices
from pipeline.studies.recovery.controls import control_scores
from pipeline.studies.recovery.known_laws import drawn
from pipeline.studies.recovery.parameters import Trial, recover, recovery_table, thinned
from pipeline.studies.recovery.words import TITLE, sections

HERE = Path(__file__).parent
FIT, OUT = Path("data/fit"), page.DATA / "recovery"
SHARES = np.geomspace(1e-5, 1e3, 33)  # of the α₂/α₁ that the stage fit takes
FLOORS = np.linspace(0.05, 0.4, 8)

Case = tuple[str, Model, Truth]  # name of the estimator's option, the option, what is drawn


@dataclass
class Options:
    """Option files of models, and the size of the study."""

    estimators: list[str] = MISSING  # that are to return known parameters
    dispersions: list[float] = MISSING  # σ_B of data drawn from the Wishart model
    takes: int = MISSING  # of each data set
    stride: int = MISSING  # of its steps, every so many-th of the recorded motion
    datasets: int = MISSING  # drawn with the same known parameters
    beside: list[str] = MISSING  # models that are scored beside the run's own
    control_takes: int = MISSING  # of each control recording, to fit to and as many to score on


def run() -> None:
    """Draw, estimate, and compare with what was drawn."""
    settings = config.sections("recovery", HERE / "dvc.yaml")
    options, compute = config.study_options(HERE, Options), settings.compute
    recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
    rests = not np.all(np.any(recorded.v, axis=1))
    tables = {}
    if rests:
        part = thinned(recorded, options.takes, options.stride)
        estimators = config.model_options(options.estimators)
        tables = {
            "parameter_recovery": _parameters(part, estimators, options, settings.seed, compute),
            "sigma_b_choices": _choices(part, estimators, options, settings.seed, compute),
            "control_scores": _controls(recorded, settings, options),
        }
    with contracts.replacing(OUT) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder, HERE / "tables.yaml")
    page.draw_figures("recovery", {"joints": settings.dataset.robot.joints}, compute)
    if rests:
        kinds = {name: model.kind for name, model in settings.models.items()}
        page.write_page("recovery", TITLE, sections(**tables, kinds=kinds))
    else:
        lacking = "The motion never rests, so that the measurement noise is not known."
        print(f"recovery: {lacking}")
        page.write_page("recovery", TITLE, [lacking])


def _parameters(
    recorded: Recorded,
    estimators: Mapping[str, Model],
    options: Options,
    seed: int,
    compute: Compute,
) -> pd.DataFrame:
    """The table ``parameter_recovery``."""
    cases = [
        (name, model, truth)
        for name, model in estimators.items()
        for truth in truths(recorded, model, options.dispersions)
    ]
    trials = [(case, number) for number in range(options.datasets) for case in cases]
    trial = partial(_recover, recorded=recorded, seed=seed)
    recovered = list(run_trials(trial, trials, compute=compute, label="recovery: data sets"))
    tables = [
        recovery_table(truth, recovered[i :: len(cases)]).assign(data=truth.label, estimator=name)
        for i, (name, _, truth) in enumerate(cases)
    ]
    return pd.concat(tables, ignore_index=True)


def _recover(trial: tuple[Case, int], recorded: Recorded, seed: int) -> Trial | None:
    (_, model, truth), number = trial
    # of the data's label and not of the estimator's, so that all estimators are given the same data
    return recover(recorded, truth, model, rng.stream(seed, f"recover.{truth.label}", number))


def _choices(
    recorded: Recorded,
    estimators: Mapping[str, Model],
    options: Options,
    seed: int,
    compute: Compute,
) -> pd.DataFrame:
    """The table ``sigma_b_choices``."""
    sweeps = [
        sweep
        for name, model in estimators.items()
        if model.kind == "wishart" and model.estimator == "paper"
        for sweep in _sweeps(recorded, name, model, options.dispersions, seed)
    ]
    trial = partial(_sweep, recorded=recorded)
    swept = run_trials(trial, sweeps, compute=compute, label="recovery: choices")
    return pd.concat(swept, ignore_index=True)


def _sweeps(
    recorded: Recorded, name: str, model: Model, dispersions: list[float], seed: int
) -> list[tuple[dict[str, object], Model, Recorded]]:
    """The data whose σ̂_B is shown over the choices: the recordings, and data of known σ_B, with
    the measurement noise and without.
    """
    sweeps = [({"estimator": name, "source": "recorded", "truth": np.nan}, model, recorded)]
    exact = replace(recorded, known_measurement=np.zeros_like(recorded.measurement))
    for truth in truths(recorded, model, dispersions):
        for source, geometry in (("drawn", recorded), ("drawn without measurement noise", exact)):
            stream = rng.stream(seed, f"recover.{truth.label}")
            data = drawn(build_model(truth.parameters), geometry, stream)
            names = {"estimator": name, "source": source, "truth": truth.values["sigma_b"]}
            sweeps.append((names, model, data))
    return sweeps


def _sweep(trial: tuple[dict[str, object], Model, Recorded], recorded: Recorded) -> pd.DataFrame:
    """At the weights that the noise at rest gives the recordings, and at shares of their ratio."""
    names, model, data = trial
    resting = rest_noise(recorded.noise, recorded.v, recorded.known_measurement)
    alpha1, alpha2 = objective_weights(resting, len(recorded.chain.task))
    return sigma_b_over_choices(data, model, alpha2 / alpha1, SHARES, FLOORS).assign(**names)


def _controls(recorded: Recorded, settings, options: Options) -> pd.DataFrame:
    """The table ``control_scores``."""
    beside = config.model_options([name for name in options.beside if name not in settings.models])
    fitted = {name: fitted_model(FIT / name) for name in settings.models}
    for name, model in list(beside.items()):
        try:
            fitted[name] = estimate(recorded, model).model
        except SolverError as error:
            print(f"recovery: {name} is left out of the controls: {error}")
            del beside[name]
    takes = recorded.subset(np.arange(options.control_takes) % len(recorded.q))
    run = partial(run_trials, compute=settings.compute, label="recovery: controls")
    return control_scores(takes, settings.models | beside, fitted, settings.seed, run)
