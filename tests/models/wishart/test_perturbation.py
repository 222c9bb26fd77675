"""The perturbation samples against the paper's convex problem as printed, for arms of any size,
each certified by a dual point; and the paper's estimator from them.
"""

from dataclasses import replace

import numpy as np
import pytest
from drawn_recording import drawn_recording
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from random_arm import motion, random_arm

from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models.convex import perturbation_gap, solve_perturbation
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

FLOOR = 0.2
WEIGHTS = (0.999, 0.001)
ROOT = np.sqrt(2)
# steps without a command and steps with one
REST = 10
MOVING = 30


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
    path, v = motion(arm, 120, 0)
    q = path[:-1]
    step = arm.nominal_step(q, v)
    size = share * np.sqrt(np.mean(step**2))
    noise = size * default_rng(n + m).standard_normal(step.shape)

    a, back, _ = factors(arm, q, v, decomposition)
    return arm.jacobian(q), v[:, :m], a, back, noise


SHAPES = [  # joints, task rows and decomposition
    (1, 1, "pivoted_lu"),
    (4, 4, "qr"),
    (6, 6, "qr_transposed"),
    (2, 1, "qr_transposed"),
    (5, 3, "pivoted_lu"),
    (8, 3, "qr"),
]


@pytest.mark.parametrize(("n", "m", "name"), SHAPES)
def test_the_perturbations_are_those_of_the_problem_as_printed(n, m, name):
    """Under the bound too: whatever m, one eigenvalue of ddᵀ/2x − I alone can be positive. Control:
    a wrong objective.
    """
    decomposition = Decomposition(name)
    jacobians, v, a, back, noise = arm_problems(n, m, decomposition, 1.5)
    fits = fit_perturbations(noise, a, back, WEIGHTS, FLOOR)

    assert np.linalg.eigvalsh(np.eye(m) + fits.s).min() > FLOOR - 1e-10
    for kind in (fits.bound, ~fits.bound):
        at = np.flatnonzero(kind)[:2]
        assert len(at) == 2
        objective, *problem = (x[at] for x in (fits.objective, jacobians, v, noise))
        right, wrong = ((f * objective, *problem) for f in (1, 1.01))
        assert perturbation_gap(right, decomposition, WEIGHTS, FLOOR) < 1e-5
        assert perturbation_gap(wrong, decomposition, WEIGHTS, FLOOR) > 0.009


@pytest.mark.parametrize(("n", "m"), [(4, 4), (8, 3)])
def test_the_perturbations_are_the_conic_solvers(n, m):
    """B⁻¹ to what a conic solver leaves of a flat optimum. Control: the next step's B⁻¹."""
    # only here J₁ = I
    qr = Decomposition("qr")
    identity = np.eye(m)
    jacobians, v, a, back, noise = arm_problems(n, m, qr, 1.5)
    s = fit_perturbations(noise, a, back, WEIGHTS, FLOOR).s
    sizes = np.linalg.norm(s, axis=(1, 2))

    moved = np.flatnonzero(sizes > 0.05)[:3]
    for i in moved:
        problem = noise[i], v[i], identity, jacobians[i]
        b_inverse, _ = solve_perturbation(*problem, WEIGHTS, FLOOR)
        band = 5e-3 * np.abs(b_inverse).max()
        assert_allclose(identity + s[i], b_inverse, atol=band)
    first, second, *_ = s[moved]
    assert np.abs(first - second).max() > 0.02


def test_many_of_those_problems_are_held_back_by_the_bound(chain, poses, step):
    """A smaller bound only lowers the objective."""
    noise, a, back = scene(chain, poses, step, 0.02)
    fit = fit_perturbations(noise, a, back, weights(1e-3), 0.1)
    looser = fit_perturbations(noise, a, back, weights(1e-3), 0.001)

    assert fit.bound.sum() > 20
    ratio = looser.objective / fit.objective
    assert np.all(ratio <= 1 + 1e-9)
    assert np.any(ratio[fit.bound] < 1 - 1e-3)
    assert_array_equal(looser.s[~fit.bound], fit.s[~fit.bound])


