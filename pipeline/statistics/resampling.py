"""Differences between models in quantities that only all takes together have, with intervals by
resampling the takes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline.statistics.agreement import correlation
from pipeline.statistics.joint_scores import bound_scores
from pipeline.statistics.scores import relative_error

REPLICATES = 200
TAILS = (0.025, 0.975)

# model, numbers of the takes → value by quantity
Quantities = Callable[[str, np.ndarray], dict[str, float]]


def drawn_takes(takes: int, rng: np.random.Generator) -> list[np.ndarray]:
    """The numbers of the ``takes`` that each of REPLICATES resamplings draws: none of a single
    take, and of few takes not those that hold one alone.
    """
    drawn = [rng.integers(takes, size=takes) for _ in range(REPLICATES if takes > 1 else 0)]
    # one take over and over has no spread that a quantity could be of
    return [numbers for numbers in drawn if np.ptp(numbers) > 0]


def resampled_differences(
    quantities: Quantities, models: Sequence[str], takes: int, rng: np.random.Generator
) -> pd.DataFrame:
    """Every quantity of every model, and its difference to the first model with the 95 % percentile
    interval of the bootstrap over takes.

    The same takes are drawn for all models, so that the difference is a paired one; of few takes
    those resamplings are left out that hold one alone. A model without a quantity has no row of it;
    there is no interval for a single take.
    """
    everything = [quantities(model, np.arange(takes)) for model in models]
    drawn = drawn_takes(takes, rng)
    resampled = [[quantities(model, numbers) for numbers in drawn] for model in models]
    rows = []
    for model, values, replicates in zip(models, everything, resampled, strict=True):
        for name, value in values.items():
            row = {"model": model, "quantity": name, "value": value}
            if model != models[0] and name in everything[0]:
                row["difference"] = value - everything[0][name]
                differences = [
                    own[name] - first[name]
                    for own, first in zip(replicates, resampled[0], strict=True)
                ]
                if differences:
                    row["low"], row["high"] = np.quantile(differences, TAILS)
            rows.append(row)
    return pd.DataFrame(rows, columns=["model", "quantity", "value", "difference", "low", "high"])


def bound_quantities(
    error: Mapping[str, np.ndarray], bound: Mapping[str, np.ndarray], joints: Sequence[str]
) -> Quantities:
    """How each filter's bound follows its error, of ``error`` and ``bound`` (takes, K, n) in rad by
    model and the names of the n ``joints``: see ``bound_scores``.
    """

    def quantities(model: str, takes: np.ndarray) -> dict[str, float]:
        return {
            f"{name}_{joint}": value
            for j, joint in enumerate(joints)
            for name, value in bound_scores(
                error[model][takes, :, j], bound[model][takes, :, j]
            ).items()
        }

    return quantities


def spread_quantities(
    std: Mapping[str, np.ndarray], noise: np.ndarray, joints: Sequence[str]
) -> Quantities:
    """Whether each model's standard deviation over time, ``std`` (M, n) in rad by model, follows
    that of ``noise`` ω (takes, M, n); ``joints`` the n names.
    """

    def quantities(model: str, takes: np.ndarray) -> dict[str, float]:
        recorded = noise[takes].std(axis=0, ddof=1)
        values = {}
        for j, joint in enumerate(joints):
            modelled = std[model][:, j]
            if np.all(np.isfinite(modelled)):
                values[f"correlation_with_recorded_{joint}"] = correlation(modelled, recorded[:, j])
                values[f"relative_error_{joint}"] = relative_error(modelled, recorded[:, j])
        return values

    return quantities
