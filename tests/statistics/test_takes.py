"""Intervals of differences over takes."""

import numpy as np
import pytest
from scipy import stats

from pipeline.statistics.takes import jackknife_counts, jackknife_difference, paired_difference


@pytest.mark.parametrize("takes", [3, 4, 20])
def test_the_jackknife_of_a_mean_is_students_interval(takes):
    values = np.random.default_rng(1).standard_normal(takes)
    counts = jackknife_counts(takes)
    found = jackknife_difference(counts @ values / counts.sum(axis=1))
    known = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert found[:3] == pytest.approx((values.mean(), *known))
    assert paired_difference(values, np.zeros(takes)) == pytest.approx(found)
