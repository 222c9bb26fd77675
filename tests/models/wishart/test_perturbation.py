"""The perturbation samples against the paper's convex problem as printed, for arms of any size,
each certified by a dual point; and the paper's estimator from them.
"""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from random_arm import motion, random_arm

from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models.convex import perturbation_gap, solve_perturbation
from pipeline.models.draws import draw_steps
from pipeline.models.steps import Recorded, process_noise
from pipeline.models.wishart import perturbation
from pipeline.models.wishart.decomposition import PIVOTED_LU, Decomposition, factors
from pipeline.models.wishart.fit import fit_paper, problem_steps, solve_problems
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.perturbation import (
    Perturbations,
    fit_perturbations,
    objective_weights,
)

FLOOR, WEIGHTS, ROOT = 0.2, (0.999, 0.001), np.sqrt(2)
REST, MOVING = 10, 30  # steps without a command and steps with one


def weights(ratio: float) -> tuple[float, float]:
    return 1 / (1 + ratio), ratio / (1 + ratio)


def scene(chain, poses, step, size: float) -> tuple[np.ndarray, ...]:
    """Noise (200, 3) of standard deviation ``size`` in rad, a and J₂⁺ of steps of all speeds."""
    rng = default_rng(1)
    noise = size * rng.standard_normal((200, 3))
    v = step * rng.uniform(0.1, 1.2, (200, 1))
    a, back, _ = factors(chain, poses, v, PIVOTED_LU)
    return noise, a, back


def arm_problems(n: int, m: int, decomposition: Decomposition, share: float):
    """Jacobians, commands, a, J₂⁺ and noise of ``share`` of the steps of 120 problems."""
    arm = random_arm(n, m)
    q, v = motion(arm, 120, 0)
    step = arm.nominal_step(q[:-1], v)
    noise = default_rng(n + m).standard_normal(step.shape)
    noise *= share * np.sqrt(np.mean(step**2))
    a, back, _ = factors(arm, q[:-1], v, decomposition)
    return arm.jacobian(q[:-1]), v[:, :m], a, back, noise


@pytest.mark.parametrize(
    ("n", "m", "name"),
    [
        (1, 1, "pivoted_lu"),
        (4, 4, "qr"),
        (6, 6, "qr_transposed"),
        (2, 1, "qr_transposed"),
        (5, 3, "pivoted_lu"),
        (8, 3, "qr"),
    ],
)
def test_the_perturbations_are_those_of_the_problem_as_printed(n, m, name):
    """Under the bound too: whatever m, one eigenvalue of ddᵀ/2x − I alone can be positive. B⁻¹ to
    what a conic solver leaves of a flat optimum; controls: a wrong objective, the next step's B⁻¹.
    """
    decomposition = Decomposition(name)
    jacobians, v, a, back, noise = arm_problems(n, m, decomposition, 1.5)
    fits = fit_perturbations(noise, a, back, WEIGHTS, FLOOR)
    b_inverse = np.eye(m) + fits.s

    assert np.linalg.eigvalsh(b_inverse).min() > FLOOR - 1e-10

    for kind in (fits.bound, ~fits.bound):
        at = np.flatnonzero(kind)[:2]
        assert len(at) == 2
        printed = fits.objective[at], jacobians[at], v[at], noise[at]
        assert perturbation_gap(printed, decomposition, WEIGHTS, FLOOR) < 1e-5
    wrong = 1.01 * printed[0], *printed[1:]

    assert perturbation_gap(wrong, decomposition, WEIGHTS, FLOOR) > 0.009

    if name != "qr":  # only there J₁ = I
        return
    moved = np.flatnonzero(np.linalg.norm(fits.s, axis=(1, 2)) > 0.05)[:3]
    for i in moved:
        problem = noise[i], v[i], np.eye(m), jacobians[i]
        b_inv, _ = solve_perturbation(*problem, WEIGHTS, FLOOR)
        band = 5e-3 * np.abs(b_inv).max()
        assert_allclose(b_inverse[i], b_inv, atol=band)
    difference = fits.s[moved[0]] - fits.s[moved[1]]

    assert np.abs(difference).max() > 0.02


def test_many_of_those_problems_are_held_back_by_the_bound(chain, poses, step):
    """A smaller bound only lowers the objective."""
    noise, a, back = scene(chain, poses, step, 0.02)
    fit, looser = (
        fit_perturbations(noise, a, back, weights(1e-3), floor)
        for floor in (0.1, 0.001)
    )

    assert fit.bound.sum() > 20
    assert np.all(looser.objective <= fit.objective * (1 + 1e-9))
    assert np.any(looser.objective[fit.bound] < fit.objective[fit.bound] * (1 - 1e-3))
    assert_array_equal(looser.s[~fit.bound], fit.s[~fit.bound])


