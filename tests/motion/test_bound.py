"""The bounded perturbation refuses to return numbers that are not optimal."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import SolverError
from pipeline.motion import bound


def test_a_status_other_than_optimal_raises_with_its_evidence(monkeypatch):
    settings = bound._settings()
    settings.max_iter = 1
    monkeypatch.setattr(bound, "_settings", lambda: settings)
    with pytest.raises(SolverError) as refusal:
        bound.solve_bounded(np.array([0.01, 0.0, 0.0]), np.array([1.0, 0, 0]), -0.3 * np.eye(3), 1e-3, 0.01)
    assert refusal.value.evidence["status"] == "MaxIterations"


def test_along_its_own_direction_the_perturbation_stops_at_the_bound():
    """With A = −I and ω along e the free optimum is x = −2 < ε − 1; the bounded one is x = ε − 1, no cross term and no block.

    Loosely: the optimum of two norms is flat.
    """
    e = np.array([0.6, 0.8, 0.0])
    s = bound.solve_bounded(2 * e, e, -np.eye(3), 1e-3, 0.1)
    np.testing.assert_allclose(s, -0.9 * np.outer(e, e), atol=1e-3)
