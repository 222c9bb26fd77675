"""Measured force against the matrix model of one configuration: moments, densities on a common
grid, and a test of one law.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.statistics.kde import kernel_density, normal_reference_bandwidth
from pipeline.statistics.two_sample import autocorrelation_time, energy_test, thinned
from pipeline.wrench.matrix import matrix_model, sample_wrenches, wrench_covariance
from pipeline.wrench.parametric import CableSystem

# standard deviations of the wider source that the common grid extends beyond the means
GRID_REACH = 4.0
# of the model for every measured sample that is tested: its own scatter then adds a tenth to the
# record's
DRAWS = 10


def modelled_forces(
    system: CableSystem, sigma_s: np.ndarray, samples: int, rng: np.random.Generator
) -> np.ndarray:
    """``samples`` forces (samples, 2) in N of the matrix model at the nominal ``system`` (m,) with
    ``sigma_s`` (2, 2).
    """
    return sample_wrenches(matrix_model(system), sigma_s, samples, rng)


def force_moments(configuration: str, forces: dict[str, np.ndarray]) -> pd.DataFrame:
    """The rows of the table ``force_moments`` of one configuration; ``forces`` maps a source to its
    samples (N, 2) in N.
    """
    rows = []
    for source, sample in forces.items():
        (fx, fy), covariance = sample.mean(axis=0), np.cov(sample, rowvar=False)
        rows.append(
            {
                "configuration": configuration,
                "source": source,
                "fx": fx,
                "fy": fy,
                "var_fx": covariance[0, 0],
                "var_fy": covariance[1, 1],
                "cov": covariance[0, 1],
                "samples": len(sample),
            }
        )
    return pd.DataFrame(rows)


def force_density(configuration: str, forces: dict[str, np.ndarray], points: int) -> pd.DataFrame:
    """The rows of the table ``force_density`` of one configuration: every source on one grid of
    ``points`` × ``points``.

    ``forces`` maps a source to its samples (N, 2) in N; the grid spans 4 standard deviations about
    the means of all of them.
    """
    centres = np.array([sample.mean(axis=0) for sample in forces.values()])
    spread = GRID_REACH * np.max([sample.std(axis=0) for sample in forces.values()], axis=0)
    x, y = np.linspace(centres.min(axis=0) - spread, centres.max(axis=0) + spread, points).T
    fx, fy = np.meshgrid(x, y, indexing="ij")
    return pd.concat(
        [
            pd.DataFrame(
                {
                    "configuration": configuration,
                    "source": source,
                    "fx": fx.ravel(),
                    "fy": fy.ravel(),
                    "density": kernel_density(
                        sample, x, y, normal_reference_bandwidth(sample)
                    ).ravel(),
                }
            )
            for source, sample in forces.items()
        ],
        ignore_index=True,
    )


def force_test(
    measured: np.ndarray, system: CableSystem, sigma_s: np.ndarray, rng: np.random.Generator
) -> dict[str, float]:
    """Whether the record ``measured`` (N, 2) in N has the law of the matrix model at the nominal
    ``system`` (m,) with ``sigma_s`` (2, 2).

    The energy distance (N) and its permutation p-value of the record, thinned to samples that count
    as independent, against ten times as many of the model; the record's effective samples N/τ, τ
    its integrated autocorrelation time, and the samples tested. With them the share of the modelled
    variances that Σ_S causes: where it is small the test says little of Σ_S, and much of the
    actuation's law.
    """
    model = matrix_model(system)
    shares = 1 - np.diag(model.actuation_part()) / np.diag(wrench_covariance(model, sigma_s))
    independent = thinned(measured)
    distance, p_value = energy_test(
        independent, modelled_forces(system, sigma_s, DRAWS * len(independent), rng), rng
    )
    return {
        "energy_distance": distance,
        "two_sample_p_value": p_value,
        "effective_samples": len(measured) / autocorrelation_time(measured),
        "tested_samples": len(independent),
        "matrix_share_fx": shares[0],
        "matrix_share_fy": shares[1],
    }
