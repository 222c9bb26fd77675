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
from pipeline.verdicts.claims import Claim

PIVOTED, QR, QR_TRANSPOSED, GAUSSIAN = "pivoted_lu", "qr", "qr_transposed", "gaussian"
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
    reading: str, jacobian: np.ndarray, v: np.ndarray, sigma_b: float
) -> np.ndarray:
    """Return the joints' variances (..., n) in rad² of a Wishart step at J (..., m, n) for the task
    step v (..., m). LU without pivoting, PJ = LU, is the pivoted LU of DPJ with decreasing scales
    D, by L = D⁻¹L'D and U = D⁻¹U'.
    """
    if order := PLAIN.get(reading):
        rows, scale = list(order), PIVOT_SCALES
        scaled = scale[:, None] * jacobian[..., rows, :], scale * v[..., rows]
        a, back, _ = split(*scaled, Decomposition(PIVOTED))
        a, back = a / scale, back * scale
    else:
        a, back, _ = split(jacobian, v, Decomposition(reading))
    m = a.shape[-1]
    along, across = step_variances((m + 1) / sigma_b**2, m)
    nominal = np.matvec(back, a) ** 2
    total = np.vecdot(a, a)[..., None] * np.vecdot(back, back)
    return across * (total - nominal) + along * nominal


class Published(NamedTuple):
    """Printed results of the parameter estimations (Sec. 4.1.2)."""

    sigma_b: float  # σ̂_B of the Wishart model
    alpha: float  # α̂ of the Gaussian model
    u: float  # û, the bound on ‖J⁻¹‖_F
    covariance: np.ndarray  # (n, n) Σ̂_ω of the additive model, rad²


