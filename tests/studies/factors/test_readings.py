"""The spreads under each reading are those of Algorithm 1, and the readings are the laws that the
study counts.
"""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest
from scipy.linalg import lu

from pipeline.models.gaussian.law import noise_scale
from pipeline.models.norm import frobenius
from pipeline.randommatrix.wishart import degrees_of_freedom, sample
from pipeline.studies.factors.paths import quadrature
from pipeline.studies.factors.readings import Reading, all_readings, crossings, wishart_spread

NATURAL = (0, 1, 2)
LU, PIVOTED, QR, TRANSPOSED = (
    Reading(name, NATURAL, NATURAL) for name in ("lu", "pivoted_lu", "qr", "qr_transposed")
)
# the youBot's motion between its two ends at one speed; the theory's table of the readings has a
# path of that kind, which it does not give, and these numbers of its standard deviations in rad
ENDS = np.array([[1.5882, -4.7997, 1.9722], [2.6529, -3.7350, 3.0456]])
STEP = 0.0112
TABLE = {
    LU: (0.0107, 0.0112, 0.0032),
    PIVOTED: (0.038, 0.046, 0.033),
    QR: (0.034, 0.047, 0.040),
    TRANSPOSED: (0.0031, 0.0031, 0.0031),
}
GAUSSIAN = 0.0126


def spread(reading, jacobian, v, weights, sigma_b=0.25):
    """Of paths whose poses are all there is of them."""
    return wishart_spread(reading, jacobian, v, weights, sigma_b, crossings(jacobian))


@pytest.fixture(scope="module")
def youbot(arm):
    """J (1, 16, 3, 3), v (1, 16, 3) and weights (16,) along the youBot's motion."""
    places, weights = quadrature(16)
    way = ENDS[1] - ENDS[0]
    jacobian = arm[0].jacobian(ENDS[:1, None] + places[:, None] * way)
    return jacobian, np.matvec(jacobian, way / np.abs(way).max() * STEP), weights


@pytest.mark.parametrize("reading", TABLE, ids=lambda reading: reading.name)
def test_the_spreads_on_the_youbots_motion_are_those_of_the_theory(youbot, reading):
    np.testing.assert_allclose(spread(reading, *youbot)[0], TABLE[reading], rtol=0.08)
    # and of no other reading
    for other in set(TABLE) - {reading}:
        assert np.any(np.abs(np.log(spread(other, *youbot)[0] / TABLE[reading])) > 0.15)


def test_the_gaussian_spread_on_the_youbots_motion_is_that_of_the_theory(youbot, stated):
    jacobian, v, weights = youbot
    norm = frobenius(np.linalg.inv(jacobian))
    variance = noise_scale(norm, stated.alpha, stated.u, 3, 3) * np.vecdot(v, v)
    np.testing.assert_allclose(np.sqrt(variance @ weights), GAUSSIAN, rtol=0.02)


def first_factor(reading: Reading, jacobian: np.ndarray) -> np.ndarray:
    """J₁ in the order of the task's rows and joints as they are, by another route: for LU without
    pivoting by the quotients of minors.
    """
    ordered = jacobian[:, reading.joints]
    if reading.name == "pivoted_lu":
        permutation, lower, _ = lu(ordered)
        return permutation @ lower
    rows, first = list(reading.rows), np.eye(3)
    for k in range(2):
        for i in range(k + 1, 3):
            minors = [np.linalg.det(ordered[[*rows[:k], r], : k + 1]) for r in (rows[i], rows[k])]
            first[i, k] = minors[0] / minors[1]
    result = np.empty((3, 3))
    result[rows] = first
    return result


