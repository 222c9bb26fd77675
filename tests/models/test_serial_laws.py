"""The compiled laws of arms of any size: moments of their draws against the closed forms, against
the planar laws, and what they do where there is no step.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import ks_2samp

from pipeline.arm.chain import PlanarChain
from pipeline.arm.serial import SerialChain
from pipeline.core.errors import ModelDomainError, SingularJacobianError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import Commands, open_loop
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.wishart.decomposition import Decomposition, split
from pipeline.models.wishart.law import WishartModel, step_covariance

DRAWS = 20_000
SIGMA_B = 0.2
ROWS = ("x", "y", "z", "rx", "ry", "rz")
SIZES = [(6, 6), (7, 6), (3, 2), (5, 1)]
READINGS = ("pivoted_lu", "qr", "qr_transposed", "given")


def arm(n: int, m: int, seed: int = 1) -> SerialChain:
    """A random chain of n joints, one of them prismatic where there are more than three."""
    rng = np.random.default_rng(seed + n)
    turns = Rotation.random(n + 1, random_state=n).as_matrix().reshape(-1, 9)
    placements = np.concatenate([turns, rng.uniform(-0.3, 0.3, (n + 1, 3))], axis=1)
    sliding = np.arange(n) == (0 if n > 3 else n)
    ends = np.full(n, -3.0), np.full(n, 3.0), np.full(n, 2.0)
    return SerialChain(ROWS[:m], 1.0, placements, sliding, *ends)


def command_of(chain: SerialChain) -> tuple[np.ndarray, np.ndarray]:
    """A pose, and a command: of the joints too where there are more of them than task rows."""
    m, n = len(chain.task), len(chain.lower)
    rng = np.random.default_rng(2)
    q, command = rng.uniform(-1, 1, n), 0.01 * rng.standard_normal(m if m == n else m + n)
    return q, command


def decomposition(name: str, m: int) -> Decomposition:
    left = np.eye(m) + 0.3 * np.random.default_rng(3).standard_normal((m, m))
    return Decomposition(name, left if name == "given" else None)


def standardised(
    drawn: np.ndarray, mean: np.ndarray, covariance: np.ndarray
) -> tuple[float, float]:
    """Distances of the draws' mean, in standard errors, and of their covariance, in products of
    standard deviations.
    """
    spread = np.sqrt(np.diag(covariance))
    apart = np.abs(drawn.mean(axis=0) - mean) / spread * np.sqrt(len(drawn))
    off = np.cov(drawn.T).reshape(covariance.shape) - covariance
    return apart.max(), np.abs(off / np.outer(spread, spread)).max()


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("n, m", SIZES)
def test_wishart_steps_have_the_moments_of_the_closed_form_whatever_the_size(n, m, reading):
    """Bands: five standard errors of a mean, and of a covariance under tails as these."""
    if m == 1 and reading == "pivoted_lu":
        pytest.skip("one row is one pivot: J₁ is a number, as with QR")
    chain, law = arm(n, m), decomposition(reading, m)
    q, command = command_of(chain)
    v = command[:m]
    drawn, _ = draw_steps(WishartModel(SIGMA_B, law), chain, np.tile(q, (DRAWS, 1)), command, RNG())
    a, back, _ = split(chain.jacobian(q), v, law)
    d = (m + 1) / SIGMA_B**2
    null = chain.null_step(q, command)
    mean = q + null + d / (d - m - 1) * np.linalg.pinv(chain.jacobian(q)) @ v
    apart, off = standardised(drawn, mean, step_covariance(a, back, SIGMA_B))
    assert apart < 5 and off < 0.08
    # the control: a dispersion that is a tenth wider
    _, off = standardised(drawn, mean, step_covariance(a, back, 1.1 * SIGMA_B))
    assert off > 0.1


def RNG() -> np.random.Generator:
    return np.random.default_rng(4)


def nothing(n: int) -> Measurements:
    return Measurements("take", np.zeros(0), *np.zeros((2, 0, n)), np.zeros((0, n, n)))


@pytest.mark.parametrize("n, m", SIZES)
def test_normal_models_steps_have_their_moments_whatever_the_size(n, m):
    chain = arm(n, m)
    q, command = command_of(chain)
    nominal = chain.nominal_step(q, command)
    factor = 1e-3 * np.random.default_rng(5).standard_normal((n, n))
    noise = factor @ factor.T + 1e-8 * np.eye(n)
    gain = 0.04 * np.eye(n)
    norm = np.linalg.norm(np.linalg.pinv(chain.jacobian(q)))
    variance = 0.1**2 * (4 * norm**2 - norm**2) / (n * m) * command[:m] @ command[:m]
    for model, covariance in (
        (ScaledModel(noise), noise),
        (ScaledModel(noise, gain), noise + gain * np.outer(nominal, nominal)),
        (GaussianModel(0.1, 2 * norm), variance * np.eye(n)),
    ):
        drawn, clipped = draw_steps(model, chain, np.tile(q, (DRAWS, 1)), command, RNG())
        apart, off = standardised(drawn, q + nominal, covariance)
        assert apart < 5 and off < 0.03 and clipped == 0
        assert standardised(drawn, q + nominal, 1.1 * covariance)[1] > 0.05
    _, clipped = draw_steps(GaussianModel(0.1, 0.9 * norm), chain, q[None], command, RNG())
    assert clipped == 1


def in_space(chain: PlanarChain) -> SerialChain:
    """The serial chain of a planar one: joint axes along the plane's y axis or against it."""
    axes = [np.array([[1.0, 0, 0], [0, 0, sign], [0, -sign, 0]]) for sign in chain.signs]
    frames = [np.eye(3), *axes, np.eye(3)]
    ways = np.zeros((4, 3))
    ways[:, [0, 2]] = np.vstack([chain.origin, chain.links])
    placements = [
        np.append((before.T @ after).ravel(), before.T @ way)
        for before, after, way in zip(frames[:-1], frames[1:], ways, strict=True)
    ]
    ends = chain.lower, chain.upper, chain.max_speed
    return SerialChain(("x", "z", "phi"), 1.0, np.array(placements), np.zeros(3, bool), *ends)


