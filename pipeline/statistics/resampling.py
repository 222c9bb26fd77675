"""Differences between models in quantities that only all takes together have, with intervals by resampling the takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd

from pipeline.statistics.agreement import correlation
from pipeline.statistics.comparison import bound_scores
from pipeline.statistics.scores import relative_error

REPLICATES = 200
TAILS = (0.025, 0.975)

Quantities = Callable[[str, np.ndarray], dict[str, float]]  # model, numbers of the takes → value by quantity


def resampled_differences(quantities: Quantities, models: Sequence[str], takes: int, rng: np.random.Generator) -> pd.DataFrame:
    """Every quantity of every model, and its difference to the first model with the 95 % percentile interval of the bootstrap over takes.

    The same takes are drawn for all models, so that the difference is a paired one; of few takes those resamplings are left out that hold
    one alone. A model without a quantity has no row of it; there is
    no interval for a single take.
    """
    everything = [quantities(model, np.arange(takes)) for model in models]
    drawn = [rng.integers(takes, size=takes) for _ in range(REPLICATES if takes > 1 else 0)]
    # one take over and over has no spread that a quantity could be of
    drawn = [numbers for numbers in drawn if np.ptp(numbers) > 0]
    resampled = [[quantities(model, numbers) for numbers in drawn] for model in models]
    rows = []
    for model, values, replicates in zip(models, everything, resampled, strict=True):
        for name, value in values.items():
            row = {"model": model, "quantity": name, "value": value}
            if model != models[0] and name in everything[0]:
                row["difference"] = value - everything[0][name]
                differences = [own[name] - first[name] for own, first in zip(replicates, resampled[0], strict=True)]
                if differences:
                    row["low"], row["high"] = np.quantile(differences, TAILS)
            rows.append(row)
    return pd.DataFrame(rows, columns=["model", "quantity", "value", "difference", "low", "high"])


def bound_quantities(error: Mapping[str, np.ndarray], bound: Mapping[str, np.ndarray]) -> Quantities:
    """How each filter's bound follows its error, of ``error`` and ``bound`` (takes, K, 3) in rad by model: see ``bound_scores``."""

    def of_takes(model: str, takes: np.ndarray) -> dict[str, float]:
        scores = {j: bound_scores(error[model][takes, :, j], bound[model][takes, :, j]) for j in range(3)}
        return {f"{name}_q{j + 1}": value for j, of_joint in scores.items() for name, value in of_joint.items()}

    return of_takes


def spread_quantities(std: Mapping[str, np.ndarray], noise: np.ndarray) -> Quantities:
    """Whether each model's standard deviation over time, ``std`` (M, 3) in rad by model, follows that of ``noise`` ω (takes, M, 3)."""

    def of_takes(model: str, takes: np.ndarray) -> dict[str, float]:
        recorded = noise[takes].std(axis=0, ddof=1)
        values = {}
        for j in range(3):
            if np.all(np.isfinite(std[model][:, j])):
                values[f"correlation_with_recorded_q{j + 1}"] = correlation(std[model][:, j], recorded[:, j])
                values[f"relative_error_q{j + 1}"] = relative_error(std[model][:, j], recorded[:, j])
        return values

    return of_takes
