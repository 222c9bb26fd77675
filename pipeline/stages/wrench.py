"""wrench: the numerical study of the matrix model, and the force of the cooperating robots,
measured against modelled.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core import config, contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Wrench
from pipeline.core.options.force import Force
from pipeline.wrench.bounds import Bounds
from pipeline.wrench.expectation import expected_sigma_s
from pipeline.wrench.matrix import FORMS
from pipeline.wrench.measured_force import force_density, force_moments, force_test, modelled_forces
from pipeline.wrench.parametric import CableSystem
from pipeline.wrench.study import estimate_sigma_s, sigma_s_rows, study_repeat, study_tables

INGEST, OUT = Path("data/ingest/force"), Path("data/wrench")
# of a form of Σ_S in the names of metrics
NAME_OF = {"diagonal": "", "full": "_full", "none": "_without_sigma_s"}


def run() -> None:
    """Tables of the study, and of the configurations where the dataset has a force transducer."""
    settings = config.sections("wrench")
    options, force = settings.wrench, settings.dataset.force
    bounds = Bounds(
        tuple(options.tension),
        tuple(options.direction),
        tuple(options.tension_std),
        tuple(options.kappa),
    )
    repeats = list(enumerate(rng.stream(settings.seed, "wrench.study").spawn(options.repeats)))
    repeat = partial(
        study_repeat,
        bounds=bounds,
        agents=options.agents,
        systems=options.systems,
        tests=options.test_systems,
    )
    sigma, errors, spread = study_tables(
        run_trials(repeat, repeats, compute=settings.compute, label="wrench: study")
    )
    metrics = _study_metrics(errors, spread)
    with contracts.replacing(OUT) as folder:
        contracts.write(errors, "wrench_errors", folder)
        contracts.write(spread, "wrench_spread", folder)
        if force is None:
            print("wrench: the dataset has no force transducer; the study alone is done")
        else:
            configuration = partial(
                _configuration, force=force, options=options, seed=settings.seed
            )
            names = list(enumerate(force.configurations))
            done = list(
                run_trials(
                    configuration, names, compute=settings.compute, label="wrench: configurations"
                )
            )
            tables = {
                name: pd.concat([tables[name] for tables in done], ignore_index=True)
                for name in done[0]
            }
            metrics |= _configuration_metrics(
                tables["sigma_s"], tables["force_moments"], tables["force_test"]
            )
            sigma = pd.concat([sigma, tables.pop("sigma_s")], ignore_index=True)
            for name, table in tables.items():
                contracts.write(table, name, folder)
        contracts.write(sigma, "sigma_s", folder)
    contracts.write_metrics(metrics, Path("reports/metrics/wrench.json"))


def _study_metrics(errors: pd.DataFrame, spread: pd.DataFrame) -> dict[str, float]:
    """Errors of the study by number of cables."""
    metrics = {}
    for m, rows in errors.groupby("agents"):
        metrics[f"study_m{m}_mean_error"] = rows["error"].mean()
        metrics[f"study_m{m}_greatest_error"] = rows["error"].max()
        for form in FORMS:
            metrics[f"study_m{m}_mean_covariance_error_{form}"] = rows[
                f"covariance_error_{form}"
            ].mean()
    for m, rows in spread.groupby("agents"):
        metrics[f"study_m{m}_greatest_error_median_over_repeats"] = rows["maximum"].median()
    return metrics


def _configuration_metrics(
    sigma: pd.DataFrame, moments: pd.DataFrame, tests: pd.DataFrame
) -> dict[str, float]:
    """Σ_S, moments and two-sample tests of the configurations; names say the form of Σ_S where it
    is not the paper's diagonal one.
    """
    metrics = {}
    for row in sigma.itertuples():
        for ij in ("11", "22") if row.form == "diagonal" else ("11", "12", "22"):
            name = f"{row.system_class}{NAME_OF[row.form]}_sigma_s_{ij}"
            kinds = {
                "": "s",
                "_standard_error": "se",
                "_expected": "e",
                "_expected_standard_error": "ee",
            }
            metrics |= {name + kind: getattr(row, column + ij) for kind, column in kinds.items()}
        metrics[f"{row.system_class}{NAME_OF[row.form]}_sigma_s_clipped"] = row.clipped
    for row in moments.itertuples():
        metrics |= {
            f"{row.configuration}_{row.source}_{name}": getattr(row, name)
            for name in ("fx", "fy", "var_fx", "var_fy", "cov")
        }
    for row in tests.itertuples():
        for name in ("energy_distance", "two_sample_p_value"):
            metrics[f"{row.configuration}{NAME_OF[row.form]}_{name}"] = getattr(row, name)
        if row.form == "diagonal":
            metrics |= {
                f"{row.configuration}_{name}": getattr(row, name)
                for name in (
                    "effective_samples",
                    "tested_samples",
                    "matrix_share_fx",
                    "matrix_share_fy",
                )
            }
    return metrics


def _configuration(
    trial: tuple[int, str], force: Force, options: Wrench, seed: int
) -> dict[str, pd.DataFrame]:
    """Rows of one configuration: Σ_S of its bounds; moments, densities and tests of its measured
    force and of draws of the model.
    """
    number, name = trial
    configuration = force.configurations[name]
    stream = rng.stream(seed, "wrench.configuration", number)
    bounds = Bounds(
        tuple(force.tension_bounds),
        tuple(configuration.direction_bounds),
        tuple(force.tension_std_bounds),
        tuple(force.kappa_bounds),
    )
    agents = len(configuration.direction)
    estimates = estimate_sigma_s(bounds, options.systems, agents, stream)
    expected = expected_sigma_s(bounds, agents, stream.spawn(1)[0])
    record = contracts.read("force", INGEST)
    measured = record.loc[record["configuration"] == name, ["fx", "fy"]].to_numpy()
    # the matrix model knows no law of the directions: the concentration is given and does not enter
    # it
    concentration = np.full(agents, force.kappa_bounds[0])
    nominal = CableSystem(
        configuration.tension, configuration.direction, force.tension_std, concentration
    )
    forces = {
        "measured": measured,
        "modelled": modelled_forces(nominal, estimates["diagonal"].mean, len(measured), stream),
    }
    # the actuation alone, without a random matrix, is what the model has to be better than
    tested = {form: estimate.mean for form, estimate in estimates.items()} | {
        "none": np.zeros((2, 2))
    }
    tests = [
        {"configuration": name, "form": form} | force_test(measured, nominal, sigma_s, stream)
        for form, sigma_s in tested.items()
    ]
    return {
        "sigma_s": pd.DataFrame(sigma_s_rows(name, agents, estimates, expected)),
        "force_moments": force_moments(name, forces),
        "force_density": force_density(name, forces, options.grid),
        "force_test": pd.DataFrame(tests),
    }