NORMAL = {
    "additive": ScaledModel(1e-6 * np.eye(3)),
    "scaled": ScaledModel(1e-6 * np.eye(3), 0.01 * np.eye(3)),
    "gaussian": GaussianModel(0.1, 40.0),
}


@pytest.mark.parametrize("model", NORMAL.values(), ids=NORMAL)
def test_normal_steps_of_a_planar_arm_are_the_same_numbers_by_either_way(model, chain, poses, step):
    # fewer than a block: the order of the numbers follows the blocks, of which the planar are wider
    one, clipped = draw_steps(model, chain, poses[:60], step, RNG())
    other, same = draw_steps(model, in_space(chain), poses[:60], step, RNG())
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    assert clipped == same


@pytest.mark.parametrize("reading", READINGS)
def test_wishart_steps_of_a_planar_arm_have_one_law_by_either_way(reading, chain, poses, step):
    """Kolmogorov–Smirnov tests of each joint at a level of 1e-5; control: a wider dispersion."""
    spatial, law, q = in_space(chain), decomposition(reading, 3), np.tile(poses[0], (DRAWS, 1))
    planar, _ = draw_steps(WishartModel(SIGMA_B, law), chain, q, step, RNG())
    for sigma_b, same in ((SIGMA_B, True), (1.2 * SIGMA_B, False)):
        model, rng = WishartModel(sigma_b, law), np.random.default_rng(6)
        drawn, _ = draw_steps(model, spatial, q, step, rng)
        assert (min(ks_2samp(planar[:, j], drawn[:, j]).pvalue for j in range(3)) > 1e-5) == same


def test_a_closed_loop_of_a_spatial_arm_corrects_the_displacement_of_its_tip():
    """Without noise: the arm is led back to its path, in rotation too."""
    chain = arm(7, 6)
    q, _ = command_of(chain)
    still = np.zeros((40, 13))
    target = np.tile(chain.pose(q), (40, 1))
    off = q + 0.05 * np.random.default_rng(7).standard_normal(7)
    before = np.linalg.norm(chain.displacement(chain.pose(off), chain.pose(q)))
    for share, left in ((0.3, 0.7**40), (0.0, 1.0)):
        quiet, start = ScaledModel(np.zeros((7, 7))), Start(off, np.zeros((7, 7)))
        run = Commands(still, target, share), 0.01, start, nothing(7), FilterOptions(3), RNG()
        posterior = particle_filter(quiet, chain, *run)
        after = chain.displacement(chain.pose(posterior.mean[-1]), chain.pose(q))
        assert np.linalg.norm(after) == pytest.approx(left * before, rel=0.1, abs=1e-9)


def test_a_singular_pose_has_no_step_and_a_particle_there_is_lost_and_counted():
    """A straight arm of two links that is to be stretched further."""
    placements = np.zeros((3, 12))
    placements[:, [0, 4, 8]] = 1.0
    placements[1:, 9] = 0.3
    ends = np.full(2, -3.0), np.full(2, 3.0), np.full(2, 2.0)
    chain = SerialChain(("x", "y"), 1.0, placements, np.zeros(2, bool), *ends)
    straight, bent = np.array([0.4, 0.0]), np.array([0.4, 0.8])
    model = WishartModel(SIGMA_B, Decomposition("qr_transposed"))
    with pytest.raises(SingularJacobianError):
        draw_steps(model, chain, np.tile(straight, (3, 1)), np.array([0.01, 0.0]), RNG())
    start = Start(bent, np.diag([0.0, 1e-6]))
    unfold = chain.jacobian(bent) @ np.array([0.0, -0.8])
    command = open_loop(np.array([unfold, [0.0, 0.001]]))
    exact = ScaledModel(np.diag([0.0, 1e-14]))
    run = command, 0.01, start, nothing(2), FilterOptions(2000), RNG()
    posterior = particle_filter(exact, chain, *run)
    # after the first step the second joint is within a thousandth of straight, give or take what
    # the start spreads
    assert 0 < posterior.outside[2] < 2000 and posterior.outside[1] == 0
    assert np.isfinite(posterior.mean).all()


@pytest.mark.parametrize("model", [ScaledModel(np.eye(3)), ScaledModel(np.eye(3), np.eye(3))])
def test_a_model_of_another_arm_is_refused(model):
    with pytest.raises(ModelDomainError, match="run the stage fit"):
        model.law(arm(7, 6))
