"""NumPy's draws of a step have the law of the compiled ones and the moments of the closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from exported_models import PARAMETERS
from scipy.stats import ks_2samp

from pipeline.models.draws import draw_steps
from pipeline.models.kinds import build_model

DRAWS = 40_000


def least_p(ours: np.ndarray, others: np.ndarray) -> float:
    """Least p-value of Kolmogorov–Smirnov tests, column by column."""
    return min(ks_2samp(*pair).pvalue for pair in zip(ours.T, others.T, strict=True))


@pytest.mark.parametrize("kind", PARAMETERS)
def test_draws_have_the_law_of_the_compiled_step(kind, chain, poses, step):
    model = build_model({"kind": kind} | PARAMETERS[kind])
    q = np.tile(poses[3], (DRAWS, 1))
    ours = model.sample(chain, q, step, np.random.default_rng(1))
    compiled, _ = draw_steps(model, chain, q, step, np.random.default_rng(2))
    directions = np.random.default_rng(3).normal(size=(3, 6))
    axes = np.concatenate([np.eye(3), directions], axis=1)
    assert least_p(ours @ axes, compiled @ axes) > 1e-5
    # the control: noise a tenth as large again is told apart
    wider = q + chain.nominal_step(q, step) + 1.1 * (ours - q - chain.nominal_step(q, step))
    ps = [
        ks_2samp(*pair).pvalue for pair in zip((wider @ axes).T, (compiled @ axes).T, strict=True)
    ]
    assert min(ps) < 1e-6
