"""Decompositions of the Jacobian against LAPACK's, and dependences of their laws."""

from itertools import combinations

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from printed_algorithms import READINGS, every_reading, first_factor

from pipeline.core.errors import ModelDomainError
from pipeline.models.wishart.decomposition import Decomposition, factors, split
from pipeline.models.wishart.law import WishartModel

POSE = np.array([0.4, 1.7, -0.3])
ROTATION = np.linalg.qr(default_rng(24).standard_normal((3, 3)))[0]


@every_reading
@pytest.mark.parametrize(("m", "n"), [(3, 3), (2, 4), (3, 6), (6, 7)])
def test_the_factors_are_those_of_libraries_for_any_number_of_joints(
    m,
    n,
    decomposition,
):
    """The signs of the rows of J₂, which QR does not fix, cancel in the compared quantities."""
    rng = default_rng(m + n)
    jacobians = rng.standard_normal((60, m, n))
    v = rng.standard_normal((60, m))
    a, back, log_determinant = split(jacobians, v, decomposition)
    condition = np.linalg.cond(jacobians)

    for i in np.flatnonzero(condition < 1e3):
        j1 = first_factor(jacobians[i], decomposition)
        j2 = np.linalg.solve(j1, jacobians[i])
        exact = np.linalg.solve(j1, v[i])
        inverse = np.linalg.pinv(j2)
        _, twice = np.linalg.slogdet(j2 @ j2.T)
        scale = np.linalg.cond(j1) * condition[i]
        band = 1e-12 * scale
        wide = 1e-12 * scale**2

        assert_allclose(back[i] @ a[i], inverse @ exact, atol=band)
        assert a[i] @ a[i] == pytest.approx(exact @ exact, rel=band)
        squares = back[i] @ back[i].T
        assert_allclose(squares, inverse @ inverse.T, atol=wide)
        assert log_determinant[i] == pytest.approx(twice / 2, abs=10 * band)


@every_reading
def test_the_factors_compose_to_the_nominal_step_and_broadcast(
    chain,
    poses,
    step,
    decomposition,
):
    a, back, log_determinant = factors(chain, poses, step, decomposition)
    nominal = np.matvec(chain.inverse_jacobian(poses), step)
    assert_allclose(np.matvec(back, a), nominal, rtol=1e-10, atol=1e-14)
    assert_allclose(log_determinant, -np.linalg.slogdet(back)[1], atol=1e-9)

    sizes = np.linspace(0.1, 1, 7)[:, None]
    jacobian = chain.jacobian(poses[3])
    a_by_size, back_by_size, _ = split(jacobian, sizes * step, decomposition)
    assert_allclose(a_by_size, sizes * a[3], rtol=1e-12)
    assert back_by_size.shape == (7, 3, 3)


def test_every_decomposition_is_a_law_of_its_own(chain, step):
    covariances = {}
    for name, reading in READINGS.items():
        covariances[name] = WishartModel(0.25, reading).covariance(chain, POSE, step)
    for covariance, rival in combinations(covariances.values(), 2):
        difference = np.linalg.norm(covariance - rival)
        assert difference > 0.05 * np.linalg.norm(rival)


def moments(jacobian: np.ndarray, v: np.ndarray, reading: Decomposition) -> np.ndarray:
    """(3, 3) J₂⁺(r²·I + aaᵀ)J₂⁺ᵀ: any two laws of one decomposition differ in it."""
    a, back, _ = split(jacobian, v, reading)
    return back @ (a @ a * np.eye(3) + np.outer(a, a)) @ back.T


CHANGES = {  # matrices from the left and from the right of J
    "rotation of the task": (ROTATION, np.eye(3)),
    "units of the rows": (np.diag([1000.0, 1000.0, 1.0]), np.eye(3)),
    "order of the rows": (np.eye(3)[[1, 2, 0]], np.eye(3)),
    "order of the joints": (np.eye(3), np.eye(3)[[1, 2, 0]]),
}
INVARIANT = {
    "pivoted_lu": {"order of the rows"},
    "qr": {*CHANGES} - {"units of the rows"},
    "qr_transposed": {*CHANGES},
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", INVARIANT)
def test_what_a_decomposition_does_not_depend_on(name, change, chain, poses, step):
    """The decompositions whose law changes are the controls."""
    left, right = CHANGES[change]
    reading = Decomposition(name)
    for jacobian in chain.jacobian(poses[:10]):
        law = moments(jacobian, step, reading)
        changed = moments(left @ jacobian @ right.T, left @ step, reading)
        is_same = np.allclose(right.T @ changed @ right, law, rtol=1e-6, atol=1e-12)
        assert is_same == (change in INVARIANT[name])


def test_an_unknown_decomposition_is_refused():
    with pytest.raises(ModelDomainError, match="one of pivoted_lu, qr, qr_transposed"):
        Decomposition("lu")
