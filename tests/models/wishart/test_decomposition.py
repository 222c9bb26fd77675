"""The closed-form LU and QR factors against SciPy's and against the law they must leave alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import lu, qr

from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.models.wishart.decomposition import (
    chosen,
    eliminate,
    factors,
    invert_upper,
    log_determinant,
)

SCALED = np.diag([0.15, 0.15, 1.0])


def test_elimination_agrees_with_lapack_on_matrices_of_every_pivot_order():
    rng = np.random.default_rng(1)
    matrices, right = rng.standard_normal((500, 3, 3)), rng.standard_normal((500, 3))
    upper, reduced = eliminate(matrices, right)
    orders = set()
    for i, matrix in enumerate(matrices):
        permutation, lower, reference = lu(matrix)  # matrix = permutation @ lower @ reference
        orders.add(tuple(permutation.argmax(axis=0)))
        np.testing.assert_allclose(upper[..., i], reference, atol=1e-12)
        np.testing.assert_allclose(
            reduced[:, i], np.linalg.solve(permutation @ lower, right[i]), atol=1e-11
        )
    assert len(orders) == 6
    np.testing.assert_allclose(
        invert_upper(upper) @ np.moveaxis(upper, -1, 0),
        np.broadcast_to(np.eye(3), (500, 3, 3)),
        atol=1e-9,
    )


def test_lu_factors_are_matlabs_two_output_form(chain, poses, step):
    a, back = factors(chain, poses, step, "lu")
    for i, jacobian in enumerate(chain.jacobian(poses)):
        j1, j2 = lu(jacobian, permute_l=True)
        np.testing.assert_allclose(a[i], np.linalg.solve(j1, step), atol=1e-14)
        np.testing.assert_allclose(back[i] @ j2, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("decomposition", ["lu", "qr", SCALED], ids=["lu", "qr", "given"])
def test_the_factors_compose_to_the_nominal_step(chain, poses, step, decomposition):
    a, back = factors(chain, poses, step, decomposition)
    np.testing.assert_allclose(
        np.matvec(back, a), np.matvec(chain.inverse_jacobian(poses), step), rtol=1e-10, atol=1e-14
    )


def test_the_row_of_phi_is_the_first_pivot_and_the_second_flips_with_the_pose(chain, poses):
    jacobians = chain.jacobian(poses)
    pivots = [lu(jacobian)[0].argmax(axis=0)[:2] for jacobian in jacobians]
    assert {int(first) for first, _ in pivots} == {2}
    assert {int(second) for _, second in pivots} == {0, 1}


def test_orthonormal_first_factors_give_one_law_and_lu_another(chain, poses, step):
    """The second moment of J₂⁻¹(B⁻¹a) is r²c·J₂⁻¹J₂⁻ᵀ + … with J₂ᵀJ₂ = JᵀJ for every orthonormal
    J₁.
    """
    for jacobian, pose in zip(chain.jacobian(poses[:20]), poses[:20], strict=True):
        q, r = qr(jacobian)
        a, back = factors(chain, pose, step, "qr")
        assert np.linalg.norm(q.T @ step) == pytest.approx(np.linalg.norm(a))
        np.testing.assert_allclose(np.linalg.inv(r.T @ r), back @ back.T, rtol=1e-9)
        a_lu, back_lu = factors(chain, pose, step, "lu")
        assert not np.allclose(
            (a_lu @ a_lu) * back_lu @ back_lu.T, (a @ a) * back @ back.T, rtol=0.01
        )


@pytest.mark.parametrize("decomposition", ["lu", "qr", SCALED], ids=["lu", "qr", "given"])
@pytest.mark.parametrize("pose", [[0.3, 0.0, 0.1], [0.3, np.pi, 0.1], [np.nan, 1.0, 0.1]])
def test_a_singular_pose_is_refused_with_its_place(chain, step, decomposition, pose):
    q = np.array([[0.3, 1.5, 0.2], pose])
    with pytest.raises(SingularJacobianError) as refusal:
        factors(chain, q, step, decomposition)
    assert refusal.value.evidence["index"] == (1,)


def test_a_given_first_factor_is_taken_as_it_is(chain, poses, step):
    left = np.random.default_rng(2).standard_normal((3, 3))
    a, back = factors(chain, poses, step, left)
    np.testing.assert_allclose(a, np.broadcast_to(np.linalg.solve(left, step), a.shape), rtol=1e-12)
    np.testing.assert_allclose(
        np.linalg.inv(back), np.linalg.solve(left, chain.jacobian(poses)), rtol=1e-9
    )


def test_the_identity_as_first_factor_is_qr(chain, poses, step):
    for given, qr_factor in zip(
        factors(chain, poses, step, np.eye(3)), factors(chain, poses, step, "qr"), strict=True
    ):
        assert np.array_equal(given, qr_factor)


@pytest.mark.parametrize("decomposition", ["lu", "qr", SCALED], ids=["lu", "qr", "given"])
def test_the_second_factors_determinant(chain, poses, step, decomposition):
    _, back = factors(chain, poses, step, decomposition)
    np.testing.assert_allclose(
        log_determinant(chain, poses, decomposition), -np.linalg.slogdet(back)[1], atol=1e-9
    )


def test_an_option_names_a_decomposition_or_gives_its_first_factor():
    assert chosen("lu") == "lu" and chosen("qr") == "qr"
    assert np.array_equal(chosen("given", SCALED.tolist()), SCALED)


@pytest.mark.parametrize(
    ("name", "left"),
    [
        ("svd", None),
        ("given", None),
        ("given", [[1.0, 2.0], [3.0, 4.0]]),
        ("given", [[1.0, 2.0], [3.0]]),
        ("given", np.zeros((3, 3))),
        ("given", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]),
        ("given", np.full((3, 3), np.nan)),
        ("given", "rows"),
    ],
)
def test_what_is_no_decomposition_is_refused(name, left):
    with pytest.raises(ModelDomainError):
        chosen(name, left)