def published_values(claims: Sequence[Claim]) -> Published:
    """Return the published values of ``claims``."""
    stated = {claim.id: claim for claim in claims}
    entries = [
        [int(x) - 1 for x in case["entry"]] for case in stated["sigma-omega"].cases()
    ]
    matrix = np.full((1 + np.max(entries),) * 2, np.nan)
    for (i, j), value in zip(entries, stated["sigma-omega"].published, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return Published(
        *(stated[name].published for name in ("sigma-b", "alpha", "u")), matrix
    )


def widths(
    chain: PlanarChain, paths: Paths, stated: Published, kind: str = ""
) -> np.ndarray:
    """Return the WIDTHS (P,) of both models at the printed parameters ``stated`` on ``paths``."""
    result, n = np.zeros(len(paths.q), WIDTHS), paths.q.shape[-1]
    for start in range(0, len(paths.q), BLOCK):
        block = slice(start, start + BLOCK)
        q, step = (part[block] for part in paths)
        jacobian, norm = chain.jacobian(q), frobenius(chain.inverse_jacobian(q))
        v = np.matvec(jacobian, step)
        gaussian = (
            stated.alpha**2
            * (stated.u**2 - norm**2)
            * np.vecdot(v, v)
            / (n * v.shape[-1])
        )
        wishart = [
            wishart_variance(name, jacobian, v, stated.sigma_b) for name in READINGS
        ]
        part = result[block]
        part["kind"], part["norm"] = kind, norm.max(axis=-1)
        part["gaussian"] = np.sqrt(gaussian.mean(axis=-1))
        part["wishart"] = np.sqrt(
            np.stack([each.mean(axis=1) for each in wishart], axis=1)
        )
    return result


def log_quantities(
    drawn: np.ndarray, stated: Published, widening: float = 0.0
) -> dict[str, np.ndarray]:
    """Return the logarithm (R, P) or (P,) of each quantity of the WIDTHS ``drawn``; 0 equals the
    printed numbers. ``widening`` is added to the logarithm of the Gaussian model's width.
    """
    printed, total = (
        np.diag(stated.covariance),
        np.linalg.norm(drawn["wishart"], axis=-1).T,
    )
    joints = np.moveaxis(drawn["wishart"], 0, -1) / np.sqrt(printed)[:, None]
    gaussian = np.exp(widening) * np.sqrt(len(printed)) * drawn["gaussian"]
    quantities = {
        f"joint {j}": joints[:, j - 1] for j in range(1, len(printed) + 1)
    } | {
        "trace": total / np.sqrt(np.trace(stated.covariance)),
        "gaussian": gaussian / np.sqrt(np.trace(stated.covariance)),
        "difference": total / gaussian,
    }
    return {name: np.log(values) for name, values in quantities.items()}


def densities(
    quantities: Mapping[str, np.ndarray], names: Sequence[str], tolerance: float
) -> np.ndarray:
    """Return the density (R, P) of the printed numbers for the ``tolerance`` f > 1."""
    deviation = np.log(tolerance)
    squares = sum((quantities[name] / deviation) ** 2 for name in names)
    return np.exp(-squares / 2) / (np.sqrt(2 * np.pi) * deviation) ** len(names)


def evidence_rows(
    drawn: np.ndarray,
    stated: Published,
    tolerances: Sequence[float],
    span: tuple[float, float],
) -> pd.DataFrame:
    """Return rows of ``evidence`` for the prior of the paths ``drawn``, for each tolerance f and
    for the integral over f in ``span``, uniform in ln ln f.
    """
    quantities, pivoted = log_quantities(drawn, stated), READINGS.index(PIVOTED)
    grid, rows = np.exp(np.geomspace(*np.log(span), SPAN)), []
    for (size, first), (name, further) in product(SIZES.items(), SETS.items()):
        density_at = partial(densities, quantities, (*first, *further))
        cases = {f: density_at(f) for f in tolerances}
        cases[INTEGRATED] = np.mean([density_at(f) for f in grid], axis=0)
        for tolerance, density in cases.items():
            mean = density.mean(axis=1)
            share, ratio = density / mean[:, None], mean / mean[pivoted]
            error = (share - share[pivoted]).std(axis=1, ddof=1) / np.sqrt(
                density.shape[1]
            )
            low, high = (ratio * np.exp(x * NORMAL_QUANTILE * error) for x in (-1, 1))
            columns = {
                "reading": READINGS,
                "likelihood": ratio,
                "low": low,
                "high": high,
            }
            place = {"size": size, "quantities": name, "tolerance": tolerance}
            rows.append(pd.DataFrame(columns).assign(**place))
    return pd.concat(rows, ignore_index=True)


def width_rows(drawn: np.ndarray, stated: Published) -> pd.DataFrame:
    """Return rows of the table ``widths`` for the prior of the paths ``drawn``."""
    quantities = log_quantities(drawn, stated)
    width = np.exp([*quantities["trace"], quantities["gaussian"]])
    least = [*np.exp(quantities["difference"]).min(axis=1), 1.0]
    columns = {
        "reading": (*READINGS, GAUSSIAN),
        "paths": len(drawn),
        "least_ratio": least,
    }
    levels = {"low": 0.05, "median": 0.5, "high": 0.95, "best": 0.99}
    columns |= {
        name: np.quantile(width, level, axis=1) for name, level in levels.items()
    }
    return pd.DataFrame(columns | {"reached": np.mean(width >= 1, axis=1)})


def unsquared_rows(drawn: np.ndarray, stated: Published, tolerances: Sequence[float]):
    """Return the table ``unsquared``: pivoted LU and Σ_k = α(u² − ‖J⁻¹‖²)/n² over α² for α."""
    names, pivoted = (
        (*SIZES["joints 1 and 2"], *SETS["small_difference"]),
        READINGS.index(PIVOTED),
    )
    widenings = -np.log(stated.alpha) / 2, 0.0
    both = other, _ = [log_quantities(drawn, stated, each) for each in widenings]
    means = [
        [densities(each, names, f)[pivoted].mean() for f in tolerances] for each in both
    ]
    low, high = np.exp(np.quantile(other["difference"][pivoted], [0.05, 0.95]))
    columns = {"tolerance": tolerances, "likelihood": np.divide(*means)}
    return pd.DataFrame(columns | {"low_ratio": low, "high_ratio": high})
