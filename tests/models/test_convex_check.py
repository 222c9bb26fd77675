"""The checks of the closed forms notice a closed form that is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles import every_reading

from pipeline.arm.model import load_arm
from pipeline.models.gaussian import convex_check
from pipeline.models.gaussian.convex_check import noise_covariance_gap
from pipeline.models.wishart.convex_check import perturbation_gap
from pipeline.models.wishart.factors import factors
from pipeline.models.wishart.perturbation import fit_perturbations

WEIGHTS, FLOOR = (0.999, 0.001), 0.2


@pytest.fixture(scope="module")
def problems():
    chain = load_arm(
        "pipeline/arm/youbot.urdf",
        ["arm_joint_2", "arm_joint_3", "arm_joint_4"],
        "arm_tool",
        {"arm_joint_1": 2.967, "arm_joint_5": 2.923},
    ).chain
    rng = np.random.default_rng(5)
    q = np.array([2.0, -4.3, 2.5]) + 0.2 * rng.standard_normal((12, 3))
    v = np.array([0.004, 0.002, 0.03]) * (1 + 0.3 * rng.standard_normal((12, 3)))
    return chain, q, v, 0.01 * rng.standard_normal((12, 3))


@every_reading
def test_the_closed_form_agrees_with_the_problem_as_printed_and_a_wrong_one_does_not(
    problems, decomposition
):
    chain, q, v, noise = problems
    a, back, _ = factors(chain, q, v, decomposition)
    fits = fit_perturbations(noise, a, back, WEIGHTS, FLOOR)

    def gap(checked):
        return perturbation_gap(
            checked, chain, q, v, noise, decomposition, WEIGHTS, FLOOR, np.arange(12)
        )

    assert gap(fits) < 1e-5
    assert gap(replace(fits, objective=1.01 * fits.objective)) > 0.009


def test_the_noise_covariance_agrees_and_a_wrong_scale_does_not(monkeypatch):
    norms = np.array([13.6, 15.0, 16.4])
    assert noise_covariance_gap(norms, 0.1, 18.0, 3, 3) < 1e-3
    right = convex_check.noise_scale
    monkeypatch.setattr(convex_check, "noise_scale", lambda *arguments: 1.05 * right(*arguments))
    assert noise_covariance_gap(norms, 0.1, 18.0, 3, 3) > 0.04
