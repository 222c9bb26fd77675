"""Recovery: whether an estimator returns the parameters that its data were drawn with, and whether its interval holds them.

Data have the measured poses and commanded steps of the recordings, and noise of the law that the likelihoods assume
(:func:`pipeline.motion.control.drawn`), Σ_m that of the recordings and known to the estimator.

The interval is that of the bootstrap over takes, whose own distribution is had from all data sets together, one replicate of each
(Giacomini, Politis and White, Econometric Theory 29, 2013): R data sets take 2R fits where R bootstraps would take R·B.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline import schema
from pipeline.errors import ModelDomainError, SolverError
from pipeline.motion.additive import fit_covariance
from pipeline.motion.bootstrap import estimator_of_takes, percentiles, replicate
from pipeline.motion.build import build_model
from pipeline.motion.control import drawn
from pipeline.motion.estimation import Recorded, covariance_entries, estimate, scaled_entries, student_entries
from pipeline.motion.gaussian import frobenius
from pipeline.motion.scaled import joint_step

BOUND = 1.1  # u of drawn data over the greatest norm of the poses: near enough to bend the noise, and within what is searched
DEGREES = 5.0  # ν of drawn data: tails far from normal, and a variance


@dataclass(frozen=True)
class Truth:
    """Known parameters: of the model, and by the names that an estimator gives to its estimates of them."""

    label: str
    parameters: dict[str, Any]
    values: dict[str, float]


def thinned(recorded: Recorded, takes: int, stride: int) -> Recorded:
    """The first ``takes`` takes and every ``stride``-th step, Σ_m that of all."""
    return Recorded(
        recorded.chain, recorded.q[:takes, ::stride], recorded.v[::stride], recorded.noise[:takes, ::stride], recorded.measurement
    )


def truths(recorded: Recorded, options: schema.Model, dispersions: Sequence[float]) -> list[Truth]:
    """Known parameters of the model ``options``, noise of about the size that was recorded; of the Wishart model each of ``dispersions``.

    Noise that grows with speed has half of its variance from speed and half at rest.
    """
    covariance = fit_covariance(recorded.noise)
    match options:
        case schema.Additive():
            return [Truth("additive", {"kind": "additive", "noise_covariance": covariance.tolist()}, covariance_entries(covariance))]
        case schema.Wishart():
            known = {"kind": "wishart", "decomposition": options.decomposition}
            return [Truth(f"wishart {sigma_b:g}", known | {"sigma_b": sigma_b}, {"sigma_b": sigma_b}) for sigma_b in dispersions]
        case schema.Gaussian():
            return [_gaussian(recorded, np.trace(covariance))]
        case schema.Scaled():
            return [_scaled(recorded, covariance, options.structure)]
        case schema.Student():
            scale = covariance * (DEGREES - 2) / DEGREES
            return [Truth("student", {"kind": "student", "nu": DEGREES, "scale": scale.tolist()}, student_entries(DEGREES, scale))]
    raise ModelDomainError(f"no parameters are known of a model of kind {options.kind}")


def _gaussian(recorded: Recorded, total_variance: float) -> Truth:
    squares, speeds = frobenius(recorded.chain.inverse_jacobian(recorded.q)) ** 2, np.vecdot(recorded.v, recorded.v)
    u = BOUND * float(np.sqrt(squares.max()))
    alpha = float(np.sqrt(3 * total_variance / np.mean((u**2 - squares) * speeds)))
    mean_square = np.average(squares, weights=np.broadcast_to(speeds, squares.shape))
    values = {"u": u, "alpha": alpha, "noise_level": alpha * np.sqrt(u**2 - mean_square)}
    return Truth("gaussian", {"kind": "gaussian", "alpha": alpha, "u": u}, values)


def _scaled(recorded: Recorded, covariance: np.ndarray, structure: str) -> Truth:
    step = joint_step(recorded.chain, recorded.q, recorded.v)
    square = np.mean(step**2, axis=(0, 1))
    kept = np.diag(np.diag(covariance)) if structure == "diagonal" else covariance
    floor = kept / 2
    if structure == "timing":
        gain = np.full((3, 3), np.trace(covariance) / square.sum() / 2)
    else:
        gain = kept / np.sqrt(np.outer(square, square)) / 2
    parameters = {"kind": "scaled", "floor": floor.tolist(), "gain": gain.tolist()}
    return Truth(f"scaled {structure}", parameters, scaled_entries(floor, gain, structure))


Trial = tuple[dict[str, float], dict[str, float]]  # the estimates, and those of one resampling of the takes


def recover(recorded: Recorded, truth: Truth, options: schema.Model, rng: np.random.Generator) -> Trial | None:
    """The estimates of ``options`` from one data set drawn with ``truth``, and a replicate of them; None where either has none."""
    data = drawn(build_model(truth.parameters), recorded, rng)
    try:
        found = estimate(data, options)
    except (ModelDomainError, SolverError):
        return None
    again = replicate(estimator_of_takes(data, options, found), len(data.q), rng)
    return None if again is None else (found.estimates, again)


def recovery_table(truth: Truth, trials: Sequence[Trial | None]) -> pd.DataFrame:
    """Bias, error, standard error and coverage of every estimate over the data sets that gave one; no row for fewer than two of them."""
    rows = []
    for name, value in truth.values.items():
        # a correlation with a joint that has no noise does not exist
        found = [trial for trial in trials if trial is not None and all(name in part for part in trial)]
        if len(found) < 2:
            continue
        estimates, again = (np.array([of[name] for of in part]) for part in zip(*found, strict=True))
        low, high = percentiles(again - estimates)
        error = estimates - value
        rows.append(
            {
                "parameter": name,
                "truth": value,
                "mean": estimates.mean(),
                "relative_bias": error.mean() / abs(value),
                "relative_bias_standard_error": error.std(ddof=1) / np.sqrt(len(error)) / abs(value),
                "root_mean_square_error": np.sqrt(np.mean(error**2)),
                "standard_deviation": error.std(ddof=1),
                "bootstrap_standard_error": (again - estimates).std(ddof=1),
                "coverage": np.mean((error + low <= 0) & (0 <= error + high)),
                "datasets": len(found),
                "without_an_estimate": len(trials) - len(found),
            }
        )
    return pd.DataFrame(rows)