def test_equal_weights_return_the_identity_for_every_step(chain, poses, step):
    """The paper's weights are not given: with α₁ = α₂ = ½ every fit is B = I, and σ̂_B = 0."""
    noise, a, back = scene(chain, poses, step, 0.006)
    assert not np.any(fit_perturbations(noise, a, back, (0.5, 0.5), 0.01).s)

    fits = (
        fit_perturbations(noise, a, back, weights(ratio), 0.01) for ratio in (0.3, 3e-3)
    )
    few, most = (fit_of_ratio.s.any(axis=(1, 2)).mean() for fit_of_ratio in fits)

    assert few < 0.1 < 0.9 < most


def test_an_exact_fit_inverts_the_model(chain, poses, step):
    """(B⁻¹ − I)a = J₂ω, with ω measured minus nominal; with the printed sign of (OmgReal) the
    perturbation comes out reversed.
    """
    b_inv = np.eye(3) + 0.1 * np.array([[1.0, 0.5, 0], [0.5, -1.0, 0.3], [0, 0.3, 0.5]])
    a, back, _ = factors(chain, poses, step, PIVOTED_LU)
    q = np.stack([poses, poses + np.matvec(back, a @ b_inv)], axis=1)
    noise = process_noise(chain, q, step[None])[:, 0]
    image, reverse = (
        np.matvec(fit_perturbations(deviation, a, back, weights(1e-9), 0.01).s, a)
        for deviation in (noise, -noise)
    )

    assert_allclose(a + image, a @ b_inv, atol=1e-12)
    assert np.linalg.norm(reverse - image) > np.linalg.norm(image)


@pytest.mark.parametrize("m", [3, 6])
def test_weights_follow_from_the_noise_at_rest(m):
    """The noise at rest costs as much as a perturbation of the size of the identity."""
    alpha1, alpha2 = objective_weights(1e-3, m)
    assert alpha1 + alpha2 == pytest.approx(1, abs=1e-15)
    assert alpha1 * 1e-3 == pytest.approx(alpha2 * np.linalg.norm(np.eye(m)))
    with pytest.raises(ModelDomainError, match="noise at rest must be positive"):
        objective_weights(0.0, m)


def recorded(chain, poses, step, sigma_b: float, measured: float) -> Recorded:
    """The Wishart model's own steps, measured with white noise of ``measured`` rad."""
    rng = default_rng(31)
    v = np.vstack([np.zeros((REST, 3)), np.tile(step, (MOVING, 1))])
    q = np.tile(poses[: REST + MOVING], (100, 1, 1))
    noise = draw_steps(WishartModel(sigma_b), chain, q, v, rng)[0]
    noise -= q + np.matvec(chain.inverse_jacobian(q), v)
    noise += measured * rng.standard_normal(noise.shape)
    return Recorded(chain, q, v, noise, ("a", "b", "c"))


def test_at_rest_nothing_is_perturbed_and_the_mean_over_time_counts_those_steps(
    chain,
    poses,
    step,
):
    data = recorded(chain, poses, step, 0.2, 1e-4)
    resting = np.sqrt(np.mean(np.sum(data.noise[:, :REST] ** 2, axis=-1)))
    steps = problem_steps(data, PIVOTED_LU)
    b, fits = solve_problems(steps, objective_weights(resting, 3), FLOOR)
    squares = np.sum((b - np.eye(3)) ** 2, axis=(-2, -1)) / 3
    dispersions = np.sqrt(squares.mean(axis=0))
    result = fit_paper(data, PIVOTED_LU, FLOOR)

    assert not fits.s.reshape(100, -1, 3, 3)[:, :REST].any()
    assert not dispersions[:REST].any() and np.all(dispersions[REST:] > 0)
    assert_allclose(result.estimates["sigma_b"], dispersions.mean())


