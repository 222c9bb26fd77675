"""wrench: numerical study of the matrix model of the wrench; measured and modelled force."""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Wrench
from pipeline.core.options.dataset import Force
from pipeline.wrench import measured_force as measuring
from pipeline.wrench import models
from pipeline.wrench.study import (
    averaged_sigma_s,
    expected_sigma_s,
    run_study,
    sigma_s_rows,
)

INGEST = Path("data/ingest/force")
OUT = Path("data/wrench")


def run() -> None:
    """Write the tables of the study, and of the configurations of the dataset's force records."""
    settings = config.sections("wrench")
    options = settings.wrench
    force = settings.dataset.force
    stream = rng.stream(settings.seed, "wrench.study")
    trials = partial(run_trials, compute=settings.compute)
    repeats = partial(trials, label="wrench: study")
    sigma, errors, spread = run_study(options, stream, repeats)
    tables = {"sigma_s": [sigma], "wrench_errors": [errors], "wrench_spread": [spread]}
    metrics = {}
    if force is None:
        print("wrench: the dataset has no force transducer; only the study is done")
    else:
        measuring.require_own_configuration(contracts.read("force", INGEST), force)
        measured = partial(
            _configuration,
            force=force,
            options=options,
            seed=settings.seed,
        )
        names = list(enumerate(force.configurations))
        for of_configuration in trials(measured, names, label="wrench: configurations"):
            for name, table in of_configuration.items():
                tables.setdefault(name, []).append(table)
            # eigenvalues set to zero, which the report counts
            for row in of_configuration["sigma_s"].drop_duplicates("form").itertuples():
                form = "" if row.form == "diagonal" else f"_{row.form}"
                metrics[f"{row.system_class}{form}_sigma_s_clipped"] = int(row.clipped)
    with contracts.replacing(OUT) as folder:
        for name, parts in tables.items():
            contracts.write(pd.concat(parts, ignore_index=True), name, folder)
        contracts.write_metrics(metrics, folder / "wrench.json")


def _configuration(
    trial: tuple[int, str],
    force: Force,
    options: Wrench,
    seed: int,
) -> dict[str, pd.DataFrame]:
    """Return the rows of one configuration: Σ_S, and moments, densities and tests of the wrench."""
    number, name = trial
    arrangement = force.configurations[trial[1]]
    stream = rng.stream(seed, "wrench.configuration", number)
    bounds = models.configuration_bounds(force, arrangement)
    nominal = models.nominal_system(force, arrangement)
    agents = len(arrangement.direction)
    rows = measuring.rows_of(nominal)
    estimates = averaged_sigma_s(
        models.draw_systems(bounds, options.systems, agents, stream),
    )
    expected = expected_sigma_s(bounds, agents, stream.spawn(1)[0])
    record = contracts.read("force", INGEST)
    record = record[record["configuration"] == name]
    if absent := [row for row in rows if row not in record or record[row].isna().any()]:
        raise ConfigError(
            f"the log has no {', '.join(absent)}, which the attachments require; remove them",
            key=f"dataset.force.configurations.{name}.attachment",
        )
    measured = measuring.measured_wrenches(record, nominal, force.length)
    tested = {form: estimate.mean for form, estimate in estimates.items()}
    # the actuation without a random matrix
    tested["none"] = np.zeros((len(rows), len(rows)))
    sample = (models.matrix_model(nominal), tested["diagonal"], len(measured), stream)
    wrenches = {"measured": measured, "modelled": models.sample_wrenches(*sample)}
    tests = [
        {"configuration": name, "form": form}
        | measuring.force_test(measured, nominal, sigma_s, stream)
        for form, sigma_s in tested.items()
    ]
    tables = {
        "sigma_s": sigma_s_rows(name, agents, estimates, expected),
        "force_moments": measuring.force_moments(name, wrenches, rows),
        "force_test": pd.DataFrame(tests),
    }
    if len(rows) == 2:
        return tables | {
            "force_density": measuring.force_density(name, wrenches, options.grid),
        }
    marginals = measuring.wrench_marginals(name, wrenches, rows, options.grid)
    return tables | {"wrench_marginals": marginals}
