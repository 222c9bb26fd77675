"""wrench: the numerical study of the matrix model, and the force of the cooperating robots measured against modelled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng, schema
from pipeline.wrench.comparison import force_density, force_moments, modelled_forces
from pipeline.wrench.parametric import CableSystem
from pipeline.wrench.study import Bounds, estimate_sigma_s, run_study, sigma_s_row

INGEST, OUT = Path("data/ingest"), Path("data/wrench")


def run() -> None:
    """Tables of the study, and of the configurations where the dataset has a force transducer."""
    settings = config.sections("wrench")
    options, force = settings.wrench, settings.dataset.force
    bounds = Bounds(tuple(options.tension), tuple(options.direction), tuple(options.tension_std), tuple(options.kappa))
    stream = rng.stream(settings.seed, "wrench.study")
    sigma, errors, spread = run_study(bounds, options.agents, options.systems, options.test_systems, options.repeats, stream)
    metrics = {}
    for m, rows in errors.groupby("agents"):
        metrics[f"study_m{m}_mean_error"] = rows["error"].mean()
        metrics[f"study_m{m}_greatest_error"] = rows["error"].max()
    for m, rows in spread.groupby("agents"):
        metrics[f"study_m{m}_greatest_error_median_over_repeats"] = rows["maximum"].median()
    with contracts.replacing(OUT) as folder:
        contracts.write(errors, "wrench_errors", folder)
        contracts.write(spread, "wrench_spread", folder)
        if force is None:
            print("wrench: the dataset has no force transducer; the study alone is done")
        else:
            rows = [_configuration(number, name, force, options, settings.seed) for number, name in enumerate(force.configurations)]
            sigma = pd.concat([sigma, pd.DataFrame([row for row, _, _ in rows])], ignore_index=True)
            moments = pd.concat([table for _, table, _ in rows], ignore_index=True)
            contracts.write(moments, "force_moments", folder)
            contracts.write(pd.concat([table for _, _, table in rows], ignore_index=True), "force_density", folder)
            metrics |= {
                f"{row['system_class']}_sigma_s_{i}{i}{kind}": row[f"{'se' if kind else 's'}{i}{i}"]
                for row, _, _ in rows for i in (1, 2) for kind in ("", "_standard_error")
            }  # fmt: skip
            metrics |= {
                f"{row.configuration}_{row.source}_{name}": getattr(row, name)
                for row in moments.itertuples() for name in ("fx", "fy", "var_fx", "var_fy", "cov")
            }  # fmt: skip
        contracts.write(sigma, "sigma_s", folder)
    contracts.write_metrics(metrics, Path("reports/metrics/wrench.json"))


def _configuration(
    number: int, name: str, force: schema.Force, options: schema.Wrench, seed: int
) -> tuple[dict, pd.DataFrame, pd.DataFrame]:
    """Σ_S of one configuration's bounds; moments and densities of its measured force and of as many draws of the model."""
    configuration = force.configurations[name]
    stream = rng.stream(seed, "wrench.configuration", number)
    bounds = Bounds(
        tuple(force.tension_bounds), tuple(configuration.direction_bounds), tuple(force.tension_std_bounds), tuple(force.kappa_bounds)
    )
    agents = len(configuration.direction)
    estimate = estimate_sigma_s(bounds, options.systems, agents, stream)
    record = contracts.read("force", INGEST)
    measured = record.loc[record["configuration"] == name, ["fx", "fy"]].to_numpy()
    # the matrix model knows no law of the directions: the concentration is given and does not enter it
    concentration = np.full(agents, force.kappa_bounds[0])
    nominal = CableSystem(configuration.tension, configuration.direction, force.tension_std, concentration)
    forces = {"measured": measured, "modelled": modelled_forces(nominal, estimate.mean, len(measured), stream)}
    return sigma_s_row(name, agents, estimate), force_moments(name, forces), force_density(name, forces, options.grid)
