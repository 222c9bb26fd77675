"""Likelihoods of the decompositions given the paper's printed numbers, over random paths.

A Wishart step J₂⁺B⁻¹a, a = J₁⁻¹v, r = ‖a‖, has the covariance
r²·J₂⁺R·diag(Var z, (E z²/(d−m))·I)·RᵀJ₂⁺ᵀ, R orthonormal with first column a/r, d = (m+1)/σ_B².
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
from itertools import permutations
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.chain import PlanarChain
from pipeline.core.errors import ConfigError
from pipeline.models.wishart.decomposition import orthonormalize
from pipeline.models.wishart.law import step_variances
from pipeline.statistics.takes import NORMAL_QUANTILE
from pipeline.studies.which_decomposition.paths import Paths
from pipeline.verdicts.claims import Claim

PIVOTED, QR, QR_TRANSPOSED, GAUSSIAN = "pivoted_lu", "qr", "qr_transposed", "gaussian"
# LU without pivoting of the planar task (x, z, φ) in every order of its rows
PLAIN = {"lu_" + "".join("xzp"[row] for row in order): order for order in permutations(range(3))}
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


def wishart_parts(
    reading: str, jacobian: np.ndarray, inverse: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return A_j = r²·(J₂⁺J₂⁺ᵀ)_jj and C_j = (J⁺v)_j², both (n, ...), from J (m, n, ...),
    J⁺ (n, m, ...) and the commanded step v (m, ...), the batch last for contiguous entries: a joint
    has the variance across·(A − C) + along·C (:func:`pipeline.models.wishart.law.step_variances`).

    QR of J has J₁ = I, as rotations do not change the law of B. LU has J₁ = PᵀL of PJ = LU, P a
    fixed order of three rows or partial pivoting.
    """
    (m, n), nominal = jacobian.shape[:2], np.einsum("ij...,j...->i...", inverse, v)
    identity = np.zeros((m, m, *jacobian.shape[2:]))
    identity[range(m), range(m)] = 1.0
    # columns: J, which becomes multipliers and J₂; v, which becomes a; P
    rows = np.concatenate([jacobian, v[:, None], identity], axis=1)
    if reading == QR:
        back = inverse
    elif reading == QR_TRANSPOSED:
        orthonormalize(rows, n)
        back = np.swapaxes(rows[:, :n], 0, 1)
    else:
        rows = rows[list(PLAIN.get(reading, range(m)))]
        for k in range(m):
            if reading == PIVOTED:
                greatest = k + np.abs(rows[k:, k]).argmax(axis=0)
                for i in range(k + 1, m):
                    rows[[k, i]] = np.where(greatest == i, rows[[i, k]], rows[[k, i]])
            rows[k + 1 :, k] /= rows[k, k]
            rows[k + 1 :, k + 1 : n + 1] -= rows[k + 1 :, k, None] * rows[k, k + 1 : n + 1]
        for i in range(m):
            identity[i, :i] = rows[i, :i]
        first = np.einsum("ki...,kj...->ij...", rows[:, n + 1 :], identity)
        back = np.einsum("ij...,jk...->ik...", inverse, first)
    return (rows[:, n] ** 2).sum(axis=0) * (back * back).sum(axis=1), nominal * nominal


def wishart_variance(parts: tuple[np.ndarray, np.ndarray], m: int, sigma_b: float) -> np.ndarray:
    """Return the joints' variances (n, ...) of a step in rad² from :func:`wishart_parts`."""
    along, across = step_variances((m + 1) / sigma_b**2, m)
    total, nominal = parts
    return across * (total - nominal) + along * nominal


def gaussian_variance(
    norm: np.ndarray, v: np.ndarray, alpha: float, u: float, n: int
) -> np.ndarray:
    """Return the variance (...) of a joint's step in rad², α²(u² − ‖J⁺‖_F²)‖v‖²/(nm)."""
    return alpha**2 * (u**2 - norm**2) * (v * v).sum(axis=0) / (n * len(v))


