"""The perturbations held back by the bound: feasible, each certified by a dual point, and refused
where the equation is not solved; elsewhere they are the free optimum by LAPACK.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import SolverError
from pipeline.models.wishart import perturbation
from pipeline.models.wishart.perturbation import Perturbations, fit_perturbations

COUNT, ROOT = 3000, np.sqrt(2)
SIZES = [(1, 1), (2, 2), (6, 6), (3, 2), (7, 6), (8, 3)]


def fit(noise, e, matrix, ratio: float, floor: float) -> Perturbations:
    """Fit ω (N, n), e (N, m), A (N, n, m), λ and ε; objective (‖ω − Ay‖ + λ‖S‖)/(1 + λ)."""
    back = ROOT * matrix + (1 - ROOT) * np.matvec(matrix, e)[:, :, None] * e[:, None, :]
    return fit_perturbations(noise, e, back, (1 / (1 + ratio), ratio / (1 + ratio)), floor)


def parts(s: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """y (N, m) and c (N,) of S (N, m, m)."""
    image = np.matvec(s, e)
    along = np.vecdot(e, image)
    y = ROOT * image + (1 - ROOT) * along[:, None] * e
    return y, np.trace(s, axis1=1, axis2=2) - along


def objective(noise, e, matrix, ratio: float, s: np.ndarray) -> np.ndarray:
    rest = np.linalg.norm(noise - np.matvec(matrix, parts(s, e)[0]), axis=1)
    return rest + ratio * np.linalg.norm(s, axis=(1, 2))


def free_optimum(noise: np.ndarray, matrix: np.ndarray, ratio: float) -> np.ndarray:
    """(N, m) argmin over y of ‖ω − Ay‖ + λ‖y‖ for A (N, n, m): by LAPACK's singular values and
    halvings of its secular equation.
    """
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    c, square = np.vecmat(noise, left), singular**2
    rest = noise - np.matvec(left, c)
    outside = np.vecdot(rest, rest)[:, None] * (matrix.shape[1] > matrix.shape[2])
    # μ = scale·t/(1 − t): t = 0 is the exact fit, t = 1 is y = 0
    scale = square[:, :1]
    low, high = np.zeros_like(scale), np.ones_like(scale)

    def beyond(t: np.ndarray) -> np.ndarray:
        weights = (c / ((1 - t) * square + t * scale)) ** 2
        inside = (weights * (square - ratio**2)).sum(axis=-1, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            across = np.where(outside > 0, ratio**2 * outside / (t * scale) ** 2, 0.0)
        return inside >= across

    exact, zero = beyond(low), ~beyond(high)
    for _ in range(80):
        middle = (low + high) / 2
        above = beyond(middle)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    t = np.where(exact, 0.0, np.where(zero, 1.0, high))
    return np.vecmat((1 - t) * singular * c / ((1 - t) * square + t * scale), right)


def problems(seed, ratio, floor, size, n=3, m=3, across=1.0) -> tuple[np.ndarray, ...]:
    """ω, e, A and the free y of random problems, and which break the bound; of what ω has across
    the range of A a share ``across``.
    """
    rng = np.random.default_rng(seed)
    noise, e, matrix = (rng.standard_normal((COUNT, *shape)) for shape in ((n,), (m,), (n, m)))
    e, noise = e / np.linalg.norm(e, axis=1)[:, None], size * noise
    if n > m:
        axes = np.linalg.qr(matrix)[0]
        within = np.matvec(axes, np.vecmat(noise, axes))
        noise = within + across * (noise - within)
    y = free_optimum(noise, matrix, ratio)
    x = np.vecdot(e, y)
    broken = 1 + (x - np.sqrt(np.maximum(2 * np.vecdot(y, y) - x**2, 0.0))) / 2 < floor
    return noise, e, matrix, y, broken


def violators(*arguments) -> list[np.ndarray]:
    """Those of the problems whose free optimum is beyond the bound."""
    *each, broken = problems(*arguments)
    return [values[broken] for values in each[:3]]


def dual_bound(noise, e, matrix, y, c, ratio, floor) -> np.ndarray:
    """A value that no feasible S goes below, from a dual point (p, u, w) near the optimal one.

    Of the conic program with the cone 2(δ + x)(δ + c) ≥ ‖d‖²: for ‖p‖ ≤ 1, ‖(u, w)‖ ≤ λ and m = u −
    Aᵀp in the dual cone, 2m_e·w ≥ ‖m⊥‖², the objective is at least pᵀω − δ(m_e + w) (weak duality).
    """
    delta = 1 - floor
    x, size = np.vecdot(e, y), np.sqrt(np.vecdot(y, y) + c**2)
    u, w = ratio * y / size[:, None], ratio * c / size
    # p = r/‖r‖, and where the fit is exact what makes m normal to the cone
    residual = noise - np.matvec(matrix, y)
    length = np.linalg.norm(residual, axis=1)
    normal = (w / (delta + x))[:, None] * ((delta + c + x)[:, None] * e - y)
    of_exact = np.linalg.solve(np.swapaxes(matrix, 1, 2), (u - normal)[..., None])[..., 0]
    exact = length < 1e-9 * np.linalg.norm(noise, axis=1)
    p = np.where(exact[:, None], of_exact, residual / np.where(exact, 1.0, length)[:, None])
    p /= np.maximum(1.0, np.linalg.norm(p, axis=1))[:, None]
    m = u - np.vecmat(p, matrix)
    along = np.vecdot(e, m)
    lifted = np.maximum(np.vecdot(m - along[:, None] * e, m) / (2 * w), along)
    u = u + (lifted - along)[:, None] * e
    shrink = np.minimum(1.0, ratio / np.sqrt(np.vecdot(u, u) + w**2))
    return shrink * (np.vecdot(p, noise) - delta * (lifted + w))


@pytest.mark.parametrize("ratio", [1e-3, 0.03, 0.3])
@pytest.mark.parametrize(("floor", "size"), [(0.01, 3.0), (0.2, 1.0), (0.9, 0.3)])
def test_every_optimum_is_certified_by_its_dual(ratio, floor, size):
    noise, e, matrix = violators(1, ratio, floor, size)
    s = fit(noise, e, matrix, ratio, floor).s
    y, c = parts(s, e)

    def gap(y: np.ndarray) -> np.ndarray:
        rest, norm = np.linalg.norm(noise - np.matvec(matrix, y), axis=1), np.vecdot(y, y) + c**2
        value = rest + ratio * np.sqrt(norm)
        return (value - dual_bound(noise, e, matrix, y, c, ratio, floor)) / value

    norms = np.sqrt(np.vecdot(y, y) + c**2)
    np.testing.assert_allclose(np.linalg.norm(s, axis=(1, 2)), norms, rtol=1e-9)
    assert len(noise) > 100 and np.linalg.eigvalsh(s).min() > floor - 1 - 1e-10
    assert np.quantile(gap(y), 0.99) < 1e-8 and gap(y).max() < 1e-5
    # the control: the dual point of a place beside the optimum certifies nothing
    assert np.median(gap(y * (1 + 1e-3))) > 1e-4


@pytest.mark.parametrize(("n", "m"), SIZES)
@pytest.mark.parametrize("across", [0.0, 1e-13, 1e-9, 1e-3, 1.0])
def test_every_minimum_of_any_size_is_reached_and_none_beside_it_is_lower(n, m, across):
    """However little of the noise lies across the range of A, where F all but has no gradient."""
    rng = np.random.default_rng(5)
    for ratio, floor, size in ((1e-3, 0.01, 3.0), (0.03, 0.2, 1.0), (0.3, 0.01, 3.0)):
        noise, e, matrix = violators(4, ratio, floor, size, n, m, across)
        s, case = fit(noise, e, matrix, ratio, floor).s, (noise, e, matrix, ratio)
        assert np.linalg.eigvalsh(s).min() > floor - 1 - 1e-9
        for step in (1e-4, 1e-2):
            root = np.sqrt(step) * rng.standard_normal((len(s), m, m))
            inward = (floor - 1) * np.eye(m) + root @ np.swapaxes(root, 1, 2)
            beside = objective(*case, s + step * (inward - s))
            assert np.all(beside >= objective(*case, s) * (1 - 1e-9))


@pytest.mark.parametrize(("n", "m"), SIZES[:-1])
def test_the_bound_holds_those_perturbations_back_whose_free_optimum_breaks_it(n, m):
    noise, e, matrix, y, broken = problems(6, 0.03, 0.2, 1.0, n, m)
    fits = fit(noise, e, matrix, 0.03, 0.2)
    np.testing.assert_array_equal(fits.bound, broken)
    assert 100 < broken.sum() < COUNT - 100
    np.testing.assert_allclose(parts(fits.s, e)[0][~broken], y[~broken], rtol=1e-7, atol=1e-9)


def test_along_its_own_direction_the_perturbation_stops_at_the_bound():
    """With A = −I and ω along e the free optimum is x = −2 < ε − 1; the bounded one is x = ε − 1,
    no cross term and no block.
    """
    e = np.array([0.6, 0.8, 0.0])
    for aside, tolerance in ((0.0, 1e-12), (1e-7, 1e-6)):
        noise = 2 * e + aside * np.array([0.0, 0.0, 1.0])
        s = fit(noise[None], e[None], -np.eye(3)[None], 1e-3, 0.1).s[0]
        np.testing.assert_allclose(s, -0.9 * np.outer(e, e), atol=tolerance)


def test_a_minimum_that_was_not_reached_raises_with_its_evidence(monkeypatch):
    noise, e, matrix = violators(1, 0.03, 0.2, 1.0)
    monkeypatch.setattr(perturbation, "STEPS", 2)
    with pytest.raises(SolverError, match="not solved to optimality") as refusal:
        fit(noise, e, matrix, 0.03, 0.2)
    assert len(refusal.value.evidence["noise"]) == 3
    assert refusal.value.evidence["ratio"] == pytest.approx(0.03)


@pytest.mark.parametrize(("far", "refused"), [(1e-5, False), (1e-8, True), (1e-15, True)])
def test_an_arm_that_is_all_but_singular_is_refused(far, refused):
    """Rounding would decide the fit there; a thousand times as far from it it is solved."""
    e, noise = np.array([[0.6, 0.8]]), np.array([[1.0, 2.0]])
    matrix = np.array([[[1.0, 1.0], [1.0, 1.0 + far]]])
    if not refused:
        assert fit(noise, e, matrix, 0.03, 0.2).objective[0] > 0
        return
    with pytest.raises(SolverError, match="not solved to optimality"):
        fit(noise, e, matrix, 0.03, 0.2)
