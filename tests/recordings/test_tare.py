"""The transducer's bias: found in the tare interval, refused where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.recordings.tare import remove_bias

RATE, TARE = 62.5, 5.0
BIAS = np.array([0.4, -0.3, 1.1])  # N


def record(rng, seconds=20.0, noise=0.01):
    time = np.arange(round(seconds * RATE)) / RATE
    load = np.where(time[:, None] < TARE, 0.0, [3.0, 5.0, 0.0])
    return time, load + BIAS + rng.normal(0, noise, (len(time), 3))


def test_the_loaded_force_comes_back_without_the_bias():
    time, force = record(np.random.default_rng(20))
    tared = remove_bias(time, force, TARE)
    samples = int(np.ceil(TARE * RATE))
    assert (
        tared.tare_samples == samples
        and len(tared.wrench) == len(time) - samples
        and tared.time[0] >= TARE
    )
    np.testing.assert_allclose(tared.bias, BIAS, atol=4.5 * 0.01 / np.sqrt(samples))
    np.testing.assert_allclose(tared.noise, 0.01, rtol=4.5 / np.sqrt(2 * samples))
    np.testing.assert_allclose(
        tared.wrench.mean(axis=0), [3.0, 5.0, 0.0], atol=6 * 0.01 / np.sqrt(samples)
    )
    np.testing.assert_array_equal(
        tared.wrench + tared.bias, (force[samples:] - tared.bias) + tared.bias
    )


def test_a_clock_that_does_not_start_at_zero_moves_the_interval_with_it():
    time, force = record(np.random.default_rng(21))
    np.testing.assert_array_equal(
        remove_bias(time + 1000.0, force, TARE).wrench, remove_bias(time, force, TARE).wrench
    )


def test_a_record_tared_by_its_instrument_is_left_as_it_is():
    time, force = record(np.random.default_rng(22))
    tared = remove_bias(time, force, 0.0)
    assert tared.wrench is force and tared.tare_samples == 0 and not tared.bias.any()


@pytest.mark.parametrize("tare_seconds", [0.1, 20.0, -1.0])
def test_an_interval_without_a_mean_or_a_record_without_a_rest_is_refused(tare_seconds):
    time, force = record(np.random.default_rng(23))
    with pytest.raises(RecordingError, match="tare interval"):
        remove_bias(time, force, tare_seconds)


def test_a_force_that_is_not_finite_is_refused_with_its_sample():
    time, force = record(np.random.default_rng(24))
    force[77, 1] = np.nan
    with pytest.raises(RecordingError, match="step 77"):
        remove_bias(time, force, TARE)


def test_a_clock_that_rounds_leaves_the_first_loaded_sample_out_of_the_mean():
    time, force = record(np.random.default_rng(39), noise=0.0)
    first = int(np.searchsorted(time, TARE))
    tare_seconds = time[first]
    time[first] -= 5e-7
    tared = remove_bias(time, force, tare_seconds)
    np.testing.assert_allclose(tared.bias, BIAS, rtol=1e-12)
