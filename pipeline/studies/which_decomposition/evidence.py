"""Likelihood of every decomposition given the paper's printed numbers, the path unknown.

On a path the laws at the printed parameters give three kinds of quantities:

- Σ_ω and σ_B: w_j, the standard deviation of joint j under the Wishart model at σ̂_B over the
  printed one, each the root of the mean variance over all steps. j = 1, 2: the paper states that
  the matrix models do not capture the excess of joint 3 (:data:`SIZES` has the alternatives);
- (α, u): g, the same ratio of the Gaussian model at (α̂, û), variances summed over the joints, as
  its fit compares traces;
- small difference: the standard deviation of the Wishart model over the one of the Gaussian model,
  variances summed over the joints.

The printed numbers have each of them at 1, within a tolerance of a factor f: their logarithms are
normal about 0 with standard deviation ln f, independently. The likelihood of a decomposition is
the mean over the paths of the prior of the product of these densities, ∏ N(ln x; 0, ln² f).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.core.errors import ConfigError
from pipeline.statistics.takes import NORMAL_QUANTILE
from pipeline.studies.which_decomposition.laws import (
    GAUSSIAN,
    PIVOTED,
    READINGS,
    gaussian_variance,
    wishart_parts,
    wishart_variance,
)
from pipeline.studies.which_decomposition.paths import Paths
from pipeline.verdicts.claims import Claim

SIZES = {
    "joints 1 and 2": ("joint 1", "joint 2"),
    "all joints": ("joint 1", "joint 2", "joint 3"),
    "trace": ("trace",),
}
SETS = {  # beside one of SIZES
    "sigma_b": (),
    "alpha_u": ("gaussian",),
    "small_difference": ("gaussian", "difference"),
}
SPAN = 9  # tolerances of an integral over them
INTEGRATED = 0.0  # tolerance of the rows that hold it
BLOCK = 50  # paths whose steps are evaluated at once: buffers that the cache holds


@dataclass(frozen=True)
class Published:
    """Sec. 4.1.2, results of the parameter estimations."""

    sigma_b: float  # σ̂_B of the Wishart model
    alpha: float  # α̂ of the Gaussian model
    u: float  # û, the bound on ‖J⁻¹‖_F
    covariance: np.ndarray  # (n, n) Σ̂_ω of the additive model, rad²

    @property
    def spread(self) -> np.ndarray:
        """(n,) standard deviation of a step in rad, the root of the mean variance."""
        return np.sqrt(np.diag(self.covariance))


def published(claims: Sequence[Claim]) -> Published:
    """The published values of ``claims``; raises ConfigError where one of them is not stated."""
    stated = {claim.id: claim for claim in claims}
    if absent := {"sigma-b", "alpha", "u", "sigma-omega"} - set(stated):
        raise ConfigError("no claim with a published value", claim=", ".join(sorted(absent)))
    covariance = stated["sigma-omega"]
    entries = [tuple(int(digit) - 1 for digit in case["entry"]) for case in covariance.cases()]
    matrix = np.full((1 + max(i for entry in entries for i in entry),) * 2, np.nan)
    for (i, j), value in zip(entries, covariance.published, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return Published(
        stated["sigma-b"].published, stated["alpha"].published, stated["u"].published, matrix
    )


@dataclass(frozen=True)
class Widths:
    """Root mean square standard deviation of a step on each of P paths, in rad."""

    kind: np.ndarray  # (P,) of path
    norm: np.ndarray  # (P,) greatest ‖J⁻¹‖_F on the path
    gaussian: np.ndarray  # (P,) of every joint alike
    wishart: np.ndarray  # (R, P, n) of each of the readings

    @property
    def total(self) -> np.ndarray:
        """(R, P) of the Wishart model, the variances of the joints summed."""
        return np.linalg.norm(self.wishart, axis=-1)

    @property
    def difference(self) -> np.ndarray:
        """(R, P) width of the Wishart model over the one of the Gaussian model."""
        return self.total / (np.sqrt(self.wishart.shape[-1]) * self.gaussian)

    def subset(self, chosen: np.ndarray) -> Widths:
        """The paths of the mask ``chosen`` (P,)."""
        parts = (self.kind[chosen], self.norm[chosen], self.gaussian[chosen])
        return Widths(*parts, self.wishart[:, chosen])


def joined(parts: Sequence[Widths]) -> Widths:
    """The paths of all ``parts``."""
    names = ("kind", "norm", "gaussian")
    columns = [np.concatenate([getattr(part, name) for part in parts]) for name in names]
    return Widths(*columns, np.concatenate([part.wishart for part in parts], axis=1))


def widths(chain: PlanarChain, paths: Paths, stated: Published, kind: str = "") -> Widths:
    """Both models at the printed parameters ``stated`` on ``paths`` of the arm ``chain``."""
    count, n = len(paths.q), paths.q.shape[-1]
    wishart = np.empty((len(READINGS), count, n))
    norm, gaussian = np.empty((2, count))
    for start in range(0, count, BLOCK):
        block = slice(start, start + BLOCK)
        jacobian = chain.jacobian(paths.q[block])
        v = np.matvec(jacobian, paths.step[block])
        jacobian, inverse = (
            np.ascontiguousarray(np.moveaxis(part, (-2, -1), (0, 1)))
            for part in (jacobian, paths.inverse[block])
        )
        v = np.ascontiguousarray(np.moveaxis(v, -1, 0))
        for number, reading in enumerate(READINGS):
            parts = wishart_parts(reading, jacobian, inverse, v)
            variance = wishart_variance(parts, len(v), stated.sigma_b)
            wishart[number, block] = np.sqrt(variance.mean(axis=-1)).T
        norms = np.sqrt((inverse * inverse).sum(axis=(0, 1)))
        norm[block] = norms.max(axis=-1)
        variance = gaussian_variance(norms, v, stated.alpha, stated.u, n)
        gaussian[block] = np.sqrt(variance.mean(axis=-1))
    return Widths(np.full(count, kind), norm, gaussian, wishart)


def log_quantities(drawn: Widths, stated: Published) -> dict[str, np.ndarray]:
    """(R, P) or (P,) logarithm of each quantity, which the paper has at 0."""
    n = len(stated.covariance)
    printed = np.sqrt(np.trace(stated.covariance))
    joints = {f"joint {j + 1}": drawn.wishart[..., j] / stated.spread[j] for j in range(n)}
    quantities = joints | {
        "trace": drawn.total / printed,
        "gaussian": np.sqrt(n) * drawn.gaussian / printed,
        "difference": drawn.difference,
    }
    return {name: np.log(values) for name, values in quantities.items()}


def densities(
    quantities: Mapping[str, np.ndarray], names: Sequence[str], tolerance: float
) -> np.ndarray:
    """(R, P) density of the printed numbers on each path, a factor ``tolerance`` f > 1 allowed on
    each of the quantities ``names``.
    """
    deviation = np.log(tolerance)
    squares = sum((quantities[name] / deviation) ** 2 for name in names)
    return np.exp(-squares / 2) / (np.sqrt(2 * np.pi) * deviation) ** len(names)


def relative_likelihood(density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(R,) likelihood over the one of pivoted LU, and the standard error of its logarithm by the
    number of paths, of ``density`` (R, P).
    """
    mean, pivoted = density.mean(axis=1), READINGS.index(PIVOTED)
    share = density / mean[:, None]
    error = (share - share[pivoted]).std(axis=1, ddof=1) / np.sqrt(density.shape[1])
    return mean / mean[pivoted], error


