"""The numerical study: Σ_S when only bounds on the cable system are known, and how well it then
serves fresh systems.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
import pandas as pd

from pipeline.core.errors import ConfigError
from pipeline.wrench.bounds import Bounds, draw_systems
from pipeline.wrench.expectation import ExpectedSigmaS, expected_sigma_s
from pipeline.wrench.matrix import FORMS, matrix_model, optimal_sigma_s, unbounded_sigma_s
from pipeline.wrench.parametric import CableSystem, wrench_covariance


@dataclass(frozen=True)
class SigmaS:
    """Σ_S averaged over drawn systems."""

    systems: int
    mean: np.ndarray  # (n, n)
    standard_error: np.ndarray  # (n, n) of the mean
    # eigenvalues of single systems' Σ_S that the bound Σ_S ≥ 0 held; of the diagonal form these are
    # its entries
    clipped: int


def estimate_sigma_s(
    bounds: Bounds, systems: int, agents: int, rng: np.random.Generator
) -> dict[str, SigmaS]:
    """Average of the optimal Σ_S, in each of its forms, of the same ``systems`` systems of
    ``agents`` cables drawn within ``bounds``.

    Raises ConfigError for fewer than two systems (no standard error) or no cable.
    """
    if systems < 2 or agents < 1:
        raise ConfigError(
            f"wrench study: {systems} systems of {agents} cables; at least 2 systems of at least "
            "1 cable are needed"
        )
    return averaged_sigma_s(draw_systems(bounds, systems, agents, rng))


def averaged_sigma_s(systems: CableSystem) -> dict[str, SigmaS]:
    """Average of the optimal Σ_S, in each of its forms, of an array of ``systems`` (s, m)."""
    unbounded = unbounded_sigma_s(matrix_model(systems), wrench_covariance(systems))
    estimates = {}
    for form in FORMS:
        optimal, held = optimal_sigma_s(unbounded, form)
        estimates[form] = SigmaS(
            len(optimal),
            optimal.mean(axis=0),
            optimal.std(axis=0, ddof=1) / np.sqrt(len(optimal)),
            int(held.sum()),
        )
    return estimates


def variance_errors(modelled: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """‖diag Cov(W) − Var‖/‖Var‖, (...): the paper's error of the matrix model, whose covariance is
    ``modelled`` (..., n, n), against the variances of the parametric ``covariance`` (..., n, n).
    """
    variances = np.einsum("...ii->...i", covariance)
    difference = np.einsum("...ii->...i", modelled) - variances
    return np.linalg.norm(difference, axis=-1) / np.linalg.norm(variances, axis=-1)


def covariance_errors(modelled: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """‖Cov(W) − Cov‖_F/‖Cov‖_F, (...): error of the whole covariance of the matrix model,
    ``modelled`` (..., n, n), against the parametric ``covariance`` (..., n, n).
    """
    difference = np.linalg.norm(modelled - covariance, axis=(-2, -1))
    return difference / np.linalg.norm(covariance, axis=(-2, -1))


def sigma_s_rows(
    system_class: str,
    agents: int,
    estimates: Mapping[str, SigmaS],
    expected: Mapping[str, ExpectedSigmaS],
) -> list[dict[str, object]]:
    """The rows of the table ``sigma_s`` of one class of systems, one for each form of Σ_S."""
    rows = []
    for form, estimate in estimates.items():
        row = {"system_class": system_class, "agents": agents, "form": form}
        columns = {
            "s": estimate.mean,
            "se": estimate.standard_error,
            "e": expected[form].mean,
            "ee": expected[form].standard_error,
        }
        # what the standard error tends to: known better than from the same systems that the mean is
        # of
        columns["de"] = expected[form].deviation / np.sqrt(estimate.systems)
        row |= {
            f"{name}{i + 1}{j + 1}": values[i, j]
            for name, values in columns.items()
            for i, j in zip(*np.triu_indices(len(values)), strict=True)
        }
        rows.append(row | {"clipped": estimate.clipped})
    return rows


# rows of sigma_s, wrench_errors and wrench_spread
Repeat = tuple[list[dict[str, object]], list[pd.DataFrame], list[dict[str, float]]]


def study_repeat(
    trial: tuple[int, np.random.Generator],
    bounds: Bounds,
    agents: Sequence[int],
    systems: int,
    tests: int,
) -> Repeat:
    """One repeat of the study, by its number and its own generator: for each number of cables in
    ``agents`` Σ_S from ``systems`` systems, and its error on ``tests`` fresh ones.

    The first repeat has rows of all three tables, the others of the spread alone.
    """
    repeat, rng = trial
    sigma_rows, errors, spread = [], [], []
    for m, m_rng in zip(agents, rng.spawn(len(agents)), strict=True):
        estimates = estimate_sigma_s(bounds, systems, m, m_rng)
        fresh = draw_systems(bounds, tests, m, m_rng)
        model, covariance = matrix_model(fresh), wrench_covariance(fresh)
        error = variance_errors(model.covariance(estimates["diagonal"].mean), covariance)
        spread.append({"agents": m, "repeat": repeat, "mean": error.mean(), "maximum": error.max()})
        if repeat == 0:
            sigma_rows += sigma_s_rows(
                "study", m, estimates, expected_sigma_s(bounds, m, m_rng.spawn(1)[0])
            )
            whole = {
                f"covariance_error_{form}": covariance_errors(
                    model.covariance(estimate.mean), covariance
                )
                for form, estimate in estimates.items()
            }
            errors.append(
                pd.DataFrame({"agents": m, "system": np.arange(tests), "error": error} | whole)
            )
    return sigma_rows, errors, spread


def study_tables(repeats: Iterable[Repeat]) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """The tables ``sigma_s``, ``wrench_errors`` and ``wrench_spread`` of the study, whose errors
    are those of Fig. (ErrWrnRMT).

    The first two hold the first repeat; the third holds the mean and the maximum error of each, as
    one run's maximum is a random number. The errors are the paper's, of the diagonal Σ_S; the
    second table also has those of the whole covariance, for both forms.
    """
    sigma_rows, errors, spread = (
        list(chain.from_iterable(parts)) for parts in zip(*repeats, strict=True)
    )
    return pd.DataFrame(sigma_rows), pd.concat(errors, ignore_index=True), pd.DataFrame(spread)


def run_study(
    bounds: Bounds,
    agents: Sequence[int],
    systems: int,
    tests: int,
    repeats: int,
    rng: np.random.Generator,
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """The tables of Fig. (ErrWrnRMT), as :func:`study_tables` has them, from ``repeats`` repeats of
    the study (:func:`study_repeat`).
    """
    return study_tables(
        study_repeat(trial, bounds, agents, systems, tests)
        for trial in enumerate(rng.spawn(repeats))
    )