@pytest.mark.parametrize(
    "reading", [Reading("lu", (1, 0, 2), (1, 0, 2)), PIVOTED], ids=lambda reading: reading.name
)
def test_the_spreads_are_those_of_algorithm_1(youbot, reading):
    """Draws of B at each pose: 40 000 put the root of a variance within 2.5 % (4.5 standard errors
    at a kurtosis below 6).
    """
    jacobian, v, _ = youbot
    rng, sigma_b, number = np.random.default_rng(5), 0.25, 40_000
    d, variances = degrees_of_freedom(sigma_b, 3), []
    for pose in range(0, 16, 3):
        mean, step = jacobian[0, pose], v[0, pose]
        first = first_factor(reading, mean)
        second = np.linalg.solve(first, mean)
        draws = first @ sample(d, np.eye(3) / d, (number,), rng) @ second
        variances.append(np.linalg.solve(draws, step).var(axis=0))
        own = spread(reading, jacobian[:, [pose]], v[:, [pose]], np.ones(1))[0]
        np.testing.assert_allclose(own, np.sqrt(variances[-1]), rtol=0.025)
        other = spread(Reading("lu", NATURAL, NATURAL), jacobian[:, [pose]], v[:, [pose]], [1.0])[0]
        assert np.any(np.abs(other / np.sqrt(variances[-1]) - 1) > 0.1)


def squares(reading: Reading, jacobian: np.ndarray) -> np.ndarray:
    first = first_factor(reading, jacobian)
    return first @ first.T


def test_no_two_orders_of_lu_without_pivoting_are_one_law_and_pivoted_lu_is_one_of_them(paths, arm):
    jacobian = arm[0].jacobian(paths.q[0, 3])
    plain = [r for r in all_readings(3, 3) if r.name == "lu"]
    assert len(plain) == 36 and len(all_readings(3, 3)) == 44
    laws = {reading: squares(reading, jacobian) for reading in plain}
    for one, other in combinations(plain, 2):
        assert not np.allclose(laws[one], laws[other], rtol=1e-3, atol=1e-6)
    for joints in permutations(range(3)):
        pivoted = squares(Reading("pivoted_lu", NATURAL, joints), jacobian)
        same = [r for r in plain if np.allclose(laws[r], pivoted, rtol=1e-9)]
        assert [r.joints for r in same] == [joints] and same[0].rows[0] == 2


def test_qr_does_not_depend_on_orders_and_lu_does(paths, arm, stated):
    jacobian = arm[0].jacobian(paths.q[:5])
    v, weights = np.matvec(jacobian, paths.step[:5, None]), quadrature(16)[1]
    for name, alike in (("qr", True), ("qr_transposed", True), ("pivoted_lu", False)):
        first, other = (
            spread(Reading(name, rows, joints), jacobian, v, weights)
            for rows, joints in ((NATURAL, NATURAL), ((2, 0, 1), (1, 2, 0)))
        )
        assert np.allclose(first, other, rtol=1e-9) == alike


def test_a_path_through_a_vanishing_pivot_has_no_spread_also_between_two_poses(arm):
    """In the natural order the first pivot is the height of the tip above the first joint."""
    chain, _ = arm
    middle = np.array([1.0, -1.2, 1.0])
    heights = [chain.jacobian(middle + np.array([x, 0, 0]))[0, 0] for x in (-1.0, 1.5)]
    assert heights[0] * heights[1] < 0
    for places in (np.array([-1.0, 1.5]), np.array([1.4, 1.5])):
        q = middle + places[:, None] * [1.0, 0, 0]
        jacobian = chain.jacobian(q)[None]
        v = np.matvec(jacobian, [0.01, 0, 0])
        lost = spread(LU, jacobian, v, np.full(2, 0.5))
        assert np.all(np.isnan(lost)) == (places[0] < 0)
        assert np.all(np.isfinite(spread(PIVOTED, jacobian, v, np.full(2, 0.5))))


def test_a_minor_that_changes_its_sign_is_a_crossing():
    jacobian = np.stack([np.eye(3), np.diag([1.0, -1.0, 1.0])])[None]
    crossed = crossings(jacobian)
    assert len(crossed) == 18
    both = frozenset({0, 1})
    assert crossed[both, both] and not crossed[frozenset({0}), frozenset({0})]
