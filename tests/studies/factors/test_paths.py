"""Random paths stay where the arm and the bound let them, and means over a path are exact."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Legendre

from pipeline.models.norm import frobenius
from pipeline.studies.factors.paths import draw_paths, quadrature, with_tool


@pytest.mark.parametrize("nodes", [4, 16])
def test_the_quadrature_has_both_ends_and_is_exact_for_polynomials(nodes):
    places, weights = quadrature(nodes)
    assert places[0] == 0 and places[-1] == 1 and len(places) == nodes
    np.testing.assert_allclose(weights.sum(), 1)
    # the mean of a Legendre polynomial is zero; the first that is not exact
    beyond = 2 * nodes - 2
    means = [weights @ Legendre.basis(k)(2 * places - 1) for k in range(1, beyond + 1)]
    assert np.max(np.abs(means[:-1])) < 1e-12 and abs(means[-1]) > 1e-2


def test_every_path_is_straight_and_keeps_the_limits_of_angle_speed_and_norm(arm, stated, paths):
    chain, rate = arm
    assert 20 < len(paths.q) < 100
    assert np.all(chain.within_limits(paths.q))
    norm = frobenius(np.linalg.inv(chain.jacobian(paths.q)))
    np.testing.assert_allclose(paths.norm, norm, rtol=1e-9)
    assert np.all(norm < stated.u)
    speed = np.abs(paths.step) * rate / chain.max_speed
    np.testing.assert_allclose(speed.max(axis=1), 1.0)
    way = paths.q[:, -1] - paths.q[:, 0]
    np.testing.assert_allclose(np.cross(way, paths.step), 0, atol=1e-14)
    places = quadrature(16)[0]
    straight = paths.q[:, :1] + places[:, None] * way[:, None]
    np.testing.assert_allclose(paths.q, straight, atol=1e-12)


def test_a_higher_bound_keeps_more_of_the_same_paths(arm, stated, paths):
    chain, rate = arm
    rng = np.random.default_rng(3)
    more = draw_paths(chain, rate, 1.5 * stated.u, 300, quadrature(16)[0], rng)
    assert len(more.q) > len(paths.q)
    kept = np.all(more.norm < stated.u, axis=1)
    np.testing.assert_array_equal(more.q[kept], paths.q)


def test_another_tool_changes_the_length_of_the_last_link_alone(arm):
    chain, _ = arm
    other = with_tool(chain, 0.2)
    np.testing.assert_allclose(other.lengths, [*chain.lengths[:2], 0.2])
    np.testing.assert_allclose(other.links[2] / 0.2, chain.links[2] / chain.lengths[2])
    np.testing.assert_array_equal(other.links[:2], chain.links[:2])
