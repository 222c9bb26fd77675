"""Tests over takes: what is true is rejected as often as stated, what is false nearly always."""

import numpy as np
import pytest
from numpy.random import default_rng

from pipeline.statistics.takes import (
    equal_covariances_p_value,
    fast_against_slow,
    part_means,
    zero_mean_p_value,
)

REPEATS = 400


def p_of_mean(rng: np.random.Generator, effect: float) -> float:
    """40 takes whose mean moves up and down by ``effect`` standard deviations of a step."""
    course = effect * np.sin(np.linspace(0, 2 * np.pi, 80))
    return zero_mean_p_value(part_means(course + rng.standard_normal((40, 80))))


def p_of_covariances(rng: np.random.Generator, effect: float) -> float:
    """Two configurations of 130 samples whose components share ``effect`` of their variance."""
    covariances = []
    for sign in (-1, 1):
        shared = effect * sign
        root = np.linalg.cholesky([[1.0, shared], [shared, 1.0]])
        covariances.append(np.cov(root @ rng.standard_normal((2, 130))))
    return equal_covariances_p_value(covariances, (130, 130))


@pytest.mark.parametrize("draw", [p_of_mean, p_of_covariances])
def test_a_test_errs_as_often_as_it_says_and_detects_an_effect(draw):
    rng = default_rng(12)
    errors = np.mean([draw(rng, 0.0) <= 0.05 for _ in range(REPEATS)])
    assert abs(errors - 0.05) < 4 * np.sqrt(0.05 * 0.95 / REPEATS)
    assert np.mean([draw(rng, 0.4) <= 0.05 for _ in range(20)]) > 0.9


def test_too_few_takes_and_dependent_parts_have_no_p_value():
    rng = default_rng(2)
    assert np.isnan(zero_mean_p_value(rng.standard_normal((8, 8))))
    assert np.isnan(zero_mean_p_value(np.ones((9, 2))))


def test_the_ratio_of_fast_to_slow_steps_is_found_within_each_take():
    rng = default_rng(4)
    speeds = np.linspace(0, 1, 300)[:, None]
    noise = np.where(speeds > 0.5, 4.0, 1.0) * rng.standard_normal((4, 300, 1))
    (ratio,) = fast_against_slow(noise, speeds)
    assert ratio.low < np.log(4.0) < ratio.high and ratio.degrees == 3
    noise[0, :100] = 0.0
    assert np.isnan(fast_against_slow(noise, speeds)[0].difference)
