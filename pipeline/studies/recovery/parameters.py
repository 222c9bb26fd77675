"""Whether an estimator returns the parameters that its data were drawn with, and whether its
interval holds them.

Data have the measured poses and commanded steps of the recordings, and noise of the law that the
likelihoods assume (:func:`pipeline.studies.recovery.known_laws.drawn`), Σ_m that of the recordings
and known to the estimator.

The interval is that of the bootstrap over takes, whose own distribution is had from all data sets
together, one replicate of each (Giacomini, Politis and White, Econometric Theory 29, 2013): R data
sets take 2R fits where R bootstraps would take R·B.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models.bootstrap import percentiles, replicate, resampled_estimator
from pipeline.models.kinds import build_model, estimate
from pipeline.models.options import Options
from pipeline.models.steps import Recorded, Truth
from pipeline.studies.recovery.known_laws import drawn

# the estimates, and those of one resampling of the takes
Trial = tuple[dict[str, float], dict[str, float]]


def thinned(recorded: Recorded, takes: int, stride: int) -> Recorded:
    """The first ``takes`` takes and every ``stride``-th step, Σ_m that of all."""
    return replace(
        recorded,
        q=recorded.q[:takes, ::stride],
        v=recorded.v[::stride],
        noise=recorded.noise[:takes, ::stride],
        known_measurement=recorded.measurement,
    )


def recover(
    recorded: Recorded, truth: Truth, options: Options, rng: np.random.Generator
) -> Trial | None:
    """The estimates of ``options`` from one data set drawn with ``truth``, and a replicate of them;
    None where either has none.
    """
    data = drawn(build_model(truth.parameters), recorded, rng)
    try:
        fit = estimate(data, options)
    except (ModelDomainError, SolverError):
        return None
    again = replicate(resampled_estimator(data, options, fit), len(data.q), rng)
    return None if again is None else (fit.estimates, again)


def recovery_table(truth: Truth, trials: Sequence[Trial | None]) -> pd.DataFrame:
    """Bias, error, standard error and coverage of every estimate over the data sets that gave one;
    no row for fewer than two of them.
    """
    rows = []
    for name, value in truth.values.items():
        # a correlation with a joint that has no noise does not exist
        both = [
            [part[name] for part in trial]
            for trial in trials
            if trial is not None and all(name in part for part in trial)
        ]
        if len(both) < 2:
            continue
        estimates, again = np.array(both).T
        low, high = percentiles(again - estimates)
        error = estimates - value
        standard_error = error.std(ddof=1) / np.sqrt(len(error))
        rows.append(
            {
                "parameter": name,
                "truth": value,
                "mean": estimates.mean(),
                "relative_bias": error.mean() / abs(value),
                "relative_bias_standard_error": standard_error / abs(value),
                "root_mean_square_error": np.sqrt(np.mean(error**2)),
                "standard_deviation": error.std(ddof=1),
                "bootstrap_standard_error": (again - estimates).std(ddof=1),
                "coverage": np.mean((error + low <= 0) & (0 <= error + high)),
                "datasets": len(both),
                "without_an_estimate": len(trials) - len(both),
            }
        )
    return pd.DataFrame(rows)
