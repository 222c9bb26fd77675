"""What the training takes alone predict of takes of a known law: calibrated, and memory is worth
what the law's correlation says.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.filtering.alone import predicted_alone

STEPS, STD, MEASURED = 400, 0.02, 0.002


def takes(correlation: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, STEPS, 2) rad measured, of a stationary first-order law about a moving mean."""
    e = np.empty((count, STEPS, 2))
    e[:, 0] = rng.normal(size=(count, 2))
    for k in range(1, STEPS):
        fresh = np.sqrt(1 - correlation**2) * rng.normal(size=(count, 2))
        e[:, k] = correlation * e[:, k - 1] + fresh
    mean = np.linspace(0, 1, STEPS)[:, None]
    return mean + STD * e + MEASURED * rng.normal(size=e.shape)


@pytest.mark.parametrize("correlation", [0.0, 0.95])
def test_memory_predicts_as_well_as_the_law_allows_and_none_as_the_spread(correlation):
    rng = np.random.default_rng(1)
    training, own = takes(correlation, 100, rng), takes(correlation, 60, rng)
    pose = MEASURED**2 * np.eye(2)
    predicted = predicted_alone(training, own, pose)
    for name, expected in (
        ("none", STD**2 + MEASURED**2),
        # of a scalar law: variance less what the measured pose before says of it
        (
            "memory",
            STD**2 + MEASURED**2 - correlation**2 * STD**4 / (STD**2 + MEASURED**2),
        ),
    ):
        errors, covariances = predicted[name]
        assert np.mean(errors**2) == pytest.approx(expected, rel=0.12)
        assert np.trace(covariances.mean(axis=0)) / 2 == pytest.approx(expected, rel=0.12)
