"""Moments, densities and a test of the measured wrench against the matrix model.

``wrenches`` maps a source (measured or modelled) to samples (N, n) in N of the wrench ``rows``,
named as in the table ``force``; moments are divided by a characteristic length. A function named
after a table returns the rows of one ``configuration`` in the table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Force
from pipeline.statistics import densities
from pipeline.wrench import models

# rows of forces and of moments in the plane and in space
ROWS = {2: (("fx", "fy"), ("mz",)), 3: (("fx", "fy", "fz"), ("mx", "my", "mz"))}
GRID_REACH = 4.0  # extent of the grid beyond the means, in standard deviations of the wider source
DRAWS = 10  # model samples for every tested sample, which add a tenth to the sampling variance
# nats by which a force record may miss its own configuration, and share at which another is nearer:
# records of the laboratory miss theirs by up to 0.1 and the others by 1 to 6
MISSED, NEARER = 0.5, 0.5
# standard deviations of the nominal law by which a mean force may be off the desired force: up to
# 0.1 in the laboratory, 0.7 in 10 s of a record; 1.2 or more for exchanged axes or a loaded tare
MOST_OFF = 1.0
Wrenches = Mapping[str, ndarray]


def rows_of(system: models.CableSystem) -> tuple[str, ...]:
    """Return the names of the n wrench rows: forces, then moments if cables have attachments."""
    forces, moments = ROWS[system.dimension]
    return forces if system.attachment is None else forces + moments


def measured_wrenches(
    record: pd.DataFrame, system: models.CableSystem, length: float
) -> ndarray:
    """Return the rows (N, n) in N of ``record`` that ``system`` has; moments over ``length`` m."""
    rows = rows_of(system)
    return record[list(rows)].to_numpy() / [
        1.0 if row[0] == "f" else length for row in rows
    ]


def require_own_configuration(record: pd.DataFrame, force: Force) -> None:
    """Raise RecordingError where the forces of a configuration in ``record`` are nearer to the
    nominal law of another one (Kullback-Leibler divergence of normal laws, in nats), or where their
    mean is more than MOST_OFF standard deviations of the nominal law off the desired force.
    """
    kappa, laws = float(np.sqrt(np.prod(force.kappa_bounds))), {}
    for name, robots in force.configurations.items():
        system = replace(models.nominal_system(force, robots), attachment=None)
        system = replace(
            system, concentration=np.full_like(system.concentration, kappa)
        )
        laws[name] = models.wrench_mean(system), models.wrench_covariance(system)
    for name, rows in record.groupby("configuration"):
        desired, covariance = laws[name]
        samples = rows[["fx", "fy", "fz"][: len(desired)]].to_numpy()
        mean, scatter = samples.mean(axis=0), np.cov(samples.T)
        far = {}
        for other, law in laws.items():
            if len(law[0]) == len(desired):
                far[other] = _divergence(mean, scatter, *law)
        nearest = min(far, key=far.__getitem__)
        off = float(np.sqrt(_square_over(mean - desired, covariance)))
        means = f"the mean force of {name} is {mean.round(2).tolist()} N, desired "
        means += f"{desired.round(2).tolist()}"
        if far[name] > MISSED and far[nearest] < NEARER * far[name]:
            message = f"{means}; with its covariance it is {far[name]:.2g} nats from {name} and "
            message += f"{far[nearest]:.2g} from {nearest} ({laws[nearest][0].round(2).tolist()} "
            message += "N): are the logs exchanged?"
            key = f"dataset.force.configurations.{name}.file"
        elif off > MOST_OFF:
            ratio = np.linalg.norm(mean) / np.linalg.norm(desired)
            message = (
                f"{means}: {off:.2g} standard deviations of the desired force off, more than "
                f"{MOST_OFF:g} ({ratio:.3g} times as great). Check the unit of the log (1 lbf is "
                "4.448 N), signs and order of its axes, that the tare interval is unloaded, and "
                "direction and tension of the cables"
            )
            key = f"dataset.force.configurations.{name}"
        else:
            continue
        file = force.configurations[name].file
        raise RecordingError(message, file=file, key=key)


def _divergence(mean: ndarray, cov: ndarray, desired: ndarray, by: ndarray) -> float:
    ratio = np.linalg.solve(by, cov)
    log = np.linalg.slogdet(ratio)[1] if np.linalg.det(cov) > 0 else -np.inf
    off = _square_over(mean - desired, by)
    return float(0.5 * (np.trace(ratio) - len(mean) - log + off))


def _square_over(deviation: ndarray, covariance: ndarray) -> float:
    return float(deviation @ np.linalg.solve(covariance, deviation))


def force_moments(
    configuration: str, wrenches: Wrenches, rows: Sequence[str]
) -> pd.DataFrame:
    """Return the table ``force_moments``."""
    table = []
    for source, sample in wrenches.items():
        covariance, row = np.cov(sample, rowvar=False), {"configuration": configuration}
        row |= {"source": source} | dict(zip(rows, sample.mean(axis=0), strict=True))
        row |= dict(
            zip([f"var_{name}" for name in rows], np.diag(covariance), strict=True)
        )
        table.append(row | {"cov": covariance[0, 1], "samples": len(sample)})
    return pd.DataFrame(table)


def common_grid(samples: Sequence[ndarray], points: int) -> ndarray:
    """Return a grid (points, n) of the rows of ``samples`` (N, n), from GRID_REACH of the greatest
    standard deviation below the least mean to as much above the greatest mean.
    """
    centres = np.array([sample.mean(axis=0) for sample in samples])
    reach = GRID_REACH * np.max([sample.std(axis=0) for sample in samples], axis=0)
    return np.linspace(centres.min(axis=0) - reach, centres.max(axis=0) + reach, points)


def force_density(configuration: str, wrenches: Wrenches, points: int) -> pd.DataFrame:
    """Return the table ``force_density`` of samples (N, 2) on a grid ``points`` × ``points``."""
    x, y = common_grid([*wrenches.values()], points).T
    fx, fy = (axis.ravel() for axis in np.meshgrid(x, y, indexing="ij"))
    tables = []
    for source, sample in wrenches.items():
        bandwidth = densities.normal_reference_bandwidth(sample)
        density = densities.kernel_density(sample, x, y, bandwidth).ravel()
        columns = {"configuration": configuration, "source": source}
        tables.append(pd.DataFrame(columns | {"fx": fx, "fy": fy, "density": density}))
    return pd.concat(tables, ignore_index=True)


def wrench_marginals(
    configuration: str, wrenches: Wrenches, rows: Sequence[str], points: int
) -> pd.DataFrame:
    """Return the table ``wrench_marginals``: density of each row at ``points`` common values."""
    tables, grid = [], common_grid([*wrenches.values()], points)
    for (i, row), (source, sample) in product(enumerate(rows), wrenches.items()):
        columns = {"configuration": configuration, "source": source, "row": row}
        columns |= {"value": grid[:, i]}
        density = densities.marginal_density(sample[:, i], grid[:, i])
        tables.append(pd.DataFrame(columns | {"density": density}))
    return pd.concat(tables, ignore_index=True)


def force_test(
    measured: ndarray,
    system: models.CableSystem,
    sigma_s: ndarray,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Test whether the record ``measured`` (N, n) in N has the law of the matrix model at the
    nominal ``system`` (m,) with ``sigma_s`` (n, n).

    Return the energy distance (N) and its permutation p-value, between the record, thinned to
    independent samples, and DRAWS times as many model samples; the effective samples N/τ, τ the
    autocorrelation time; and the share of each variance that Σ_S causes, which limits the power.
    """
    model = models.matrix_model(system)
    shares = 1 - np.diag(model.actuation_part()) / np.diag(model.covariance(sigma_s))
    independent = densities.thin_record(measured)
    modelled = models.sample_wrenches(model, sigma_s, DRAWS * len(independent), rng)
    distance, p_value = densities.energy_test(independent, modelled, rng)
    return {
        "energy_distance": distance,
        "two_sample_p_value": p_value,
        "effective_samples": len(measured) / densities.autocorrelation_time(measured),
        "tested_samples": len(independent),
    } | {
        f"matrix_share_{row}": share
        for row, share in zip(rows_of(system), shares, strict=True)
    }