class Published(NamedTuple):
    """Printed results of the parameter estimations (Sec. 4.1.2)."""

    sigma_b: float  # σ̂_B of the Wishart model
    alpha: float  # α̂ of the Gaussian model
    u: float  # û, the bound on ‖J⁻¹‖_F
    covariance: np.ndarray  # (n, n) Σ̂_ω of the additive model, rad²

    @property
    def std(self) -> np.ndarray:
        """Standard deviation (n,) of a step in rad, the root of the mean variance."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def total_std(self) -> float:
        """Root of the trace of Σ̂_ω in rad."""
        return np.sqrt(np.trace(self.covariance))


def published_values(claims: Sequence[Claim]) -> Published:
    """Return the published values of ``claims``; raises ConfigError for a missing value."""
    stated = {claim.id: claim for claim in claims}
    if absent := {"sigma-b", "alpha", "u", "sigma-omega"} - set(stated):
        raise ConfigError("no claim with a published value", claim=", ".join(sorted(absent)))
    entries = [[int(x) - 1 for x in case["entry"]] for case in stated["sigma-omega"].cases()]
    matrix = np.full((1 + np.max(entries),) * 2, np.nan)
    for (i, j), value in zip(entries, stated["sigma-omega"].published, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return Published(*(stated[name].published for name in ("sigma-b", "alpha", "u")), matrix)


class Widths(NamedTuple):
    """Root mean square standard deviation of a step on each of P paths, in rad."""

    kind: np.ndarray  # (P,) kind of the path
    norm: np.ndarray  # (P,) greatest ‖J⁻¹‖_F on the path
    gaussian: np.ndarray  # (P,) Gaussian model, equal in all joints
    wishart: np.ndarray  # (P, R, n) Wishart model by reading

    @property
    def difference(self) -> np.ndarray:
        """Standard deviation (R, P) of the Wishart model over the Gaussian model's."""
        total, n = np.linalg.norm(self.wishart, axis=-1).T, self.wishart.shape[-1]
        return total / (np.sqrt(n) * self.gaussian)

    def subset(self, mask: np.ndarray) -> "Widths":
        """Return the paths of the ``mask`` (P,)."""
        return Widths(*(part[mask] for part in self))


def concatenate_widths(parts: Sequence[Widths]) -> Widths:
    """Return the paths of all ``parts``."""
    return Widths(*map(np.concatenate, zip(*parts, strict=True)))


def widths(chain: PlanarChain, paths: Paths, stated: Published, kind: str = "") -> Widths:
    """Return the widths of both models at the printed parameters ``stated`` on ``paths``."""
    blocks, n = [], paths.q.shape[-1]
    for start in range(0, len(paths.q), BLOCK):
        q, step, inverse = (part[start : start + BLOCK] for part in paths)
        jacobian = chain.jacobian(q)
        v = np.ascontiguousarray(np.moveaxis(np.matvec(jacobian, step), -1, 0))
        jacobian, inverse = (
            np.ascontiguousarray(np.moveaxis(part, (-2, -1), (0, 1)))
            for part in (jacobian, inverse)
        )
        norms = np.sqrt((inverse * inverse).sum(axis=(0, 1)))
        variances = [
            wishart_variance(wishart_parts(reading, jacobian, inverse, v), len(v), stated.sigma_b)
            for reading in READINGS
        ]
        wishart = np.sqrt(np.stack([variance.mean(axis=-1).T for variance in variances], axis=1))
        gaussian = gaussian_variance(norms, v, stated.alpha, stated.u, n).mean(axis=-1)
        blocks.append(Widths(np.full(len(q), kind), norms.max(-1), np.sqrt(gaussian), wishart))
    return concatenate_widths(blocks)


