"""The likelihood recovers the reading that made the numbers; the closed forms agree with Algorithm
1; the paths keep the ranges of their prior.
"""

import numpy as np
import printed_algorithms
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.stats import wishart

from pipeline.arm.model import arm_of
from pipeline.core.options.dataset import Robot
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.randommatrix.wishart import degrees_of_freedom
from pipeline.studies.frame import dataset_option
from pipeline.studies.which_decomposition import evidence as laws
from pipeline.studies.which_decomposition.evidence import (
    PIVOTED,
    PLAIN,
    QR_TRANSPOSED,
)
from pipeline.studies.which_decomposition.paths import KINDS, TimeLaw, draw_paths
from pipeline.studies.which_decomposition.stage import PAPER_ARM

ALL = (*laws.SIZES["all joints"], *laws.SETS["small_difference"])
LAW = TimeLaw(320, 100.0, rest=(0.0, 0.45), ramp=(0.05, 0.35), peak=(0.2, 1.1))


@pytest.fixture(scope="module")
def arm():
    return arm_of(dataset_option(Robot, PAPER_ARM, "robot")).chain


@pytest.fixture(scope="module")
def stated():
    return laws.published_values()


@pytest.fixture(scope="module")
def paths(arm, stated):
    """Return 40 paths of every kind, by kind."""
    rng = default_rng(3)
    return {kind: draw_paths(arm, LAW, kind, stated.u, 40, rng) for kind in KINDS}


@pytest.fixture(scope="module")
def drawn(arm, paths, stated):
    """Return the widths of both models on all paths."""
    widths = [laws.widths(arm, paths[kind], stated, kind) for kind in KINDS]
    return np.concatenate(widths)


def made_by(drawn, stated, reading, path):
    """Return the models and the numbers that would have been printed with ``reading`` on ``path``,
    at equal widths of the two models.
    """
    joints = drawn["wishart"][path, laws.READINGS.index(reading)]
    width = np.sqrt(np.mean(joints**2))
    alike = drawn.copy()
    alike["gaussian"] *= width / drawn["gaussian"][path]
    return alike, stated._replace(covariance=np.diag(joints**2))


@pytest.mark.parametrize("reading", [PIVOTED, "lu_xzp", "lu_zxp", QR_TRANSPOSED])
def test_the_reading_that_made_the_numbers_is_the_most_likely_on_its_path(
    drawn,
    stated,
    reading,
):
    number = laws.READINGS.index(reading)
    most_likely = []
    for path in range(0, 120, 6):
        models, printed = made_by(drawn, stated, reading, path)
        quantities = laws.log_quantities(models, printed)
        density = laws.densities(quantities, ALL, 1.1)
        # the path itself is one of the prior's, and the numbers are met there exactly
        assert density[number, path] == density.max()
        likelihood = density.mean(axis=1)
        most_likely.append(likelihood[number] >= 0.99 * likelihood.max())
    assert np.mean(most_likely) >= 0.7


def test_the_likelihood_is_the_mean_of_normal_densities(stated):
    two = np.zeros(2, laws.WIDTHS)
    two["wishart"] = np.sqrt(np.diag(stated.covariance))
    two["wishart"][1] *= 2
    two["gaussian"] = np.sqrt(np.trace(stated.covariance) / 3)
    quantities = laws.log_quantities(two, stated)
    density = laws.densities(quantities, ("joint 1", "gaussian"), 2.0)
    at_zero = 1 / (2 * np.pi * np.log(2) ** 2)
    due = [at_zero, at_zero * np.exp(-0.5)]

    assert_allclose(density, np.tile(due, (9, 1)))


def test_pivoted_lu_is_more_than_twice_as_wide_as_the_gaussian_model_on_every_path(
    drawn,
    stated,
):
    ratios = np.exp(laws.log_quantities(drawn, stated)["difference"])
    difference = dict(zip(laws.READINGS, ratios, strict=True))
    assert difference[PIVOTED].min() > 2.2 and difference["qr"].min() > 2.5
    # the control: LU without pivoting is as wide as the Gaussian model on some
    assert difference["lu_xzp"].min() < 0.9 < 1.1 < np.median(difference["lu_xzp"])


