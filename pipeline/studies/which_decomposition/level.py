"""σ̂_B of each decomposition at the level of the recordings: the moment estimate.

One equation: the trace of the exact covariance of a step, averaged over steps and takes, plus the
trace of the measurement noise equals the recorded trace. It is monotone in σ_B.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from pipeline.core.errors import ModelDomainError
from pipeline.models.steps import Recorded
from pipeline.studies.which_decomposition.laws import (
    PIVOTED,
    PLAIN,
    QR,
    QR_TRANSPOSED,
    wishart_parts,
    wishart_variance,
)

LEAST = 1e-6  # σ_B, and 1 − σ_B over its greatest, where the bracket ends


def moment_estimate(total: float, nominal: float, m: int, wanted: float) -> float:
    """σ_B at which a step of the mean :func:`wishart_parts` ``total`` and ``nominal``, summed over
    the joints, has the variance ``wanted`` in rad²; NaN if none has, as where a pivot vanishes.
    """
    ends = LEAST, np.sqrt((m + 1) / (m + 3)) * (1 - LEAST)

    def excess(sigma_b: float) -> float:
        return wishart_variance((total, nominal), m, sigma_b) - wanted

    return brentq(excess, *ends) if excess(ends[0]) < 0 < excess(ends[1]) else np.nan


def level_rows(recorded: Recorded) -> pd.DataFrame:
    """Return the table ``level`` of the recordings.

    Raises ModelDomainError where the motion never rests and the measurement noise is not stated.
    """
    chain, m = recorded.chain, len(recorded.chain.task)
    takes, steps, n = recorded.q.shape
    jacobian = chain.jacobian(recorded.q).reshape(takes * steps, m, n)
    inverse = chain.inverse_jacobian(recorded.q).reshape(takes * steps, n, m)
    v = np.broadcast_to(recorded.v[..., :m], (takes, steps, m)).reshape(-1, m)
    jacobian, inverse = (np.moveaxis(part, 0, -1).copy() for part in (jacobian, inverse))
    measured = np.diag(recorded.measurement)
    variance = recorded.noise.var(axis=0, ddof=1).mean(axis=0) - measured
    if not variance.sum() > 0:
        raise ModelDomainError("the recorded trace is not above the measurement noise")
    plain = tuple(PLAIN) if m == n == 3 else ()
    rows = [_row("recorded", np.nan, variance)]
    for reading in (PIVOTED, *plain, QR, QR_TRANSPOSED):
        total, nominal = (
            part.mean(axis=-1) for part in wishart_parts(reading, jacobian, inverse, v.T.copy())
        )
        sigma_b = moment_estimate(total.sum(), nominal.sum(), m, variance.sum())
        rows.append(_row(reading, sigma_b, wishart_variance((total, nominal), m, sigma_b)))
    return pd.concat(rows, ignore_index=True)


def _row(reading: str, sigma_b: float, variance: np.ndarray) -> pd.DataFrame:
    joints = {"joint": range(1, len(variance) + 1), "std": np.sqrt(np.maximum(variance, 0.0))}
    return pd.DataFrame(joints).assign(reading=reading, sigma_b=sigma_b)
