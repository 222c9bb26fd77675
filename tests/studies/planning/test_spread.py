"""A summed variance is that of the takes, resampled or not; orders agree where they do."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.models.additive.law import AdditiveModel
from pipeline.models.noise import process_noise
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.studies.planning.spread import (
    agreement,
    deviations,
    least,
    predicted,
    products,
    summed_variance,
)


def test_the_takes_products_give_the_variance_of_any_choice_of_takes():
    rng = np.random.default_rng(1)
    deviation = rng.standard_normal((12, 7, 3)) + rng.standard_normal((7, 3))
    inner = products(deviation)
    for numbers in (np.arange(12), rng.integers(12, size=12), np.array([3, 3, 8])):
        wanted = deviation[numbers].var(axis=0, ddof=1).sum()
        assert summed_variance(inner, numbers) == pytest.approx(wanted, rel=1e-12)
    # the control: the squares about nothing are not it
    assert np.sum(deviation**2) / 11 > 1.1 * summed_variance(inner, np.arange(12))


def test_deviations_are_those_of_the_joints_and_of_the_rows_that_are_planned(bench, rig):
    path = bench.recorded
    q = rig.poses(path, "take")
    beyond = deviations(bench, path, q)
    noise = process_noise(bench.chain, q, bench.command(path))
    assert np.array_equal(beyond["joints", "step"], noise)
    # the tip's is what the joints' does, and what J misses of the step: of second order
    through = np.einsum("kij,nkj->nki", bench.chain.jacobian(path[:-1]), noise)
    step = beyond["tip", "step"]
    assert step.shape == (6, 500, 2)
    assert np.abs(step - through).std() < 0.1 * step.std()
    tip = bench.built.pose(q)[..., :2] - bench.built.pose(path)[:, :2]
    np.testing.assert_allclose(beyond["tip", "pose"], tip, atol=1e-12)


def test_what_a_model_predicts_is_the_trace_of_its_covariance(bench):
    path, covariance = bench.recorded, np.diag([1e-6, 2e-6, 4e-6])
    said = predicted(bench, AdditiveModel(covariance), path)
    np.testing.assert_allclose(said["joints"], 7e-6, rtol=1e-12)
    j = bench.chain.jacobian(path[:-1])
    wanted = np.trace(j @ covariance @ np.swapaxes(j, 1, 2), axis1=1, axis2=2)
    np.testing.assert_allclose(said["tip"], wanted, rtol=1e-12)
    # so wide a dispersion leaves the Wishart model without a covariance
    wide = WishartModel(0.9, Decomposition("qr_transposed"))
    assert predicted(bench, wide, path) is None


def test_orders_agree_or_are_opposite_and_what_has_no_order_has_no_agreement():
    sums = {"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0}
    assert agreement(sums, sums) == 1.0
    assert agreement({name: -value for name, value in sums.items()}, sums) == -1.0
    assert agreement(sums | {"a": 2.5}, sums) == pytest.approx(1 - 2 / 6)
    # alike but for rounding
    assert np.isnan(agreement({name: 1.0 + 1e-13 * value for name, value in sums.items()}, sums))
    assert np.isnan(agreement({"a": 1.0, "b": 2.0, "x": 3.0}, sums))
    assert least(sums) == "a"
