"""The planar chain's closed forms against linear algebra, finite differences and geometry."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from pipeline.arm.chain import SINGULAR_SINE, PlanarChain
from pipeline.core.errors import SingularJacobianError


@pytest.fixture(scope="module", params=list(product((1.0, -1.0), repeat=3)), ids=str)
def chain(request) -> PlanarChain:
    """Links that point anywhere, for every combination of the joints' senses."""
    links = np.random.default_rng(3).uniform(-0.2, 0.2, (3, 2))
    limits = np.full(3, -2.0), np.full(3, 2.5), np.ones(3)
    return PlanarChain(np.array([0.1, 0.4]), links, np.array(request.param), *limits)


def poses(chain: PlanarChain, count: int = 200) -> np.ndarray:
    """Joint angles anywhere within the limits whose elbow is bent by 3 degrees at least."""
    q = np.random.default_rng(4).uniform(chain.lower, chain.upper, (4 * count, 3))
    bent = np.abs(chain.determinant(q)) > 0.05 * chain.lengths[0] * chain.lengths[1]
    return q[bent][:count]


def in_line(chain: PlanarChain) -> np.ndarray:
    """Joint angles that stretch the first two links into one line."""
    bend = np.arctan2(*chain.links[0]) - np.arctan2(*chain.links[1])
    return np.array([0.3, chain.signs[1] * bend, -0.2])


def test_jacobian_inverse_and_determinant_are_those_of_the_derivative_of_the_pose(chain):
    q, step = poses(chain), 1e-6
    columns = [
        (chain.pose(q + step * e) - chain.pose(q - step * e)) / (2 * step) for e in np.eye(3)
    ]
    np.testing.assert_allclose(chain.jacobian(q), np.stack(columns, axis=-1), atol=1e-9)
    inverse = np.linalg.inv(chain.jacobian(q))
    np.testing.assert_allclose(chain.inverse_jacobian(q), inverse, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(chain.determinant(q), np.linalg.det(chain.jacobian(q)), atol=1e-15)


def test_segments_keep_their_lengths_and_point_along_their_headings(chain):
    q = poses(chain)
    psi, segments = chain.segment_headings(q), np.diff(chain.points(q), axis=1)
    directions = np.stack([np.sin(psi), np.cos(psi)], axis=-1)
    np.testing.assert_allclose(segments, chain.lengths[:, None] * directions, atol=1e-15)
    assert np.array_equal(chain.points(q)[:, 0], np.tile(chain.origin, (len(q), 1)))


def test_joints_come_back_from_segments_whatever_the_turns_nearest_to_the_middle_of_the_limits(
    chain,
):
    q = np.random.default_rng(5).uniform(chain.lower, chain.upper, (300, 3))
    turns = 2 * np.pi * np.random.default_rng(6).integers(-2, 3, (300, 3))
    back = chain.joints_from_segments(chain.segment_headings(q) + turns)
    np.testing.assert_allclose(back, q, atol=1e-12)
    middle = (chain.lower + chain.upper) / 2
    beyond = chain.joints_from_segments(chain.segment_headings(middle + np.array([3.1, -3.1, 3.2])))
    np.testing.assert_allclose(beyond - middle, [3.1, -3.1, 3.2 - 2 * np.pi], atol=1e-12)


def test_a_singular_pose_is_refused_with_its_place_in_the_batch(chain):
    q = poses(chain, 12).reshape(3, 4, 3)
    q[1, 2] = in_line(chain)
    with pytest.raises(SingularJacobianError, match=r"singular at 1 frame\(s\)") as refused:
        chain.inverse_jacobian(q, what="frame")
    evidence = refused.value.evidence
    assert evidence.pop("least_singular_value") < 1e-15
    assert evidence == {"index": (1, 2), "q": in_line(chain).round(4).tolist()}


def test_a_pose_is_singular_where_the_determinant_is_below_its_share(chain):
    # the second joint by up to twice the edge off a straight arm, stretched or folded
    rng = np.random.default_rng(5)
    q = in_line(chain) + rng.uniform(-1, 1, (4000, 3)) * [3.0, 2 * np.arcsin(SINGULAR_SINE), 3.0]
    q[::2, 1] += np.pi
    edge = SINGULAR_SINE * chain.lengths[0] * chain.lengths[1]
    flat = np.abs(np.linalg.det(chain.jacobian(q))) < edge
    assert 1500 < np.sum(flat) < 2500
    np.testing.assert_array_equal(chain.singular(q), flat)
    regular = q[~flat]
    product_of_both = chain.inverse_jacobian(regular) @ chain.jacobian(regular)
    np.testing.assert_allclose(product_of_both, np.tile(np.eye(3), (len(regular), 1, 1)), atol=1e-9)


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("broken", [np.nan, np.inf])
@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_pose_that_is_not_finite_is_singular_whichever_joint_it_is(chain, broken, joint):
    q = poses(chain, 3)
    q[2, joint] = broken
    assert chain.singular(q).tolist() == [False, False, True]
    with pytest.raises(SingularJacobianError, match="not finite") as refused:
        chain.inverse_jacobian(q)
    assert refused.value.evidence["index"] == (2,)
