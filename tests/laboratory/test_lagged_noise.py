"""How a lagged disturbance correlates with itself later, against what is drawn."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.laboratory.dynamics import LAGS, lagged_correlation, lagged_noise

STEPS = np.array([0, 1, 3, 8, 20])


@pytest.mark.parametrize("steps_per_lag", [0.5, 4.0])
def test_it_is_that_of_the_paths_that_are_drawn(steps_per_lag):
    paths = lagged_noise((4000, 21), steps_per_lag, np.random.default_rng(4))
    products = paths[:, :1] * paths[:, STEPS]
    error = products.std(axis=0) / np.sqrt(len(paths))
    assert np.all(
        np.abs(products.mean(axis=0) - lagged_correlation(STEPS, steps_per_lag)) < 4 * error
    )
    # control: of longer lags
    other = lagged_correlation(STEPS, 2 * steps_per_lag)
    assert np.any(np.abs(products.mean(axis=0) - other) > 8 * error)


def test_it_solves_the_recursion_of_the_lags_and_ends():
    denominator = np.poly(np.full(LAGS, np.exp(-1 / 5.0)))
    later = lagged_correlation(np.abs(np.arange(-LAGS, 200)), 5.0)
    # Yule and Walker: beyond lag 0 the recursion leaves nothing
    left = [denominator @ later[LAGS + k - np.arange(LAGS + 1)] for k in range(1, 150)]
    np.testing.assert_allclose(left, 0.0, atol=1e-9)
    assert lagged_correlation(np.array(10**6), 5.0) == 0.0
