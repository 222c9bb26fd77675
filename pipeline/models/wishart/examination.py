"""The closed forms of the perturbation fits held against the convex problem as printed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.models.commands import task_step
from pipeline.models.steps import Estimate, Recorded
from pipeline.models.wishart.decomposition import chosen
from pipeline.models.wishart.dispersion import WishartFit
from pipeline.models.wishart.options import Options


def examined(
    recorded: Recorded, options: Options, estimate: Estimate, checks: int, rng: np.random.Generator
) -> tuple[dict[str, float], dict[str, pd.DataFrame]]:
    """How far the closed forms are from (BsampOpt) at ``checks`` of the steps that move, where the
    paper's estimator solved it.
    """
    fit = estimate.details
    if not isinstance(fit, WishartFit):
        return {}, {}
    # imported here: CVXPY takes longer to import than most models to fit
    from pipeline.models.wishart.convex_check import perturbation_gap

    q, v = recorded.q, recorded.v
    v = np.broadcast_to(v, (*q.shape[:2], v.shape[-1])).reshape(-1, v.shape[-1])
    moving = np.flatnonzero(np.any(task_step(recorded.chain, v), axis=1))
    checked = np.sort(rng.choice(moving, min(checks, len(moving)), replace=False))
    gap = perturbation_gap(
        fit.perturbations,
        recorded.chain,
        q.reshape(-1, q.shape[-1]),
        v,
        recorded.noise.reshape(-1, q.shape[-1]),
        chosen(options, recorded.chain.task, recorded.joints),
        fit.weights,
        options.floor,
        checked,
    )
    metrics = {"convex_problems_checked": len(checked), "convex_check_greatest_relative_gap": gap}
    return metrics, {}