@pytest.mark.parametrize("kind", KINDS)
def test_every_path_keeps_the_limits_and_the_bound(arm, stated, paths, kind):
    q, step = paths[kind]
    norms = np.linalg.norm(np.linalg.inv(arm.jacobian(q)), axis=(2, 3))
    speed = np.abs(step * 100 / arm.max_speed).max(axis=(1, 2))

    assert q.shape == step.shape == (40, 320, 3)
    assert np.all(arm.within_limits(q))
    assert norms.max() < stated.u
    assert 0.19 < speed.min() and speed.max() < 1.13
    assert speed.std() > 0.1
    assert_allclose(np.diff(q, axis=1), step[:, :-1], atol=1e-12)


SIGMA_B = 0.25
DRAWS = 40_000


def test_lines_are_straight(arm, paths):
    in_task = np.stack([arm.coordinates(q) for q in paths["task line"].q])
    for line in (paths["joint line"].q, in_task):
        middle = line[:, 150] - line[:, 0]
        square = np.vecdot(middle, middle)
        off = np.cross(line - line[:, :1], middle[:, None])
        assert np.abs(off / square[:, None, None]).max() < 1e-6


def test_loops_close(paths):
    q, step = paths["loop"]
    assert_allclose(q[:, -1] + step[:, -1], q[:, 0], atol=1e-9)


def first_factor(reading, jacobian):
    """Return J₁ by LAPACK; for LU without pivoting by quotients of minors."""
    if reading not in PLAIN:
        return printed_algorithms.first_factor(jacobian, Decomposition(reading))
    order = list(PLAIN[reading])
    rows = jacobian[order]
    first = np.eye(3)
    for k in range(2):
        for i in range(k + 1, 3):
            exchanged = [*range(k), i]
            minor = np.linalg.det(rows[exchanged, : k + 1])
            first[i, k] = minor / np.linalg.det(rows[: k + 1, : k + 1])
    result = np.empty((3, 3))
    result[order] = first
    return result


@pytest.fixture(scope="module")
def poses(arm, paths):
    """Return (J, v) at three moving steps."""
    result = []
    for i, (q, step) in enumerate(paths.values()):
        k = 160 - 50 * i
        jacobian = arm.jacobian(q[i, k])
        result.append((jacobian, jacobian @ step[i, k]))
    return result


@pytest.mark.parametrize("reading", laws.READINGS)
def test_the_variances_are_those_of_algorithm_1(poses, reading):
    """40 000 draws of B put the root of a variance within 2.5 %: 4.5 standard errors at a kurtosis
    below 6.
    """
    rng = default_rng(5)
    d = degrees_of_freedom(SIGMA_B, 3)
    law = wishart(d, np.eye(3) / d)
    cases = list(poses)
    if reading not in PLAIN:  # also a redundant arm
        cases.append((rng.normal(size=(3, 5)), rng.normal(size=3)))

    for jacobian, v in cases:
        first = first_factor(reading, jacobian)
        second = np.linalg.solve(first, jacobian)
        task_step = np.linalg.solve(first, v)
        draws = law.rvs(DRAWS, random_state=rng)
        steps = np.linalg.solve(draws, task_step[:, None])
        drawn = (np.linalg.pinv(second) @ steps)[..., 0].std(axis=0)

        variance = laws.wishart_variance(reading, jacobian, v, SIGMA_B)
        assert_allclose(np.sqrt(variance), drawn, rtol=0.025)


def test_the_gaussian_width_is_the_models_root_mean_variance(arm, paths, drawn, stated):
    q, step = paths["task line"]
    widths = drawn[drawn["kind"] == "task line"]
    v = np.matvec(arm.jacobian(q), step)
    covariance = GaussianModel(stated.alpha, stated.u).covariance(arm, q, v)
    variance = covariance[..., 2, 2].mean(axis=1)
    assert_allclose(widths["gaussian"] ** 2, variance, rtol=1e-9)
