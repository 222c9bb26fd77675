"""Likelihoods of the decompositions given the paper's printed numbers, over random paths.

On a path the models at the printed parameters give ratios of standard deviations (root of the mean
variance over all steps):

- Σ_ω and σ_B: Wishart model over printed value in joint j = 1, 2, because the matrix models do not
  capture the excess of joint 3 (:data:`SIZES` has alternatives);
- (α, u): Gaussian model over printed value, variances summed over the joints;
- small difference: Wishart model over Gaussian model, variances summed over the joints.

The logarithm of each ratio is normal about 0 with standard deviation ln f, f the tolerance,
independently. The likelihood of a decomposition is the mean over the paths of ∏ N(ln x; 0, ln² f).
"""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.models.model import frobenius
from pipeline.models.wishart.decomposition import Decomposition, split
from pipeline.models.wishart.law import step_variances
from pipeline.statistics.takes import NORMAL_QUANTILE
from pipeline.studies.which_decomposition.paths import Paths
from pipeline.verdicts.published import published_results

PIVOTED = "pivoted_lu"
QR = "qr"
QR_TRANSPOSED = "qr_transposed"
GAUSSIAN = "gaussian"
# LU without pivoting of the planar task (x, z, φ) in every order of its rows
PLAIN = {
    "lu_" + "".join("xzp"[row] for row in order): order
    for order in permutations(range(3))
}
READINGS = (PIVOTED, *PLAIN, QR, QR_TRANSPOSED)
SIZES = {
    "joints 1 and 2": ("joint 1", "joint 2"),
    "all joints": ("joint 1", "joint 2", "joint 3"),
    "trace": ("trace",),
}
SETS = {  # quantities in addition to one of SIZES
    "sigma_b": (),
    "alpha_u": ("gaussian",),
    "small_difference": ("gaussian", "difference"),
}
SPAN = 9  # number of tolerances in an integral over the tolerance
INTEGRATED = 0.0  # value of the tolerance in rows with the integral
BLOCK = 50  # paths that are evaluated at once, so that the buffers fit into the cache
# factors of the rows of J that fix the pivots of partial pivoting; powers of 2 are exact
PIVOT_SCALES = 2.0 ** np.array([0, -100, -200])
WIDTHS = [  # standard deviations of a step in rad, roots of the mean variance over a path
    ("kind", "U10"),  # of the path
    ("norm", float),  # greatest ‖J⁻¹‖_F on the path
    ("gaussian", float),  # Gaussian model, equal in all joints
    ("wishart", float, (len(READINGS), 3)),  # Wishart model by reading and joint
]


def wishart_variance(
    reading: str,
    jacobian: np.ndarray,
    v: np.ndarray,
    sigma_b: float,
) -> np.ndarray:
    """Return the joints' variances (..., n) in rad² of a Wishart step at J (..., m, n) for the task
    step v (..., m).
    """
    if reading in PLAIN:
        a, back = plain_split(list(PLAIN[reading]), jacobian, v)
    else:
        a, back, _ = split(jacobian, v, Decomposition(reading))
    m = a.shape[-1]
    along, across = step_variances((m + 1) / sigma_b**2, m)
    nominal = np.matvec(back, a) ** 2
    total = np.vecdot(a, a)[..., None] * np.vecdot(back, back)
    return across * (total - nominal) + along * nominal


