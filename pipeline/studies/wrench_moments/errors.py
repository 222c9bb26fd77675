"""How far the matrix model is off the parametric one, for forces and moments apart, over the number
of cables.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.statistics.scores import paired_difference
from pipeline.wrench.bounds import Bounds, draw_systems
from pipeline.wrench.matrix import matrix_model
from pipeline.wrench.parametric import CableSystem, wrench_covariance, wrench_mean
from pipeline.wrench.study import SigmaS, averaged_sigma_s, covariance_errors, variance_errors

ERRORS = ("variance", "variance_median", "covariance_diagonal", "covariance_full")


@dataclass(frozen=True)
class Place:
    """Where the cables are: their bounds, and the numbers of them."""

    name: str
    bounds: Bounds
    agents: Sequence[int]

    @property
    def length(self) -> float:
        """Root mean square distance in m of an attachment from the point that the wrench is taken
        about; 1 where the cables meet in it.
        """
        if self.bounds.attachment is None:
            return 1.0
        low, high = self.bounds.attachment
        return float(np.sqrt(self.bounds.dimension * (low**2 + low * high + high**2) / 3))

    def parts(self) -> Iterator[tuple[str, slice]]:
        """The rows of forces, and those of moments and of both where there are moments."""
        p = self.bounds.dimension
        yield "forces", slice(p)
        if self.bounds.attachment is not None:
            yield "moments", slice(p, None)
            yield "both", slice(None)


def error_rows(
    place: Place, length: float, systems: int, tests: int, rng: np.random.Generator
) -> pd.DataFrame:
    """The errors of one repeat: for each number of cables Σ_S from ``systems`` systems, held
    against ``tests`` fresh ones; ``length`` is the characteristic length over :attr:`Place.length`.
    """
    rows = []
    for m, m_rng in zip(place.agents, rng.spawn(len(place.agents)), strict=True):
        drawn, fresh = (
            draw_systems(place.bounds, count, m, m_rng).in_units_of(length * place.length)
            for count in (systems, tests)
        )
        estimates = averaged_sigma_s(drawn)
        whole = {"agents": m, "held": estimates["full"].clipped / systems}
        rows += [whole | row for row in _part_rows(place, fresh, estimates)]
    return pd.DataFrame(rows)


def _part_rows(
    place: Place, fresh: CableSystem, estimates: dict[str, SigmaS]
) -> Iterator[dict[str, object]]:
    """The errors over the ``fresh`` systems, a row a part of the wrench."""
    model, covariance = matrix_model(fresh), wrench_covariance(fresh)
    shift = model.mean() - wrench_mean(fresh)
    modelled = {form: model.covariance(estimate.mean) for form, estimate in estimates.items()}
    for part, rows in place.parts():
        due = covariance[:, rows, rows]
        errors = {
            f"covariance_{form}": covariance_errors(values[:, rows, rows], due).mean()
            for form, values in modelled.items()
        }
        distance = np.linalg.norm(shift[:, rows], axis=-1)
        variance = variance_errors(modelled["diagonal"][:, rows, rows], due)
        yield {
            "part": part,
            "variance": variance.mean(),
            "variance_median": np.median(variance),
            **errors,
            "shift": np.mean(distance / np.sqrt(np.trace(due, axis1=-2, axis2=-1))),
        }


def slope_rows(errors: pd.DataFrame) -> pd.DataFrame:
    """The table ``wrench_slopes``: least-squares slope of log error over log m within each repeat,
    its mean over the repeats and Student's interval; over all numbers of cables, and over the upper
    half of them.
    """
    rows = []
    at_one = errors[errors["length"] == 1.0]
    for (place, part), table in at_one.groupby(["place", "part"], sort=False):
        for error in ERRORS:
            means = np.log(table.pivot(index="agents", columns="repeat", values=error))
            for least in sorted({means.index[0], means.index[(len(means) - 1) // 2]}):
                chosen = means.loc[least:]
                slopes = np.polyfit(np.log(chosen.index.to_numpy(float)), chosen.to_numpy(), 1)[0]
                interval = paired_difference(slopes, np.zeros_like(slopes))
                rows.append(
                    {"place": place, "part": part, "error": error, "least": least}
                    | {"slope": interval.mean, "low": interval.low, "high": interval.high}
                )
    return pd.DataFrame(rows)