def test_noise_that_is_not_finite_and_a_motion_without_noise_at_rest_are_refused(
    chain,
    poses,
    step,
):
    data = recorded(chain, poses, step, 0.2, 1e-4)
    data.noise[2, REST, 1] = np.nan
    with pytest.raises(
        ModelDomainError,
        match="must be finite at every step",
    ) as refusal:
        fit_paper(data, PIVOTED_LU, FLOOR)
    assert refusal.value.evidence["index"] == 2 * (REST + MOVING) + REST

    data.noise[:, :REST] = 0.0
    for command in (0.0, 1e-4):  # noise at rest is zero; no step is at rest
        data.v[:REST] = command
        with pytest.raises(ModelDomainError, match="noise at rest"):
            fit_paper(data, PIVOTED_LU, FLOOR)


def fit(noise, e, matrix, ratio: float, floor: float) -> Perturbations:
    """Fit ω (N, n), e (N, m), A (N, n, m), λ and ε; objective (‖ω − Ay‖ + λ‖S‖)/(1 + λ)."""
    back = ROOT * matrix + (1 - ROOT) * np.matvec(matrix, e)[:, :, None] * e[:, None, :]
    return fit_perturbations(noise, e, back, weights(ratio), floor)


def parts(s: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """y (N, m) and c (N,) of S (N, m, m)."""
    image = np.matvec(s, e)
    along = np.vecdot(e, image)
    y = ROOT * image + (1 - ROOT) * along[:, None] * e
    return y, np.trace(s, axis1=1, axis2=2) - along


def objective(noise, e, matrix, ratio: float, s: np.ndarray) -> np.ndarray:
    rest = np.linalg.norm(noise - np.matvec(matrix, parts(s, e)[0]), axis=1)
    return rest + ratio * np.linalg.norm(s, axis=(1, 2))


def problems(
    seed: int,
    size: float,
    n: int,
    m: int,
    across: float = 1.0,
) -> tuple[np.ndarray, ...]:
    """ω, e and A of 800 random problems; of what ω has across the range of A a share ``across``."""
    rng = default_rng(seed)
    noise, e, matrix = (
        rng.standard_normal((800, *shape)) for shape in ((n,), (m,), (n, m))
    )
    if n > m:
        axes = np.linalg.qr(matrix)[0]
        within = np.matvec(axes, np.vecmat(noise, axes))
        noise = within + across * (noise - within)
    return size * noise, e / np.linalg.norm(e, axis=1)[:, None], matrix


def dual_bound(noise, e, matrix, y, c, ratio, floor) -> np.ndarray:
    """A value that no feasible S goes below, by weak duality from points near the optimal ones.

    Without the bound pᵀω for ‖p‖ ≤ 1 and ‖Aᵀp‖ ≤ λ. With it, of the conic program with the cone
    2(δ + x)(δ + c) ≥ ‖d‖²: for ‖p‖ ≤ 1, ‖(u, w)‖ ≤ λ and m = u − Aᵀp in the dual cone, 2m_e·w ≥
    ‖m⊥‖², the objective is at least pᵀω − δ(m_e + w).
    """
    delta = 1 - floor
    x = np.vecdot(e, y)
    size = np.sqrt(np.vecdot(y, y) + c**2)
    size = np.where(size > 0, size, 1.0)
    u = ratio * y / size[:, None]
    w = ratio * c / size
    # p = r/‖r‖, and where the fit is exact what makes m normal to the cone
    residual = noise - np.matvec(matrix, y)
    length = np.linalg.norm(residual, axis=1)
    normal = (w / (delta + x))[:, None] * ((delta + c + x)[:, None] * e - y)
    of_exact = np.linalg.solve(np.swapaxes(matrix, 1, 2), (u - normal)[..., None])[
        ...,
        0,
    ]
    exact = length < 1e-9 * np.linalg.norm(noise, axis=1)
    p = np.where(
        exact[:, None],
        of_exact,
        residual / np.where(exact, 1.0, length)[:, None],
    )
    p /= np.maximum(1.0, np.linalg.norm(p, axis=1))[:, None]
    image = np.vecmat(p, matrix)
    value = np.vecdot(p, noise)
    free = value * np.minimum(1.0, ratio / np.linalg.norm(image, axis=1))
    m = u - image
    along = np.vecdot(e, m)
    with np.errstate(divide="ignore", invalid="ignore"):
        lifted = np.maximum(np.vecdot(m - along[:, None] * e, m) / (2 * w), along)
        u = u + (lifted - along)[:, None] * e
        shrink = np.minimum(1.0, ratio / np.sqrt(np.vecdot(u, u) + w**2))
        held = shrink * (value - delta * (lifted + w))
    return np.fmax(free, held)


@pytest.mark.parametrize("ratio", [1e-3, 0.03, 0.3])
@pytest.mark.parametrize(("floor", "size"), [(0.01, 3.0), (0.2, 1.0), (0.9, 0.3)])
def test_every_optimum_is_feasible_and_certified_by_its_dual(ratio, floor, size):
    noise, e, matrix = problems(1, size, 3, 3)
    s, _, bound = fit(noise, e, matrix, ratio, floor)
    y, c = parts(s, e)

    def gap(y: np.ndarray) -> np.ndarray:
        rest = np.linalg.norm(noise - np.matvec(matrix, y), axis=1)
        norm = np.vecdot(y, y) + c**2
        value = rest + ratio * np.sqrt(norm)
        return (value - dual_bound(noise, e, matrix, y, c, ratio, floor)) / value

    norms = np.sqrt(np.vecdot(y, y) + c**2)
    assert_allclose(
        np.linalg.norm(s, axis=(1, 2)),
        norms,
        rtol=1e-9,
        atol=1e-15,
    )

    least = np.linalg.eigvalsh(s)[:, 0] - (floor - 1)
    assert least.min() > -1e-10 and np.array_equal(least < 1e-9, bound)
    assert 30 < bound.sum() < 770
    for kind in (bound, ~bound):
        assert np.quantile(gap(y)[kind], 0.99) < 1e-8 and gap(y)[kind].max() < 1e-5
        # the control: the dual point of a place beside the optimum certifies nothing
        assert np.median(gap(y * (1 + 1e-3))[kind]) > 1e-6


@pytest.mark.parametrize(
    ("n", "m", "across"),
    [
        *[(n, n, 1.0) for n in (1, 2, 6)],
        *[
            (n, m, across)
            for n, m in ((3, 2), (7, 6), (8, 3))
            for across in (0, 1e-13, 1e-9, 1e-3, 1)
        ],
    ],
)
def test_every_minimum_of_any_size_is_reached_and_none_beside_it_is_lower(n, m, across):
    """However little of the noise lies across the range of A, where F all but has no gradient."""
    rng = default_rng(5)
    for ratio, floor, size in ((1e-3, 0.01, 3.0), (0.03, 0.2, 1.0), (0.3, 0.01, 3.0)):
        noise, e, matrix = problems(4, size, n, m, across)
        s, _, bound = fit(noise, e, matrix, ratio, floor)
        case = noise, e, matrix, ratio
        least = objective(*case, s)
        assert bound.any()
        assert np.linalg.eigvalsh(s).min() > floor - 1 - 1e-9
        for step in (1e-4, 1e-2):
            root = np.sqrt(step) * rng.standard_normal((len(s), m, m))
            inward = root @ np.swapaxes(root, 1, 2)
            inward += (floor - 1) * np.eye(m)
            beside = objective(*case, s + step * (inward - s))
            assert np.all(beside >= least * (1 - 1e-9))


def test_along_its_own_direction_the_perturbation_stops_at_the_bound():
    """With A = −I and ω along e the free optimum is x = −2 < ε − 1; the bounded one is x = ε − 1,
    no cross term and no block.
    """
    e = np.array([0.6, 0.8, 0.0])
    for aside, tolerance in ((0.0, 1e-12), (1e-7, 1e-6)):
        noise = 2 * e + aside * np.array([0.0, 0.0, 1.0])
        s = fit(noise[None], e[None], -np.eye(3)[None], 1e-3, 0.1).s[0]
        assert_allclose(s, -0.9 * np.outer(e, e), atol=tolerance)


def test_a_minimum_that_was_not_reached_and_an_all_but_singular_arm_are_refused(
    monkeypatch,
):
    """Rounding would decide the fit there; a hundred times as far from singular it is solved."""
    e = np.array([[0.6, 0.8]])
    noise = np.array([[1.0, 2.0]])
    matrices = {
        far: np.array([[[1.0, 1.0], [1.0, 1.0 + far]]]) for far in (1e-5, 1e-7, 1e-15)
    }

    assert fit(noise, e, matrices.pop(1e-5), 0.03, 0.2).objective[0] > 0
    for matrix in matrices.values():
        with pytest.raises(SolverError, match="not solved to optimality"):
            fit(noise, e, matrix, 0.03, 0.2)

    monkeypatch.setattr(perturbation, "STEPS", 2)
    with pytest.raises(SolverError, match="not solved to optimality") as refusal:
        fit(*problems(1, 1.0, 3, 3), 0.03, 0.2)
    assert len(refusal.value.evidence["noise"]) == 3
    assert refusal.value.evidence["ratio"] == pytest.approx(0.03)