def plain_split(
    rows: list[int],
    jacobian: np.ndarray,
    v: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return J₁⁻¹v and J₂⁺ of LU without pivoting, with the task ``rows`` in this order.

    PJ = LU is the pivoted LU of DPJ with decreasing scales D, by L = D⁻¹L'D and U = D⁻¹U'.
    """
    scale = PIVOT_SCALES
    scaled_rows = scale[:, None] * jacobian[..., rows, :]
    scaled_step = scale * v[..., rows]
    a, back, _ = split(scaled_rows, scaled_step, Decomposition(PIVOTED))
    return a / scale, back * scale


class Published(NamedTuple):
    """Printed results of the parameter estimations (Sec. 4.1.2)."""

    sigma_b: float  # σ̂_B of the Wishart model
    alpha: float  # α̂ of the Gaussian model
    u: float  # û, the bound on ‖J⁻¹‖_F
    covariance: np.ndarray  # (n, n) Σ̂_ω of the additive model, rad²


def published_values() -> Published:
    """Return the printed results of the parameter estimations."""
    results = published_results()
    covariance = {}
    for entry, value in results["sigma-omega"].items():
        row, column = (int(number) - 1 for number in entry)
        covariance[row, column] = covariance[column, row] = value
    joints = 1 + max(row for row, _ in covariance)
    matrix = np.full((joints, joints), np.nan)
    for place, value in covariance.items():
        matrix[place] = value
    return Published(results["sigma-b"], results["alpha"], results["u"], matrix)


def widths(
    chain: PlanarChain,
    paths: Paths,
    stated: Published,
    kind: str = "",
) -> np.ndarray:
    """Return the WIDTHS (P,) of both models at the printed parameters ``stated`` on ``paths``."""
    result = np.zeros(len(paths.q), WIDTHS)
    for start in range(0, len(paths.q), BLOCK):
        block = slice(start, start + BLOCK)
        q = paths.q[block]
        jacobian = chain.jacobian(q)
        norm = frobenius(chain.inverse_jacobian(q))
        v = np.matvec(jacobian, paths.step[block])
        entries = q.shape[-1] * v.shape[-1]
        variance = stated.alpha**2 * (stated.u**2 - norm**2)
        gaussian = variance * np.vecdot(v, v) / entries
        wishart = []
        for reading in READINGS:
            variances = wishart_variance(reading, jacobian, v, stated.sigma_b)
            wishart.append(variances.mean(axis=1))

        rows = result[block]
        rows["kind"] = kind
        rows["norm"] = norm.max(axis=-1)
        rows["gaussian"] = np.sqrt(gaussian.mean(axis=-1))
        rows["wishart"] = np.sqrt(np.stack(wishart, axis=1))
    return result


def log_quantities(
    drawn: np.ndarray,
    stated: Published,
    widening: float = 0.0,
) -> dict[str, np.ndarray]:
    """Return the logarithm (R, P) or (P,) of each quantity of the WIDTHS ``drawn``; 0 equals the
    printed numbers. ``widening`` is added to the logarithm of the Gaussian model's width.
    """
    printed = np.sqrt(np.diag(stated.covariance))
    printed_total = np.sqrt(np.trace(stated.covariance))
    total = np.linalg.norm(drawn["wishart"], axis=-1).T
    gaussian = np.exp(widening) * np.sqrt(len(printed)) * drawn["gaussian"]
    ratios = {
        "trace": total / printed_total,
        "gaussian": gaussian / printed_total,
        "difference": total / gaussian,
    }
    for joint, std in enumerate(printed):
        ratios[f"joint {joint + 1}"] = drawn["wishart"][..., joint].T / std
    return {name: np.log(ratio) for name, ratio in ratios.items()}


def densities(
    quantities: Mapping[str, np.ndarray],
    names: Sequence[str],
    tolerance: float,
) -> np.ndarray:
    """Return the density (R, P) of the printed numbers for the ``tolerance`` f > 1."""
    std = np.log(tolerance)
    squares = sum((quantities[name] / std) ** 2 for name in names)
    normaliser = (np.sqrt(2 * np.pi) * std) ** len(names)
    return np.exp(-squares / 2) / normaliser


def evidence_rows(
    drawn: np.ndarray,
    stated: Published,
    tolerances: Sequence[float],
    span: tuple[float, float],
) -> pd.DataFrame:
    """Return rows of ``evidence`` for the prior of the paths ``drawn``, for each tolerance f and
    for the integral over f in ``span``, uniform in ln ln f.
    """
    quantities = log_quantities(drawn, stated)
    grid = np.exp(np.geomspace(*np.log(span), SPAN))
    tables = []
    for (size, first), (set_name, further) in product(SIZES.items(), SETS.items()):
        density_at = partial(densities, quantities, (*first, *further))
        cases = {tolerance: density_at(tolerance) for tolerance in tolerances}
        cases[INTEGRATED] = np.mean([density_at(f) for f in grid], axis=0)
        for tolerance, density in cases.items():
            rows = likelihood_rows(density)
            place = {"size": size, "quantities": set_name, "tolerance": tolerance}
            tables.append(rows.assign(**place))
    return pd.concat(tables, ignore_index=True)


def likelihood_rows(density: np.ndarray) -> pd.DataFrame:
    """Return the likelihood of each reading over pivoted LU's, the mean ``density`` (R, P) over the
    paths, with its interval by the number of paths.
    """
    pivoted = READINGS.index(PIVOTED)
    mean = density.mean(axis=1)
    likelihood = mean / mean[pivoted]
    share = density / mean[:, None]
    deviation = (share - share[pivoted]).std(axis=1, ddof=1)
    error = deviation / np.sqrt(density.shape[1])
    columns = {
        "reading": READINGS,
        "likelihood": likelihood,
        "low": likelihood * np.exp(-NORMAL_QUANTILE * error),
        "high": likelihood * np.exp(NORMAL_QUANTILE * error),
    }
    return pd.DataFrame(columns)


def width_rows(drawn: np.ndarray, stated: Published) -> pd.DataFrame:
    """Return rows of the table ``widths`` for the prior of the paths ``drawn``."""
    quantities = log_quantities(drawn, stated)
    width = np.exp([*quantities["trace"], quantities["gaussian"]])
    least = np.exp(quantities["difference"]).min(axis=1)
    columns = {
        "reading": (*READINGS, GAUSSIAN),
        "paths": len(drawn),
        "least_ratio": [*least, 1.0],
        "low": np.quantile(width, 0.05, axis=1),
        "median": np.quantile(width, 0.5, axis=1),
        "high": np.quantile(width, 0.95, axis=1),
        "best": np.quantile(width, 0.99, axis=1),
        "reached": np.mean(width >= 1, axis=1),
    }
    return pd.DataFrame(columns)


def unsquared_rows(
    drawn: np.ndarray,
    stated: Published,
    tolerances: Sequence[float],
) -> pd.DataFrame:
    """Return the table ``unsquared``: pivoted LU and Σ_k = α(u² − ‖J⁻¹‖²)/n² over α² for α."""
    names = (*SIZES["joints 1 and 2"], *SETS["small_difference"])
    pivoted = READINGS.index(PIVOTED)
    squared = log_quantities(drawn, stated)
    unsquared = log_quantities(drawn, stated, -np.log(stated.alpha) / 2)
    likelihoods = []
    for tolerance in tolerances:
        with_alpha = densities(unsquared, names, tolerance)[pivoted].mean()
        likelihoods.append(
            with_alpha / densities(squared, names, tolerance)[pivoted].mean(),
        )
    low, high = np.exp(np.quantile(unsquared["difference"][pivoted], [0.05, 0.95]))
    columns = {"tolerance": tolerances, "likelihood": likelihoods}
    return pd.DataFrame(columns).assign(low_ratio=low, high_ratio=high)
