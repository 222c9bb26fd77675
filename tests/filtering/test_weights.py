"""Compiled weights of particles: their moments, and the number of particles that share them."""

from __future__ import annotations

import numpy as np
import pytest
from compiled_calls import from_python

from pipeline.filtering.weights import NEAR, normalise, weighted_moments


def test_moments_are_numpys_with_weights_as_probabilities():
    rng = np.random.default_rng(12)
    q, weights = rng.standard_normal((3, 700)), rng.dirichlet(np.ones(700))
    mean, covariance = np.empty(3), np.empty((3, 3))
    from_python(weighted_moments)(weights, q, mean, covariance, np.empty((5, NEAR)))
    np.testing.assert_allclose(mean, np.average(q, axis=1, weights=weights))
    np.testing.assert_allclose(covariance, np.cov(q, aweights=weights, ddof=0))


def test_effective_sample_size_counts_the_particles_among_which_weight_is_shared():

    shared, weights = np.log(np.append(np.full(10, 3.0), np.full(30, 1e-300))), np.empty(40)
    assert from_python(normalise)(np.zeros(40), weights)[0] == pytest.approx(40)
    assert from_python(normalise)(shared, weights) == pytest.approx((10, np.log(30)))
    np.testing.assert_allclose(weights, np.append(np.full(10, 0.1), np.zeros(30)), atol=1e-15)
    assert from_python(normalise)(np.append(0.0, np.full(39, -np.inf)), weights)[0] == 1.0


def test_the_order_of_the_particles_does_not_matter():
    rng = np.random.default_rng(3)
    q, log_weights, order = rng.normal(size=(3, 700)), rng.normal(size=700), rng.permutation(700)
    results = []
    for some in (np.arange(700), order):
        weights, mean, covariance = np.empty(700), np.empty(3), np.empty((3, 3))
        effective, total = from_python(normalise)(log_weights[some], weights)
        there = np.ascontiguousarray(q[:, some])
        from_python(weighted_moments)(weights, there, mean, covariance, np.empty((5, NEAR)))
        results.append([effective, total, *mean, *covariance.ravel()])
    np.testing.assert_allclose(*results, rtol=1e-11)