def log_quantities(drawn: Widths, stated: Published) -> dict[str, np.ndarray]:
    """Return the logarithm (R, P) or (P,) of each quantity; 0 equals the printed numbers."""
    n = len(stated.covariance)
    joints = np.moveaxis(drawn.wishart / stated.std, -1, 0)
    quantities = {f"joint {j + 1}": ratio.T for j, ratio in enumerate(joints)} | {
        "trace": np.linalg.norm(drawn.wishart, axis=-1).T / stated.total_std,
        "gaussian": np.sqrt(n) * drawn.gaussian / stated.total_std,
        "difference": drawn.difference,
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
    drawn: Widths, stated: Published, tolerances: Sequence[float], span: tuple[float, float]
) -> pd.DataFrame:
    """Return rows of ``evidence`` for the prior of the paths ``drawn``, for each tolerance f and
    for the integral over f in ``span``, uniform in ln ln f.
    """
    quantities, pivoted = log_quantities(drawn, stated), READINGS.index(PIVOTED)
    grid, rows = np.exp(np.geomspace(*np.log(span), SPAN)), []
    for size, first in SIZES.items():
        for name, further in SETS.items():
            cases = {f: densities(quantities, (*first, *further), f) for f in (*tolerances, *grid)}
            cases[INTEGRATED] = np.mean([cases[f] for f in grid], axis=0)
            for tolerance in (*tolerances, INTEGRATED):
                density = cases[tolerance]
                mean = density.mean(axis=1)
                share, ratio = density / mean[:, None], mean / mean[pivoted]
                error = (share - share[pivoted]).std(axis=1, ddof=1) / np.sqrt(density.shape[1])
                low, high = (ratio * np.exp(x * NORMAL_QUANTILE * error) for x in (-1, 1))
                place = {"size": size, "quantities": name, "tolerance": tolerance}
                columns = {"likelihood": ratio, "low": low, "high": high}
                rows.append(pd.DataFrame({"reading": READINGS} | columns).assign(**place))
    return pd.concat(rows, ignore_index=True)


def width_rows(drawn: Widths, stated: Published) -> pd.DataFrame:
    """Return rows of the table ``widths`` for the prior of the paths ``drawn``."""
    n, rows = len(stated.covariance), []
    gaussian = np.repeat(drawn.gaussian[:, None], n, axis=1)
    models = [*np.moveaxis(drawn.wishart, 1, 0), gaussian]
    for reading, joints in zip((*READINGS, GAUSSIAN), models, strict=True):
        total = np.linalg.norm(joints, axis=-1)
        width, difference = total / stated.total_std, total / (np.sqrt(n) * drawn.gaussian)
        levels = {"low": 0.05, "median": 0.5, "high": 0.95, "best": 0.99}
        row = {"reading": reading, "paths": len(width)}
        row |= {name: np.quantile(width, level) for name, level in levels.items()}
        row |= {f"joint_{j + 1}": np.median(joints[:, j]) / stated.std[j] for j in range(n)}
        row |= {"least_ratio": difference.min(), "median_ratio": np.median(difference)}
        rows.append(row | {"greatest_ratio": difference.max(), "reached": np.mean(width >= 1)})
    return pd.DataFrame(rows)


def unsquared_rows(drawn: Widths, stated: Published, tolerances: Sequence[float]) -> pd.DataFrame:
    """Return the table ``unsquared``, with Σ_k = α(u² − ‖J⁻¹‖²)/n², over pivoted LU with α²."""
    names = (*SIZES["joints 1 and 2"], *SETS["small_difference"])
    own, shift = log_quantities(drawn, stated), -np.log(stated.alpha) / 2
    wider = own | {"gaussian": own["gaussian"] + shift, "difference": own["difference"] - shift}
    low, high = np.exp(np.quantile(wider["difference"], [0.05, 0.95], axis=1))
    rows = []
    for f in tolerances:
        due = densities(own, names, f)[READINGS.index(PIVOTED)].mean()
        likelihood = densities(wider, names, f).mean(axis=1) / due
        columns = {"likelihood": likelihood, "low_ratio": low, "high_ratio": high}
        rows.append(pd.DataFrame({"reading": READINGS, "tolerance": f} | columns))
    return pd.concat(rows, ignore_index=True)
