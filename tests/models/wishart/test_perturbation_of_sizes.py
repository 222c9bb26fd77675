"""The perturbation samples of arms of any number of joints and task rows, held against the convex
problem as printed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_arm import SIZES, motion, random_arm

from pipeline.models.convex import solve_perturbation
from pipeline.models.wishart.convex_check import perturbation_gap
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.factors import factors
from pipeline.models.wishart.perturbation import fit_perturbations, objective_weights

FLOOR, WEIGHTS = 0.2, (0.999, 0.001)


def problems(n: int, m: int, decomposition: Decomposition, share: float):
    """An arm, poses, commands and noise of ``share`` of the steps of 120 problems."""
    arm = random_arm(n, m)
    q, v = motion(arm, 120, 0)
    step = arm.nominal_step(q[:-1], v)
    size = share * np.sqrt(np.mean(step**2))
    noise = size * np.random.default_rng(n + m).standard_normal(step.shape)
    return arm, q[:-1], v, noise


@pytest.mark.parametrize("name", ["pivoted_lu", "qr", "qr_transposed", "given"])
@pytest.mark.parametrize(("n", "m"), [(1, 1), *SIZES])
def test_the_closed_form_agrees_with_the_problem_as_printed_and_a_wrong_one_does_not(n, m, name):
    """Under the bound too: whatever m, one eigenvalue of ddᵀ/2x − I alone can be positive."""
    left = {"left": np.eye(m) + 0.2} if name == "given" else {}
    decomposition = Decomposition(name, **left)
    arm, q, v, noise = problems(n, m, decomposition, 1.5)
    a, back, _ = factors(arm, q, v, decomposition)
    fits = fit_perturbations(noise, a, back, WEIGHTS, FLOOR)
    assert np.linalg.eigvalsh(np.eye(m) + fits.s).min() > FLOOR - 1e-10
    chosen = np.concatenate([np.flatnonzero(fits.bound)[:4], np.flatnonzero(~fits.bound)[:4]])
    assert np.count_nonzero(fits.bound[chosen]) == 4
    held = arm, q, v, noise, decomposition, WEIGHTS, FLOOR, chosen
    assert perturbation_gap(fits, *held) < 1e-5
    wrong = replace(fits, objective=1.01 * fits.objective)
    assert perturbation_gap(wrong, *held) > 0.009


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_the_perturbations_are_those_of_the_problem_as_printed(n, m):
    """To what a conic solver leaves of a flat optimum."""
    arm, q, v, noise = problems(n, m, Decomposition("qr"), 0.5)
    a, back, _ = factors(arm, q, v, Decomposition("qr"))
    fits = fit_perturbations(noise, a, back, WEIGHTS, FLOOR)
    moved = np.flatnonzero(np.linalg.norm(fits.s, axis=(1, 2)) > 0.05)[:5]
    for i in moved:
        left = np.eye(m)
        b_inv, _ = solve_perturbation(noise[i], v[i, :m], left, arm.jacobian(q[i]), WEIGHTS, FLOOR)
        np.testing.assert_allclose(np.eye(m) + fits.s[i], b_inv, atol=5e-3 * np.abs(b_inv).max())
    # control: they are none of the next step's
    assert np.abs(fits.s[moved[0]] - fits.s[moved[1]]).max() > 0.02


def test_noise_across_the_range_of_the_arm_is_explained_by_nothing():
    """What the arm makes in the null space of its task has no part in S, and costs what it is."""
    arm, q, v, noise = problems(7, 6, Decomposition("qr"), 0.5)
    a, back, _ = factors(arm, q, v, Decomposition("qr"))
    across = arm.null_step(q, np.concatenate([v[:, :6], noise], axis=1))
    fits = fit_perturbations(across, a, back, WEIGHTS, FLOOR)
    assert not np.any(fits.s)
    np.testing.assert_allclose(fits.objective, WEIGHTS[0] * np.linalg.norm(across, axis=1))
    assert np.any(fit_perturbations(noise, a, back, WEIGHTS, FLOOR).s)


def test_an_exact_fit_gives_back_the_matrix_along_the_command():
    arm, q, v, _ = problems(7, 6, Decomposition("qr_transposed"), 0.5)
    a, back, _ = factors(arm, q, v, Decomposition("qr_transposed"))
    root = np.random.default_rng(3).standard_normal((6, 6)) / 10
    s = root + root.T
    noise = np.matvec(back, np.matvec(s, a))
    fits = fit_perturbations(noise, a, back, (1.0, 1e-9), 0.01)
    np.testing.assert_allclose(np.matvec(fits.s, a), np.matvec(s, a), rtol=1e-5, atol=1e-12)
    reversed_sign = fit_perturbations(-noise, a, back, (1.0, 1e-9), 0.01)
    assert np.abs(np.matvec(reversed_sign.s - s, a)).max() > np.abs(np.matvec(s, a)).max()


def test_the_residual_is_of_all_joints_and_the_perturbation_of_the_task_rows():
    """Noise at rest of seven joints costs as much as a perturbation by I of six rows."""
    alpha1, alpha2 = objective_weights(1e-3, 6)
    assert alpha1 * 1e-3 == pytest.approx(alpha2 * np.linalg.norm(np.eye(6)))
    assert alpha1 * 1e-3 != pytest.approx(alpha2 * np.linalg.norm(np.eye(7)))