def test_equal_weights_return_the_identity_for_every_step(chain, poses, step):
    """The paper's weights are not given: with α₁ = α₂ = ½ every fit is B = I, and σ̂_B = 0."""
    problem = scene(chain, poses, step, 0.006)

    def share_perturbed(weights: tuple[float, float]) -> float:
        s = fit_perturbations(*problem, weights, 0.01).s
        return s.any(axis=(1, 2)).mean()

    assert share_perturbed((0.5, 0.5)) == 0
    assert share_perturbed(weights(0.3)) < 0.1
    assert share_perturbed(weights(3e-3)) > 0.9


def test_an_exact_fit_inverts_the_model(chain, poses, step):
    """(B⁻¹ − I)a = J₂ω, with ω measured minus nominal; with the printed sign of (OmgReal) the
    perturbation comes out reversed.
    """
    b_inverse = np.eye(3)
    b_inverse += 0.1 * np.array([[1.0, 0.5, 0], [0.5, -1.0, 0.3], [0, 0.3, 0.5]])
    a, back, _ = factors(chain, poses, step, PIVOTED_LU)
    end = poses + np.matvec(back, a @ b_inverse)
    noise = process_noise(chain, np.stack([poses, end], axis=1), step[None])[:, 0]

    def image(noise: np.ndarray) -> np.ndarray:
        s = fit_perturbations(noise, a, back, weights(1e-9), 0.01).s
        return np.matvec(s, a)

    assert_allclose(a + image(noise), a @ b_inverse, atol=1e-12)
    reversed_by = np.linalg.norm(image(-noise) - image(noise))
    assert reversed_by > np.linalg.norm(image(noise))


@pytest.mark.parametrize("m", [3, 6])
def test_weights_follow_from_the_noise_at_rest(m):
    """The noise at rest costs as much as a perturbation of the size of the identity."""
    alpha1, alpha2 = objective_weights(1e-3, m)
    assert alpha1 + alpha2 == pytest.approx(1, abs=1e-15)
    assert alpha1 * 1e-3 == pytest.approx(alpha2 * np.linalg.norm(np.eye(m)))
    with pytest.raises(ModelDomainError, match="noise at rest must be positive"):
        objective_weights(0.0, m)


@pytest.fixture
def data(chain, poses, step) -> Recorded:
    """The Wishart model's own steps behind a rest, measured with noise of 1e-4 rad."""
    v = np.vstack([np.zeros((REST, 3)), np.tile(step, (MOVING, 1))])
    measured = 1e-8 * np.eye(3)
    model = WishartModel(0.2)
    drawn = drawn_recording(chain, poses[: len(v)], v, measured, model, 100)
    return replace(drawn, known_measurement=None)


def test_at_rest_nothing_is_perturbed_and_the_mean_over_time_counts_those_steps(data):
    squares = np.sum(data.noise[:, :REST] ** 2, axis=-1)
    resting = np.sqrt(np.mean(squares))
    steps = problem_steps(data, PIVOTED_LU)

    b, fits = solve_problems(steps, objective_weights(resting, 3), FLOOR)
    result = fit_paper(data, PIVOTED_LU, FLOOR)

    distances = np.sum((b - np.eye(3)) ** 2, axis=(-2, -1)) / 3
    dispersions = np.sqrt(distances.mean(axis=0))
    assert not fits.s.reshape(100, -1, 3, 3)[:, :REST].any()
    assert not dispersions[:REST].any()
    assert np.all(dispersions[REST:] > 0)
    assert_allclose(result.estimates["sigma_b"], dispersions.mean())


def test_noise_that_is_not_finite_is_refused(data):
    data.noise[2, REST, 1] = np.nan
    words = "must be finite at every step"
    with pytest.raises(ModelDomainError, match=words) as refusal:
        fit_paper(data, PIVOTED_LU, FLOOR)
    assert refusal.value.evidence["index"] == 2 * (REST + MOVING) + REST


