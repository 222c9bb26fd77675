"""The law of six and seven joints whose task is the tip's whole pose is that of any arm: of the
same random numbers it makes the same step along J⁺v and one as long across it, in J's row space.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ks_2samp
from space_arms import LWR4, UR5, revolute_arm

from pipeline.arm.model import chain_of
from pipeline.models.draws import draw_steps
from pipeline.models.wishart import serial_step, whole_pose_step
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel

MODEL = WishartModel(0.2, Decomposition("qr_transposed"))
DRAWS = 20_000
ARMS = {
    "ur5": lambda: chain_of(replace(UR5, length=0.4)),
    "lwr4": lambda: chain_of(replace(LWR4, length=0.4)),
    "six": lambda: revolute_arm(6),
    "seven": lambda: revolute_arm(7),
}


@pytest.fixture(scope="module", params=ARMS)
def chain(request):
    return ARMS[request.param]()


@pytest.fixture
def general(monkeypatch):
    """Draws of the steps of any arm."""

    def draw(model, chain, q, command, rng):
        with monkeypatch.context() as patched:
            patched.setattr(whole_pose_step, "middle_of", lambda chain: None)
            return draw_steps(model, chain, q, command, rng)[0]

    return draw


def regular(chain) -> np.ndarray:
    """Poses whose least singular values are greatest, in their order."""
    n = len(chain.lower)
    q = np.random.default_rng(1).uniform(-2, 2, (2000, n))
    least = np.linalg.svd(chain.jacobian(q), compute_uv=False)[:, -1]
    return q[np.argsort(-least)]


def command_of(chain) -> np.ndarray:
    n = len(chain.lower)
    return 0.01 * np.random.default_rng(2).standard_normal(6 if n == 6 else 6 + n)


def test_the_laws_are_those_of_whole_poses(chain):
    taken = MODEL.law(chain).step
    assert taken in (whole_pose_step.of_six, whole_pose_step.of_seven)
    # the control: another task, and another decomposition
    assert MODEL.law(replace(chain, task=chain.task[::-1])).step is serial_step.qr_transposed
    assert WishartModel(0.2, Decomposition("qr")).law(chain).step is serial_step.given_factor


def test_of_the_same_numbers_a_step_is_the_same_but_for_a_turn_about_the_nominal_one(
    chain, general
):
    q, command = regular(chain)[:192], command_of(chain)
    ours, _ = draw_steps(MODEL, chain, q, command, np.random.default_rng(3))
    theirs = general(MODEL, chain, q, command, np.random.default_rng(3))
    inverse, jacobian = chain.inverse_jacobian(q), chain.jacobian(q)
    nominal, null = np.matvec(inverse, command[:6]), chain.null_step(q, command)
    parts = []
    for drawn in (ours, theirs):
        step = drawn - q - null
        np.testing.assert_allclose(np.matvec(inverse @ jacobian, step), step, atol=1e-12)
        along = np.vecdot(step, nominal) / np.vecdot(nominal, nominal)
        across = step - along[:, None] * nominal
        parts.append((along, np.linalg.norm(across, axis=1), across))
    for one, other in zip(parts[0][:2], parts[1][:2], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10)
    # the control: they are turned, so that it is no general step that was taken
    assert np.all(np.linalg.norm(parts[0][2] - parts[1][2], axis=1) > 1e-6 * parts[0][1])


def test_the_draws_have_the_moments_and_the_law_of_those_of_any_arm(chain, general):
    """Bands: five standard errors of a mean, for covariances those of such tails, and two-sample
    Kolmogorov–Smirnov tests of each joint at a level of 1e-5.
    """
    pose, command = regular(chain)[0], command_of(chain)
    q, n = np.tile(pose, (DRAWS, 1)), len(pose)
    drawn, _ = draw_steps(MODEL, chain, q, command, np.random.default_rng(4))
    mean, covariance = MODEL.mean(chain, pose, command), MODEL.covariance(chain, pose, command)
    deviation = np.sqrt(np.diag(covariance))
    assert np.max(np.abs(drawn.mean(axis=0) - mean) / deviation) < 5 / np.sqrt(DRAWS)
    off = np.abs(np.cov(drawn.T) - covariance) / np.outer(deviation, deviation)
    assert off.max() < 0.08
    for sigma_b, same in ((0.2, True), (0.24, False)):
        model = replace(MODEL, sigma_b=sigma_b)
        theirs = general(model, chain, q, command, np.random.default_rng(5))
        levels = [ks_2samp(drawn[:, j], theirs[:, j]).pvalue for j in range(n)]
        assert (min(levels) > 1e-5) == same


def test_a_block_with_a_pose_that_is_nearly_singular_is_moved_the_general_way(chain, general):
    q, command = regular(chain), command_of(chain)
    near = chain.singular(q)
    last = q[~near][-1]  # the most nearly singular pose that is none
    q = np.concatenate([q[:127], last[None]])
    ours, _ = draw_steps(MODEL, chain, q, command, np.random.default_rng(6))
    theirs = general(MODEL, chain, q, command, np.random.default_rng(6))
    np.testing.assert_array_equal(ours[64:], theirs[64:])
    assert np.all(ours[:64] != theirs[:64])


def test_an_arm_that_is_commanded_to_rest_stays(chain):
    q = regular(chain)[:64]
    still = np.zeros_like(command_of(chain))
    np.testing.assert_array_equal(
        draw_steps(MODEL, chain, q, still, np.random.default_rng(7))[0], q
    )
