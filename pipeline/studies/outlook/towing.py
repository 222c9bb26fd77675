"""Cables that tow a load in space: error of the matrix model of the wrench against the parametric
one, for forces and moments apart, over the number of cables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pandas as pd

from pipeline.statistics.takes import paired_difference
from pipeline.wrench.bounds import Bounds, draw_systems
from pipeline.wrench.matrix import matrix_model, moment_fit
from pipeline.wrench.parametric import (
    CableSystem,
    sample_directions,
    wrench_covariance,
    wrench_mean,
)
from pipeline.wrench.study import averaged_sigma_s, covariance_errors, variance_errors

PARTS = {"forces": slice(3), "moments": slice(3, 6)}
# form of Σ_S, and distance from the parametric model
ERRORS = {"variance": ("diagonal", variance_errors), "covariance": ("full", covariance_errors)}


def lever(bounds: Bounds) -> float:
    """Return the root mean square distance in m of an attachment from the load's origin."""
    low, high = bounds.attachment
    return float(np.sqrt(bounds.dimension * (low**2 + low * high + high**2) / 3))


def error_rows(
    bounds: Bounds, agents: Sequence[int], sizes: tuple[int, int], rng: np.random.Generator
) -> list[dict[str, object]]:
    """Return rows of the table ``towing`` of one repeat: for each number of cables Σ_S is averaged
    over ``sizes[0]`` systems and held against ``sizes[1]`` fresh ones.
    """
    rows = []
    for m, stream in zip(agents, rng.spawn(len(agents)), strict=True):
        drawn, fresh = (
            draw_systems(bounds, size, m, stream).in_units_of(lever(bounds)) for size in sizes
        )
        model, due = matrix_model(fresh), wrench_covariance(fresh)
        estimates, shift = averaged_sigma_s(drawn), model.mean() - wrench_mean(fresh)
        for part, block in PARTS.items():
            own, row = due[:, block, block], {"part": part, "agents": m}
            for error, (form, distance) in ERRORS.items():
                modelled = model.covariance(estimates[form].mean)[:, block, block]
                row[error] = distance(modelled, own).mean()
            std = np.sqrt(np.trace(own, axis1=-2, axis2=-1))
            row["shift"] = np.mean(np.linalg.norm(shift[:, block], axis=-1) / std)
            rows.append(row)
    return rows


def slope_rows(errors: pd.DataFrame) -> pd.DataFrame:
    """Return the table ``towing_slopes``: least-squares slopes of the log errors over log m, with
    Student's interval over the repeats.
    """
    rows = []
    for part, table in errors.groupby("part", sort=False):
        for error in ERRORS:
            means = np.log(table.pivot(index="agents", columns="repeat", values=error))
            slopes = np.polyfit(np.log(means.index.to_numpy(float)), means.to_numpy(), 1)[0]
            rows.append((part, error, *paired_difference(slopes, np.zeros_like(slopes))))
    return pd.DataFrame(rows, columns=["part", "error", "slope", "low", "high"])


def recorded_rows(
    bounds: Bounds, agents: int, sizes: tuple[int, int, int], rng: np.random.Generator
) -> list[dict[str, object]]:
    """Return rows of the table ``towing_recorded``: errors over ``sizes[1]`` systems with Σ_S from
    bounds (the mean over ``sizes[0]`` systems), and with Σ_S and Ψ_S from ``sizes[2]`` recorded
    directions of each cable of the very system.
    """
    size = lever(bounds)
    sigma_s = averaged_sigma_s(draw_systems(bounds, sizes[0], agents, rng).in_units_of(size))
    drawn = draw_systems(bounds, sizes[1], agents, rng).in_units_of(size)
    due, bounded, known = [], [], []
    for number in range(sizes[1]):
        parts = (getattr(drawn, field.name) for field in fields(drawn))
        system = CableSystem(*(part if part is None else part[number] for part in parts))
        directions = sample_directions(system.direction, system.concentration, sizes[2], rng)
        fit = moment_fit(np.einsum("mnp,kmp->knm", system.maps(), directions))
        model = matrix_model(system)
        bounded.append(model.covariance(sigma_s["full"].mean))
        known.append(replace(model, jacobian=fit.mean, psi=fit.psi).covariance(fit.sigma_s))
        due.append(wrench_covariance(system))
    return [
        {"part": part, "agents": agents, "known": name, "error": covariance_errors(*own).mean()}
        for part, block in PARTS.items()
        for name, modelled in (("bounds", bounded), ("directions", known))
        for own in [[np.array(each)[:, block, block] for each in (modelled, due)]]
    ]
