"""The ridge that (α, u) lie on, and the closed form of Σ_k held against the problem as printed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.models.gaussian.options import Options
from pipeline.models.model import frobenius
from pipeline.models.steps import Estimate, Recorded


def examined(
    recorded: Recorded,
    options: Options,
    estimate: Estimate | None,
    checks: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, pd.DataFrame]]:
    """The table ``ridge``, and the greatest gap between Σ_k and the solution of the log-det problem
    as printed, at ``checks`` of the steps, evenly spread.
    """
    if estimate is None:
        return {}, {}
    # imported here: CVXPY takes longer to import than the model to fit
    from pipeline.models.gaussian.convex_check import noise_covariance_gap

    fit = estimate.details
    inverse = recorded.chain.inverse_jacobian(recorded.q.mean(axis=0))
    norms = frobenius(inverse)
    checked = norms[np.linspace(0, len(norms) - 1, min(checks, len(norms))).astype(int)]
    gap = noise_covariance_gap(checked, fit.alpha, fit.u, *inverse.shape[-2:])
    metrics = {"convex_problems_checked": len(checked), "convex_check_greatest_relative_gap": gap}
    u = fit.u - fit.extension + fit.extensions
    mean_square = estimate.diagnostics["rms_norm_of_the_inverse_jacobian"] ** 2
    ridge = {
        "u": u,
        "alpha": fit.alphas,
        "level": fit.alphas * np.sqrt(u**2 - mean_square),
        "excess": fit.objectives - min(fit.objective, fit.objectives.min()),
    }
    return metrics, {"ridge": pd.DataFrame(ridge)}
