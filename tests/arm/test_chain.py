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
    return PlanarChain(
        np.array([0.1, 0.4]),
        links,
        np.array(request.param),
        np.full(3, -2.0),
        np.full(3, 2.5),
        np.ones(3),
    )


def poses(chain: PlanarChain, count: int = 200) -> np.ndarray:
    """Joint angles anywhere within the limits whose elbow is bent by 3 degrees at least."""
    q = np.random.default_rng(4).uniform(chain.lower, chain.upper, (4 * count, 3))
    bent = np.abs(chain.determinant(q)) > 0.05 * chain.lengths[0] * chain.lengths[1]
    return q[bent][:count]


def in_line(chain: PlanarChain) -> np.ndarray:
    """Joint angles that stretch the first two links into one line."""
    bend = np.arctan2(*chain.links[0]) - np.arctan2(*chain.links[1])
    return np.array([0.3, chain.signs[1] * bend, -0.2])


def test_the_jacobian_is_the_derivative_of_the_pose(chain):
    step = 1e-6
    for q in poses(chain, 20):
        difference = [
            (chain.pose(q + step * e) - chain.pose(q - step * e)) / (2 * step) for e in np.eye(3)
        ]
        np.testing.assert_allclose(chain.jacobian(q), np.transpose(difference), atol=1e-9)


def test_the_inverse_is_the_inverse(chain):
    q = poses(chain)
    np.testing.assert_allclose(
        chain.inverse_jacobian(q), np.linalg.inv(chain.jacobian(q)), rtol=1e-9, atol=1e-9
    )


def test_the_determinant_is_the_determinant_and_the_elbows_sine(chain):
    q = poses(chain)
    np.testing.assert_allclose(chain.determinant(q), np.linalg.det(chain.jacobian(q)), atol=1e-15)
    psi = chain.segment_headings(q)
    area = chain.lengths[0] * chain.lengths[1] * np.abs(np.sin(psi[:, 1] - psi[:, 0]))
    np.testing.assert_allclose(np.abs(chain.determinant(q)), area, atol=1e-15)


def test_segments_keep_their_lengths_and_point_along_their_headings(chain):
    q = poses(chain)
    segments = np.diff(chain.points(q), axis=1)
    psi = chain.segment_headings(q)
    np.testing.assert_allclose(
        segments, chain.lengths[:, None] * np.stack([np.sin(psi), np.cos(psi)], axis=-1), atol=1e-15
    )
    assert np.array_equal(chain.points(q)[:, 0], np.tile(chain.origin, (len(q), 1)))


def test_joints_from_segments_undoes_segment_headings_whatever_the_turns(chain):
    q = np.random.default_rng(5).uniform(chain.lower, chain.upper, (300, 3))
    turns = 2 * np.pi * np.random.default_rng(6).integers(-2, 3, (300, 3))
    np.testing.assert_allclose(
        chain.joints_from_segments(chain.segment_headings(q) + turns), q, atol=1e-12
    )


def test_an_angle_beyond_the_limits_comes_back_nearest_to_their_middle(chain):
    middle = (chain.lower + chain.upper) / 2
    q = chain.joints_from_segments(chain.segment_headings(middle + np.array([3.1, -3.1, 3.2])))
    np.testing.assert_allclose(q - middle, [3.1, -3.1, 3.2 - 2 * np.pi], atol=1e-12)


def test_every_batch_shape_holds_what_single_poses_give(chain):
    q = poses(chain, 6)
    for shape, single in (((), q[0]), ((6,), q), ((2, 3), q.reshape(2, 3, 3)), ((0,), q[:0])):
        for method, tail in (
            ("headings", (3,)),
            ("segment_headings", (3,)),
            ("joints_from_segments", (3,)),
            ("pose", (3,)),
            ("points", (4, 2)),
            ("jacobian", (3, 3)),
            ("inverse_jacobian", (3, 3)),
            ("determinant", ()),
            ("within_limits", ()),
        ):
            batch = getattr(chain, method)(single)
            assert np.shape(batch) == (*shape, *tail)
            alone = np.array(
                [getattr(chain, method)(one) for one in np.reshape(single, (-1, 3))]
            ).reshape(np.shape(batch))
            np.testing.assert_allclose(batch, alone, rtol=1e-13, atol=1e-15)


def test_stretched_links_are_refused_with_their_place_in_the_batch(chain):
    q = poses(chain, 12).reshape(3, 4, 3)
    q[1, 2] = in_line(chain)
    with pytest.raises(SingularJacobianError, match=r"singular at 1 frame\(s\)") as refused:
        chain.inverse_jacobian(q, what="frame")
    evidence = refused.value.evidence
    assert evidence.pop("least_singular_value") < 1e-15
    assert evidence == {"index": (1, 2), "q": in_line(chain).round(4).tolist()}


def test_the_edge_of_what_is_singular_is_a_fraction_of_the_greatest_determinant(chain):
    below, above = (
        in_line(chain) + np.array([0, factor * np.arcsin(SINGULAR_SINE), 0])
        for factor in (0.99, 1.01)
    )
    with pytest.raises(SingularJacobianError) as refused:
        chain.inverse_jacobian(below)
    assert refused.value.evidence["index"] == ()
    # control: beyond the edge the closed form still inverts
    np.testing.assert_allclose(
        chain.inverse_jacobian(above) @ chain.jacobian(above), np.eye(3), atol=1e-9
    )


def test_what_is_singular_by_the_second_joint_is_so_by_the_determinant_of_the_jacobian(chain):
    # the joints beside it anywhere, the second by up to twice the edge off a straight arm,
    # stretched or folded
    rng = np.random.default_rng(5)
    q = in_line(chain) + rng.uniform(-1, 1, (4000, 3)) * [3.0, 2 * np.arcsin(SINGULAR_SINE), 3.0]
    q[::2, 1] += np.pi
    flat = (
        np.abs(np.linalg.det(chain.jacobian(q)))
        < SINGULAR_SINE * chain.lengths[0] * chain.lengths[1]
    )
    assert 1500 < np.sum(flat) < 2500
    np.testing.assert_array_equal(chain.singular(q), flat)


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("broken", [np.nan, np.inf])
@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_pose_that_is_no_number_is_singular_whichever_joint_it_is(chain, broken, joint):
    q = poses(chain, 3)
    assert not chain.singular(q).any()
    q[2, joint] = broken
    assert chain.singular(q).tolist() == [False, False, True]


@pytest.mark.parametrize("broken", [np.nan, np.inf])
@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_pose_that_is_no_number_is_refused(chain, broken):
    q = poses(chain, 3)
    q[2, 1] = broken
    with pytest.raises(SingularJacobianError, match="not finite") as refused:
        chain.inverse_jacobian(q)
    assert refused.value.evidence["index"] == (2,)


def test_limits_are_inside_and_a_single_joint_beyond_is_outside(chain):
    assert chain.within_limits(
        np.stack([chain.lower, chain.upper, (chain.lower + chain.upper) / 2])
    ).all()
    for j, (bound, way) in product(range(3), ((chain.lower, -1), (chain.upper, 1))):
        q = (chain.lower + chain.upper) / 2
        q[j] = np.nextafter(bound[j], way * np.inf)
        assert not chain.within_limits(q)
    assert not chain.within_limits(np.array([0.0, np.nan, 0.0]))
