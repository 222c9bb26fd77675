"""The factors of whole batches against LAPACK's and quotients of minors, one Jacobian at a time."""

from __future__ import annotations

import numpy as np
import pytest
from oracles import READINGS, every_reading, first_factor, pivot_shares
from scipy.linalg import lu

from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.models.wishart.decomposition import LU, Decomposition
from pipeline.models.wishart.factors import PIVOT, factors, split
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.reduction import eliminate


def of_size(reading: Decomposition, m: int, n: int, rng) -> Decomposition:
    """The like of ``reading`` for Jacobians of another size."""
    left = None if reading.left is None else rng.standard_normal((m, m))
    rows, order = (
        None if part is None else rng.permutation(size).tolist()
        for part, size in ((reading.rows, m), (reading.order, n))
    )
    return Decomposition(reading.name, left, rows, order)


@every_reading
@pytest.mark.parametrize(("m", "n"), [(3, 3), (2, 4), (3, 6), (6, 7)])
def test_the_factors_are_those_of_libraries_for_any_number_of_joints(m, n, decomposition):
    """Signs of rows of J₂, which QR leaves open, turn no law: what is compared is free of them."""
    rng = np.random.default_rng(m + n)
    reading = of_size(decomposition, m, n, rng)
    jacobians, v = rng.standard_normal((60, m, n)), rng.standard_normal((60, m))
    a, back, log_determinant = split(jacobians, v, reading)
    defined, condition = np.isfinite(log_determinant), np.linalg.cond(jacobians)
    assert defined.mean() > 0.8
    for i in np.flatnonzero(defined & (condition < 1e3)):
        j1 = first_factor(jacobians[i], reading)
        j2 = np.linalg.solve(j1, jacobians[i])
        exact, way = np.linalg.solve(j1, v[i]), np.linalg.pinv(j2)
        scale = np.linalg.cond(j1) * condition[i]
        np.testing.assert_allclose(back[i] @ a[i], way @ exact, atol=1e-12 * scale)
        assert a[i] @ a[i] == pytest.approx(exact @ exact, rel=1e-12 * scale)
        np.testing.assert_allclose(back[i] @ back[i].T, way @ way.T, atol=1e-12 * scale**2)
        assert log_determinant[i] == pytest.approx(
            np.linalg.slogdet(j2 @ j2.T)[1] / 2, abs=1e-11 * scale
        )
        if reading.name not in ("qr", "qr_transposed"):
            np.testing.assert_allclose(a[i], exact, atol=1e-12 * scale)


def test_one_step_and_one_jacobian_broadcast_over_batches(chain, poses, step):
    jacobians = chain.jacobian(poses).reshape(20, 10, 3, 3)
    whole = split(jacobians, np.broadcast_to(step, (20, 10, 3)), LU)
    for part, expected in zip(split(jacobians, step, LU), whole, strict=True):
        assert np.array_equal(part, expected)
    steps = np.linspace(0.1, 1, 7)[:, None] * step
    a, back, _ = split(jacobians[3, 4], steps, LU)
    np.testing.assert_allclose(a, np.linspace(0.1, 1, 7)[:, None] * whole.a[3, 4], rtol=1e-12)
    assert back.shape == (7, 3, 3)


@every_reading
def test_the_factors_compose_to_the_nominal_step(chain, poses, step, decomposition):
    a, back, log_determinant = factors(chain, poses, step, decomposition)
    np.testing.assert_allclose(
        np.matvec(back, a), np.matvec(chain.inverse_jacobian(poses), step), rtol=1e-10, atol=1e-14
    )
    np.testing.assert_allclose(log_determinant, -np.linalg.slogdet(back)[1], atol=1e-9)


def test_elimination_agrees_with_lapack_on_matrices_of_every_pivot_order():
    rng = np.random.default_rng(1)
    matrices = rng.standard_normal((500, 3, 3))
    rows, orders = np.moveaxis(matrices, 0, -1).copy(), set()
    eliminate(rows, range(3), exchange=True)
    for i, matrix in enumerate(matrices):
        permutation, _, upper = lu(matrix)
        orders.add(tuple(permutation.argmax(axis=0)))
        np.testing.assert_allclose(rows[..., i], upper, atol=1e-12)
    assert len(orders) == 6