def evidence_rows(
    drawn: Widths, stated: Published, tolerances: Sequence[float], span: tuple[float, float]
) -> pd.DataFrame:
    """Return the rows of the table ``evidence`` of one prior.

    Args:
        drawn: both models on the prior's paths.
        stated: the printed values.
        tolerances: factors f.
        span: least and greatest f of the integral, which is uniform in ln ln f.
    """
    quantities = log_quantities(drawn, stated)
    grid = np.exp(np.geomspace(*np.log(span), SPAN))
    rows = []
    for size, first in SIZES.items():
        for name, further in SETS.items():
            members = (*first, *further)
            cases = {f: densities(quantities, members, f) for f in tolerances}
            cases[INTEGRATED] = np.mean([densities(quantities, members, f) for f in grid], axis=0)
            for tolerance, density in cases.items():
                ratio, error = relative_likelihood(density)
                rows.append(
                    pd.DataFrame(
                        {
                            "reading": READINGS,
                            "likelihood": ratio,
                            "low": ratio * np.exp(-NORMAL_QUANTILE * error),
                            "high": ratio * np.exp(NORMAL_QUANTILE * error),
                        }
                    ).assign(size=size, quantities=name, tolerance=tolerance)
                )
    return pd.concat(rows, ignore_index=True)


def width_rows(drawn: Widths, stated: Published) -> pd.DataFrame:
    """Return the rows of the table ``widths`` of one prior."""
    n = len(stated.covariance)
    printed = np.sqrt(np.trace(stated.covariance))
    gaussian = np.repeat(drawn.gaussian[:, None], n, axis=1)
    rows = []
    for reading, joints in zip((*READINGS, GAUSSIAN), [*drawn.wishart, gaussian], strict=True):
        width = np.linalg.norm(joints, axis=-1) / printed
        difference = width * printed / (np.sqrt(n) * drawn.gaussian)
        low, median, high, best = np.quantile(width, [0.05, 0.5, 0.95, 0.99])
        row = {"reading": reading, "paths": len(width)}
        row |= {"low": low, "median": median, "high": high, "best": best}
        row |= {f"joint_{j + 1}": np.median(joints[:, j]) / stated.spread[j] for j in range(n)}
        ends = np.quantile(difference, [0.0, 0.5, 1.0])
        row |= dict(zip(("least_ratio", "median_ratio", "greatest_ratio"), ends, strict=True))
        rows.append(row | {"reached": np.mean(width >= 1)})
    return pd.DataFrame(rows)


def unsquared_rows(drawn: Widths, stated: Published, tolerances: Sequence[float]) -> pd.DataFrame:
    """Return the table ``unsquared``: the Gaussian model with Σ_k = α(u² − ‖J⁻¹‖²)/n², all of the
    quantities, likelihoods relative to pivoted LU with α².
    """
    names = (*next(iter(SIZES.values())), *SETS["small_difference"])
    wider = log_quantities(drawn, stated)
    reference = {f: densities(wider, names, f)[READINGS.index(PIVOTED)].mean() for f in tolerances}
    shift = -np.log(stated.alpha) / 2
    wider |= {"gaussian": wider["gaussian"] + shift, "difference": wider["difference"] - shift}
    rows = []
    for tolerance in tolerances:
        likelihood = densities(wider, names, tolerance).mean(axis=1) / reference[tolerance]
        low, high = np.exp(np.quantile(wider["difference"], [0.05, 0.95], axis=1))
        columns = {"likelihood": likelihood, "low_ratio": low, "high_ratio": high}
        rows.append(pd.DataFrame({"reading": READINGS, "tolerance": tolerance} | columns))
    return pd.concat(rows, ignore_index=True)