@pytest.mark.parametrize("command", [0.0, 1e-4], ids=["silent", "no step at rest"])
def test_a_motion_without_noise_at_rest_is_refused(data, command):
    data.noise[:, :REST] = 0.0
    data.v[:REST] = command
    with pytest.raises(ModelDomainError, match="noise at rest"):
        fit_paper(data, PIVOTED_LU, FLOOR)


def fit(noise, e, matrix, ratio: float, floor: float) -> Perturbations:
    """Fit ω (N, n), e (N, m), A (N, n, m), λ and ε; objective (‖ω − Ay‖ + λ‖S‖)/(1 + λ)."""
    along = np.matvec(matrix, e)[:, :, None] * e[:, None, :]
    back = ROOT * matrix + (1 - ROOT) * along
    return fit_perturbations(noise, e, back, weights(ratio), floor)


def parts(s: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """y (N, m) and c (N,) of S (N, m, m)."""
    image = np.matvec(s, e)
    along = np.vecdot(e, image)
    y = ROOT * image + (1 - ROOT) * along[:, None] * e
    return y, np.trace(s, axis1=1, axis2=2) - along


def misfit(noise, matrix, y) -> np.ndarray:
    """‖ω − Ay‖ (N,)."""
    return np.linalg.norm(noise - np.matvec(matrix, y), axis=1)


def objective(noise, e, matrix, ratio: float, s: np.ndarray) -> np.ndarray:
    y, _ = parts(s, e)
    return misfit(noise, matrix, y) + ratio * np.linalg.norm(s, axis=(1, 2))


def problems(
    seed: int,
    size: float,
    n: int,
    m: int,
    across: float = 1.0,
) -> tuple[np.ndarray, ...]:
    """ω, e and A of 800 random problems; of what ω has across the range of A a share ``across``."""
    rng = default_rng(seed)
    noise = rng.standard_normal((800, n))
    e = rng.standard_normal((800, m))
    matrix = rng.standard_normal((800, n, m))
    if n > m:
        axes, _ = np.linalg.qr(matrix)
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
    scale = ratio / np.where(size > 0, size, 1.0)
    u = scale[:, None] * y
    w = scale * c

    # p = r/‖r‖, and where the fit is exact what makes m normal to the cone
    residual = noise - np.matvec(matrix, y)
    length = np.linalg.norm(residual, axis=1)
    is_exact = length < 1e-9 * np.linalg.norm(noise, axis=1)
    normal = (w / (delta + x))[:, None] * ((delta + c + x)[:, None] * e - y)
    transposed = np.swapaxes(matrix, 1, 2)
    of_exact = np.linalg.solve(transposed, (u - normal)[..., None])[..., 0]
    of_others = residual / np.where(is_exact, 1.0, length)[:, None]
    p = np.where(is_exact[:, None], of_exact, of_others)
    p /= np.maximum(1.0, np.linalg.norm(p, axis=1))[:, None]

    image = np.vecmat(p, matrix)
    value = np.vecdot(p, noise)
    free = value * np.minimum(1.0, ratio / np.linalg.norm(image, axis=1))

    m = u - image
    along = np.vecdot(e, m)
    with np.errstate(divide="ignore", invalid="ignore"):
        across = m - along[:, None] * e
        lifted = np.maximum(np.vecdot(across, across) / (2 * w), along)
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
    least = np.linalg.eigvalsh(s)[:, 0] - (floor - 1)

    def gap(y: np.ndarray) -> np.ndarray:
        size = np.sqrt(np.vecdot(y, y) + c**2)
        value = misfit(noise, matrix, y) + ratio * size
        return 1 - dual_bound(noise, e, matrix, y, c, ratio, floor) / value

    norms = np.sqrt(np.vecdot(y, y) + c**2)
    of_s = np.linalg.norm(s, axis=(1, 2))
    assert_allclose(of_s, norms, rtol=1e-9, atol=1e-15)
    assert least.min() > -1e-10
    assert_array_equal(least < 1e-9, bound)
    assert 30 < bound.sum() < 770
    for kind in (bound, ~bound):
        gaps = gap(y)[kind]
        assert np.quantile(gaps, 0.99) < 1e-8 and gaps.max() < 1e-5
        # the control: the dual point of a place beside the optimum certifies nothing
        assert np.median(gap(y * (1 + 1e-3))[kind]) > 1e-6


SQUARE = [(1, 1, 1.0), (2, 2, 1.0), (6, 6, 1.0)]  # n, m, share of the noise across
TALL = [(3, 2), (7, 6), (8, 3)]
ACROSS = [(n, m, share) for n, m in TALL for share in (0, 1e-13, 1e-9, 1e-3, 1)]


@pytest.mark.parametrize(
    ("ratio", "floor", "size"),
    [(1e-3, 0.01, 3.0), (0.03, 0.2, 1.0), (0.3, 0.01, 3.0)],
)
@pytest.mark.parametrize(("n", "m", "across"), [*SQUARE, *ACROSS])
def test_every_minimum_of_any_size_is_reached_and_none_beside_it_is_lower(
    n,
    m,
    across,
    ratio,
    floor,
    size,
):
    """However little of the noise lies across the range of A, where F all but has no gradient."""
    rng = default_rng(5)
    problem = problems(4, size, n, m, across)
    s, _, bound = fit(*problem, ratio, floor)
    least = objective(*problem, ratio, s)

    assert bound.any()
    assert np.linalg.eigvalsh(s).min() > floor - 1 - 1e-9
    for step in (1e-4, 1e-2):
        root = np.sqrt(step) * rng.standard_normal((len(s), m, m))
        feasible = root @ np.swapaxes(root, 1, 2) + (floor - 1) * np.eye(m)
        beside = s + step * (feasible - s)
        assert np.all(objective(*problem, ratio, beside) >= least * (1 - 1e-9))


@pytest.mark.parametrize(("aside", "tolerance"), [(0.0, 1e-12), (1e-7, 1e-6)])
def test_along_its_own_direction_the_perturbation_stops_at_the_bound(aside, tolerance):
    """With A = −I and ω along e the free optimum is x = −2 < ε − 1; the bounded one is x = ε − 1,
    no cross term and no block.
    """
    e = np.array([[0.6, 0.8, 0.0]])
    noise = 2 * e + [0.0, 0.0, aside]
    (s,) = fit(noise, e, -np.eye(3)[None], 1e-3, 0.1).s
    assert_allclose(s, -0.9 * e.T @ e, atol=tolerance)


def near_singular(far: float) -> tuple[np.ndarray, ...]:
    """ω, e and A of a problem whose A is ``far`` from a singular one."""
    matrix = np.array([[[1.0, 1.0], [1.0, 1.0 + far]]])
    return np.array([[1.0, 2.0]]), np.array([[0.6, 0.8]]), matrix


@pytest.mark.parametrize("far", [1e-7, 1e-15])
def test_an_all_but_singular_arm_is_refused(far):
    """Rounding would decide the fit there; a hundred times as far from singular it is solved."""
    with pytest.raises(SolverError, match="not solved to optimality"):
        fit(*near_singular(far), 0.03, 0.2)
    assert fit(*near_singular(1e-5), 0.03, 0.2).objective[0] > 0


def test_a_minimum_that_was_not_reached_is_refused(monkeypatch):
    monkeypatch.setattr(perturbation, "STEPS", 2)
    with pytest.raises(SolverError, match="not solved to optimality") as refusal:
        fit(*problems(1, 1.0, 3, 3), 0.03, 0.2)
    assert len(refusal.value.evidence["noise"]) == 3
    assert refusal.value.evidence["ratio"] == pytest.approx(0.03)
