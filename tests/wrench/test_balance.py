"""Tensions that give a force: exact, within bounds, and the closest to their middle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from pipeline.errors import ConfigError
from pipeline.wrench.balance import balance

FORCE = np.array([3.0, 5.0])
LOW, HIGH = 1.82, 13.89


def jacobian(directions):
    return np.stack([np.cos(directions), np.sin(directions)])


def test_tensions_are_those_of_a_general_optimiser_whether_or_not_a_bound_holds():
    rng = np.random.default_rng(19)
    held = solved = 0
    for _ in range(150):
        directions = rng.uniform(0, 2 * np.pi, rng.integers(3, 6))
        s = jacobian(directions)
        limits = [(LOW, HIGH)] * len(directions)
        feasible = linprog(np.zeros(len(directions)), A_eq=s, b_eq=FORCE, bounds=limits).status == 0
        oracle = minimize(
            lambda t: np.sum((t - (LOW + HIGH) / 2) ** 2),
            np.full(len(directions), 7.8),
            jac=lambda t: 2 * t - (LOW + HIGH),
            method="SLSQP",
            bounds=limits,
            constraints={"type": "eq", "fun": lambda t, s=s: s @ t - FORCE, "jac": lambda t, s=s: s},
            options={"ftol": 1e-14, "maxiter": 300},
        )
        try:
            tension = balance(directions, FORCE, LOW, HIGH)
        except ConfigError:
            assert not feasible
            continue
        assert feasible
        np.testing.assert_allclose(s @ tension, FORCE, atol=1e-10)
        assert LOW - 1e-9 <= tension.min() and tension.max() <= HIGH + 1e-9
        np.testing.assert_allclose(tension, oracle.x, atol=1e-5)
        solved += 1
        held += np.isclose(tension, LOW).any() or np.isclose(tension, HIGH).any()
    assert solved > 40 and 5 < held < solved


def test_two_cables_have_one_solution():
    tension = balance([0.0, np.pi / 2], FORCE, LOW, HIGH)
    np.testing.assert_allclose(tension, FORCE, rtol=1e-12)


@pytest.mark.parametrize(
    "directions", [[3.5, 4.0, 4.5], [0.0, np.pi / 2 + 0.1, np.pi], [1.0], [0.3, 0.3 + np.pi, 0.3], [np.nan, 1.0, 2.0], []]
)
def test_directions_that_cannot_give_the_force_are_refused(directions):
    with pytest.raises(ConfigError):
        balance(directions, [0.0, 40.0] if len(directions) == 3 and directions[0] == 0 else FORCE, LOW, HIGH)