@pytest.mark.parametrize("name", ["lu", "lu, other orders"])
def test_the_shares_of_the_pivots_are_free_of_the_units_of_the_rows(name):
    rng, reading = np.random.default_rng(2), READINGS[name]
    jacobians = rng.standard_normal((50, 3, 3))
    rows = np.moveaxis(jacobians[:, list(reading.rows or range(3))], 0, -1)
    shares = eliminate(rows.copy(), reading.order or range(3), exchange=False)
    for i, jacobian in enumerate(jacobians):
        np.testing.assert_allclose(shares[:, i], pivot_shares(jacobian, reading), rtol=1e-8)
    units = np.array([1000.0, 0.1, 3.0])[:, None, None]
    scaled = eliminate(units * rows, reading.order or range(3), exchange=False)
    np.testing.assert_allclose(scaled, shares, rtol=1e-12)
    # control: as a number a pivot has a unit
    assert np.abs(units[0] * rows[0, 0] / rows[0, 0] - 1).min() > 1


def level_with_the_first_joint(chain, pose: np.ndarray, share: float) -> np.ndarray:
    """``pose`` turned until the height of the tip above the first joint has this share of the
    length of its row.
    """
    turned = np.tile(pose, (200_001, 1))
    turned[:, 0] += np.linspace(-np.pi / 2, np.pi / 2, len(turned))
    row = chain.jacobian(turned)[:, 0]
    return turned[np.abs(np.abs(row[:, 0]) / np.linalg.norm(row, axis=1) - share).argmin()]


def test_where_the_tip_is_level_with_the_first_joint_lu_is_refused_and_no_number(
    chain, poses, step
):
    level = level_with_the_first_joint(chain, poses[0], 0.5 * PIVOT)
    q = np.stack([poses[0], poses[1], level])
    a, back, log_determinant = split(chain.jacobian(q), step, LU)
    assert np.isnan(a[2]).all() and np.isnan(back[2]).all() and np.isnan(log_determinant[2])
    assert np.isfinite(a[:2]).all() and np.isfinite(back[:2]).all()
    for call in (
        lambda: factors(chain, q, step, LU),
        lambda: WishartModel(0.25).covariance(chain, q, step),
        lambda: WishartModel(0.25).log_density(chain, q, step, q + 0.01, np.eye(3)),
    ):
        with pytest.raises(ModelDomainError, match="small pivot at 1 pose") as refused:
            call()
        evidence = refused.value.evidence
        assert evidence["index"] == (2,) and evidence["q"] == level.round(4).tolist()
        assert evidence["pivot"] == 1
        assert evidence["share_of_its_row"] == pytest.approx(0.5 * PIVOT, rel=0.01)
        assert "another order of rows" in str(refused.value)
    # controls: a pivot twice as large as the least, and the other readings at the same pose
    near = level_with_the_first_joint(chain, poses[0], 2 * PIVOT)
    assert np.isfinite(factors(chain, near, step, LU).a).all()
    others = [READINGS[name] for name in ("pivoted_lu", "qr", "qr_transposed", "given")]
    for reading in (*others, Decomposition("lu", rows=(1, 0, 2))):
        assert np.isfinite(factors(chain, q, step, reading).back).all()


def test_the_noise_of_lu_grows_as_the_inverse_square_of_a_vanishing_pivot(chain, poses, step):
    def spread(share: float, reading: Decomposition) -> float:
        q = level_with_the_first_joint(chain, poses[0], share)
        return float(np.sqrt(np.trace(WishartModel(0.25, reading).covariance(chain, q, step))))

    assert spread(0.015, LU) / spread(0.03, LU) == pytest.approx(4, rel=0.1)
    # control: the pose means nothing to the arm
    assert spread(0.015, READINGS["qr"]) / spread(0.03, READINGS["qr"]) == pytest.approx(1, rel=0.1)


@every_reading
@pytest.mark.parametrize("pose", [[0.3, 0.0, 0.1], [0.3, np.pi, 0.1], [np.nan, 1.0, 0.1]])
def test_a_singular_pose_is_refused_with_its_place(chain, step, decomposition, pose):
    q = np.array([[0.3, 1.5, 0.2], pose])
    with pytest.raises(SingularJacobianError) as refusal:
        factors(chain, q, step, decomposition)
    assert refusal.value.evidence["index"] == (1,)
