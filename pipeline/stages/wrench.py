"""wrench: the numerical study of the matrix model, and the force of the cooperating robots,
measured against modelled.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.core import config, contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Wrench
from pipeline.core.options.instruments import Force
from pipeline.wrench.bounds import (
    configuration_bounds,
    draw_systems,
    nominal_system,
    study_bounds,
)
from pipeline.wrench.matrix import FORMS, matrix_model, sample_wrenches
from pipeline.wrench.measured_force import (
    force_density,
    force_moments,
    force_test,
    measured_wrenches,
    rows_of,
    wrench_marginals,
    wrench_planes,
)
from pipeline.wrench.study import (
    averaged_sigma_s,
    expected_sigma_s,
    run_study,
    sigma_s_rows,
)

INGEST, OUT = Path("data/ingest/force"), Path("data/wrench")
# of a form of Σ_S in the names of metrics
NAME_OF = {"diagonal": "", "full": "_full", "none": "_without_sigma_s"}
ENTRY = re.compile("s[1-9][1-9]")


def run() -> None:
    """Tables of the study, and of the configurations where the dataset has a force transducer."""
    settings = config.sections("wrench")
    options, force = settings.wrench, settings.dataset.force
    sigma, errors, spread = run_study(
        study_bounds(options),
        options.agents,
        options.systems,
        options.test_systems,
        options.repeats,
        rng.stream(settings.seed, "wrench.study"),
        partial(run_trials, compute=settings.compute, label="wrench: study"),
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
                name: pd.concat([own[name] for own in done if name in own], ignore_index=True)
                for name in dict.fromkeys(name for own in done for name in own)
            }
            metrics |= _configuration_metrics(
                tables["sigma_s"], tables["force_moments"], tables["force_test"]
            )
            sigma = pd.concat([sigma, tables.pop("sigma_s")], ignore_index=True)
            for name, table in tables.items():
                contracts.write(table, name, folder)
        contracts.write(sigma, "sigma_s", folder)
        contracts.write_metrics(metrics, folder / "wrench.json")


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
    kinds = {
        "": "s",
        "_standard_error": "se",
        "_expected": "e",
        "_expected_standard_error": "ee",
    }
    for row in sigma.to_dict("records"):
        name = f"{row['system_class']}{NAME_OF[row['form']]}_sigma_s"
        entries = [column[1:] for column in row if ENTRY.fullmatch(column)]
        for ij in (ij for ij in entries if row["form"] != "diagonal" or ij[0] == ij[1]):
            metrics |= {f"{name}_{ij}{kind}": row[column + ij] for kind, column in kinds.items()}
        metrics[f"{name}_clipped"] = row["clipped"]
    for row in moments.to_dict("records"):
        source = f"{row.pop('configuration')}_{row.pop('source')}"
        del row["samples"]
        metrics |= {f"{source}_{name}": value for name, value in row.items()}
    for row in tests.to_dict("records"):
        name, form = row.pop("configuration"), row.pop("form")
        of_form = {
            f"{name}{NAME_OF[form]}_{key}": row.pop(key)
            for key in ("energy_distance", "two_sample_p_value")
        }
        metrics |= of_form
        if form == "diagonal":
            metrics |= {f"{name}_{key}": value for key, value in row.items()}
    # of another configuration's rows there is nothing
    return {name: value for name, value in metrics.items() if not pd.isna(value)}


def _configuration(
    trial: tuple[int, str], force: Force, options: Wrench, seed: int
) -> dict[str, pd.DataFrame]:
    """Rows of one configuration: Σ_S of its bounds; moments, densities and tests of its measured
    wrench and of draws of the model.
    """
    number, name = trial
    configuration = force.configurations[name]
    stream = rng.stream(seed, "wrench.configuration", number)
    bounds, nominal = (
        configuration_bounds(force, configuration),
        nominal_system(force, configuration),
    )
    agents, rows = len(configuration.direction), rows_of(nominal)
    estimates = averaged_sigma_s(draw_systems(bounds, options.systems, agents, stream))
    expected = expected_sigma_s(bounds, agents, stream.spawn(1)[0])
    record = contracts.read("force", INGEST)
    record = record[record["configuration"] == name]
    if absent := [row for row in rows if row not in record or record[row].isna().any()]:
        raise ConfigError(
            f"the log holds no {', '.join(absent)}, which the attachments require; remove them",
            key=f"dataset.force.configurations.{name}.attachment",
        )
    measured = measured_wrenches(record, nominal, force.length)
    sigma_s = estimates["diagonal"].mean
    modelled = sample_wrenches(matrix_model(nominal), sigma_s, len(measured), stream)
    wrenches = {"measured": measured, "modelled": modelled}
    # the actuation alone, without a random matrix, is what the model has to be better than
    tested = {form: estimate.mean for form, estimate in estimates.items()} | {
        "none": np.zeros((len(rows), len(rows)))
    }
    tests = [
        {"configuration": name, "form": form} | force_test(measured, nominal, sigma_s, stream)
        for form, sigma_s in tested.items()
    ]
    tables = {
        "sigma_s": pd.DataFrame(sigma_s_rows(name, agents, estimates, expected)),
        "force_moments": force_moments(name, wrenches, rows),
        "force_test": pd.DataFrame(tests),
    }
    if len(rows) == 2:
        return tables | {"force_density": force_density(name, wrenches, options.grid)}
    return tables | {
        "wrench_planes": wrench_planes(name, wrenches, rows, options.grid),
        "wrench_marginals": wrench_marginals(name, wrenches, rows, options.grid),
    }
