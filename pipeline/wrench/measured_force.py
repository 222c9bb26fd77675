"""Moments, densities and a test of the measured wrench against the matrix model.

``wrenches`` maps a source (measured or modelled) to samples (N, n) in N of the wrench ``rows``,
named as in the table ``force``; moments are divided by a characteristic length. A function named
after a table returns the rows of one ``configuration`` in the table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy import ndarray

from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Arrangement, Force
from pipeline.statistics import densities
from pipeline.wrench import models

# rows of forces and of moments in the plane and in space
ROWS = {2: (("fx", "fy"), ("mz",)), 3: (("fx", "fy", "fz"), ("mx", "my", "mz"))}
GRID_REACH = 4.0  # extent of the grid beyond the means, in standard deviations of the wider source
DRAWS = 10  # model samples for every tested sample, which add a tenth to the sampling variance
# nats by which a force record may miss its own configuration, and share at which another is nearer:
# records of the laboratory miss theirs by up to 0.1 and the others by 1 to 6
MISSED = 0.5
NEARER = 0.5
# standard deviations of the nominal law by which a mean force may be off the desired force: up to
# 0.1 in the laboratory, 0.7 in 10 s of a record; 1.2 or more for exchanged axes or a loaded tare
MOST_OFF = 1.0
Wrenches = Mapping[str, ndarray]


def rows_of(system: models.CableSystem) -> tuple[str, ...]:
    """Return the names of the n wrench rows: forces, then moments if cables have attachments."""
    forces, moments = ROWS[system.dimension]
    return forces if system.attachment is None else forces + moments


def measured_wrenches(
    record: pd.DataFrame,
    system: models.CableSystem,
    length: float,
) -> ndarray:
    """Return the rows (N, n) in N of ``record`` that ``system`` has; moments over ``length`` m."""
    rows = rows_of(system)
    units = [1.0 if row.startswith("f") else length for row in rows]
    return record[list(rows)].to_numpy() / units


def require_own_configuration(record: pd.DataFrame, force: Force) -> None:
    """Raise RecordingError where the forces of a configuration in ``record`` are nearer to the
    nominal law of another one (Kullback-Leibler divergence of normal laws, in nats), or where their
    mean is more than MOST_OFF standard deviations of the nominal law off the desired force.
    """
    laws = {}
    for name, robots in force.configurations.items():
        laws[name] = _nominal_law(force, robots)
    for name, rows in record.groupby("configuration"):
        samples = rows[["fx", "fy", "fz"][: len(laws[name].mean)]].to_numpy()
        measured = NormalLaw(samples.mean(axis=0), np.cov(samples.T))
        if fault := _mistaken(name, measured, laws) or _off(name, measured, laws[name]):
            key, message = fault
            file = force.configurations[name].file
            place = f"dataset.force.configurations.{name}{key}"
            raise RecordingError(message, file=file, key=place)


class NormalLaw(NamedTuple):
    """Normal law of the force of one configuration."""

    mean: ndarray  # (p,) N
    covariance: ndarray  # (p, p) N²

    def divergence_from(self, law: "NormalLaw") -> float:
        """Return the Kullback-Leibler divergence of this law from ``law`` in nats."""
        ratio = np.linalg.solve(law.covariance, self.covariance)
        log = -np.inf
        if np.linalg.det(self.covariance) > 0:
            log = np.linalg.slogdet(ratio)[1]
        off = law.square_over(self.mean)
        return float(0.5 * (np.trace(ratio) - len(self.mean) - log + off))

    def square_over(self, force: ndarray) -> float:
        """Return the square of the distance of ``force`` (p,) from the mean, in covariances."""
        deviation = force - self.mean
        return float(deviation @ np.linalg.solve(self.covariance, deviation))


def _nominal_law(force: Force, robots: Arrangement) -> NormalLaw:
    """Return the law of the force of ``robots`` at the middle of the bounds of κ."""
    kappa = float(np.sqrt(np.prod(force.kappa_bounds)))
    system = models.nominal_system(force, robots)
    concentration = np.full_like(system.concentration, kappa)
    system = replace(system, attachment=None, concentration=concentration)
    return NormalLaw(models.wrench_mean(system), models.wrench_covariance(system))


def _mistaken(
    name: str,
    measured: NormalLaw,
    laws: Mapping[str, NormalLaw],
) -> tuple[str, str] | None:
    """Return key and message where ``measured`` is nearer to another of the ``laws`` than to that
    of its configuration ``name``, else None.
    """
    distances = {}
    for configuration, law in laws.items():
        if len(law.mean) == len(measured.mean):
            distances[configuration] = measured.divergence_from(law)
    nearest = min(distances, key=distances.__getitem__)
    missed = distances[name]
    if missed <= MISSED or distances[nearest] >= NEARER * missed:
        return None
    other_mean = laws[nearest].mean.round(2).tolist()
    message = (
        f"{_means(name, measured, laws[name])}; with its covariance it is {missed:.2g} nats from "
        f"{name} and {distances[nearest]:.2g} from {nearest} ({other_mean} N): are the logs "
        "exchanged?"
    )
    return ".file", message


def _off(name: str, measured: NormalLaw, law: NormalLaw) -> tuple[str, str] | None:
    """Return key and message where the mean force is far off the desired force, else None."""
    off = float(np.sqrt(law.square_over(measured.mean)))
    if off <= MOST_OFF:
        return None
    ratio = np.linalg.norm(measured.mean) / np.linalg.norm(law.mean)
    message = (
        f"{_means(name, measured, law)}: {off:.2g} standard deviations of the desired force off, "
        f"more than {MOST_OFF:g} ({ratio:.3g} times as great). Check the unit of the log (1 lbf is "
        "4.448 N), signs and order of its axes, that the tare interval is unloaded, and "
        "direction and tension of the cables"
    )
    return "", message


def _means(name: str, measured: NormalLaw, law: NormalLaw) -> str:
    mean = measured.mean.round(2).tolist()
    desired = law.mean.round(2).tolist()
    return f"the mean force of {name} is {mean} N, desired {desired}"


def force_moments(
    configuration: str,
    wrenches: Wrenches,
    rows: Sequence[str],
) -> pd.DataFrame:
    """Return the table ``force_moments``."""
    table = []
    for source, sample in wrenches.items():
        covariance = np.cov(sample, rowvar=False)
        variances = [f"var_{name}" for name in rows]
        row = {"configuration": configuration, "source": source}
        row |= dict(zip(rows, sample.mean(axis=0), strict=True))
        row |= dict(zip(variances, np.diag(covariance), strict=True))
        row |= {"cov": covariance[0, 1], "samples": len(sample)}
        table.append(row)
    return pd.DataFrame(table)


def common_grid(samples: Sequence[ndarray], points: int) -> ndarray:
    """Return a grid (points, n) of the rows of ``samples`` (N, n), from GRID_REACH of the greatest
    standard deviation below the least mean to as much above the greatest mean.
    """
    centres = np.array([sample.mean(axis=0) for sample in samples])
    deviations = np.array([sample.std(axis=0) for sample in samples])
    reach = GRID_REACH * deviations.max(axis=0)
    first = centres.min(axis=0) - reach
    last = centres.max(axis=0) + reach
    return np.linspace(first, last, points)


def force_density(configuration: str, wrenches: Wrenches, points: int) -> pd.DataFrame:
    """Return the table ``force_density`` of samples (N, 2) on a grid ``points`` × ``points``."""
    x, y = common_grid([*wrenches.values()], points).T
    fx, fy = np.meshgrid(x, y, indexing="ij")
    tables = []
    for source, sample in wrenches.items():
        bandwidth = densities.normal_reference_bandwidth(sample)
        density = densities.kernel_density(sample, x, y, bandwidth)
        columns = {
            "configuration": configuration,
            "source": source,
            "fx": fx.ravel(),
            "fy": fy.ravel(),
            "density": density.ravel(),
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def wrench_marginals(
    configuration: str,
    wrenches: Wrenches,
    rows: Sequence[str],
    points: int,
) -> pd.DataFrame:
    """Return the table ``wrench_marginals``: density of each row at ``points`` common values."""
    grid = common_grid([*wrenches.values()], points)
    tables = []
    for (i, row), (source, sample) in product(enumerate(rows), wrenches.items()):
        values = grid[:, i]
        columns = {
            "configuration": configuration,
            "source": source,
            "row": row,
            "value": values,
            "density": densities.marginal_density(sample[:, i], values),
        }
        tables.append(pd.DataFrame(columns))
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
    total = np.diag(model.covariance(sigma_s))
    shares = 1 - np.diag(model.actuation_part()) / total
    independent = densities.thin_record(measured)
    modelled = models.sample_wrenches(model, sigma_s, DRAWS * len(independent), rng)
    distance, p_value = densities.energy_test(independent, modelled, rng)
    result = {
        "energy_distance": distance,
        "two_sample_p_value": p_value,
        "effective_samples": len(measured) / densities.autocorrelation_time(measured),
        "tested_samples": len(independent),
    }
    for row, share in zip(rows_of(system), shares, strict=True):
        result[f"matrix_share_{row}"] = share
    return result
