"""NumPy's draws of a step have the law of the compiled ones and the moments of the closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from exported_models import PARAMETERS
from random_arm import ROWS, RandomArm
from scipy.stats import ks_2samp

from pipeline.models.draws import draw_steps
from pipeline.models.kinds import build_model
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

DRAWS = 40_000


def least_p(ours: np.ndarray, others: np.ndarray) -> float:
    """Of the tests of Kolmogorov and Smirnov, column by column."""
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


@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 4), (7, 6)])
def test_draws_of_the_wishart_model_have_its_exact_moments_whatever_the_size(n, m):
    rng = np.random.default_rng(n)
    axes = rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    chain = RandomArm(axes, rng.uniform(-0.3, 0.3, (n + 1, 3)), ROWS[:m])
    q, command = rng.uniform(-1, 1, n), rng.normal(size=m + n) * 1e-3
    model = WishartModel(0.2, Decomposition("qr_transposed"))
    drawn = model.sample(chain, np.tile(q, (DRAWS, 1)), command, rng)
    covariance = model.covariance(chain, q, command)
    scale = np.sqrt(np.diag(covariance))
    error = (drawn.mean(axis=0) - model.mean(chain, q, command)) / (scale / np.sqrt(DRAWS))
    assert np.abs(error).max() < 5
    ratio = np.cov(drawn, rowvar=False) / np.outer(scale, scale)
    np.testing.assert_allclose(ratio, covariance / np.outer(scale, scale), atol=0.05)


def test_a_matrix_model_rests_where_nothing_is_commanded(chain, poses):
    for kind in ("gaussian", "wishart"):
        model = build_model({"kind": kind} | PARAMETERS[kind])
        drawn = model.sample(chain, poses, np.zeros(3), np.random.default_rng(1))
        assert np.array_equal(drawn, poses)
