"""The perturbation samples of a whole training set, against CVXPY's parametrised problem."""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np
import pytest
from cone_problem import ConeProblem
from omegaconf import OmegaConf
from scenario import ROOT, scene, swing, youbot

from pipeline.core.columns import values
from pipeline.core.config import compose_config
from pipeline.laboratory.dynamics import session_offset, simulate_take
from pipeline.laboratory.swing import desired_trajectory
from pipeline.models.draws import draw_steps
from pipeline.models.noise import process_noise
from pipeline.models.wishart.decomposition import PIVOTED_LU, Decomposition
from pipeline.models.wishart.dispersion import rest_noise
from pipeline.models.wishart.factors import factors
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.perturbation import fit_perturbations, objective_weights

GROUPS = {
    3: "Perturbation fits, 32 000 convex problems",
    6: "Perturbation fits 6 × 6, 32 000 convex problems",
}
TARGETS = {3: 1000, 6: 500}
FLOOR = 0.2
MARKERS = 8e-4  # rad, what the noise of the markers leaves in a measured angle
SIGMA_B = 0.5  # of the arm in space: so that definiteness binds some of the problems


@dataclass(frozen=True)
class Problems:
    """ω, a, J₂⁻¹ of takes × steps problems of m × m, and the weights."""

    noise: np.ndarray
    a: np.ndarray
    back: np.ndarray
    weights: tuple[float, float]

    def these(self, chosen: np.ndarray) -> Problems:
        return Problems(self.noise[chosen], self.a[chosen], self.back[chosen], self.weights)

    def fits(self):
        return fit_perturbations(self.noise, self.a, self.back, self.weights, FLOOR)

    def some(self, count: int) -> np.ndarray:
        """``count`` of the problems, evenly spread, and of those that definiteness binds the same
        share as among all.
        """
        bound = self.fits().bound
        binding = round(count * bound.mean() + 0.5)
        spread = [
            np.flatnonzero(these)[:: max(these.sum() // number, 1)][:number]
            for these, number in ((bound, binding), (~bound, count - binding))
        ]
        return np.concatenate(spread)


@pytest.fixture(params=GROUPS)
def problems(benchmark, request, size) -> Problems:
    """Of as many rows as the parameter says."""
    benchmark.group = GROUPS[request.param]
    return (planar if request.param == 3 else spatial)(size(100, 3))


def planar(takes: int) -> Problems:
    """From takes of the synthetic laboratory's arm."""
    chain, rng = youbot(), np.random.default_rng(2017)
    laboratory = OmegaConf.to_object(compose_config(ROOT / "params.yaml").dataset.laboratory)
    trajectory, dynamics = laboratory["trajectory"], laboratory["dynamics"]
    grid = np.arange(round(trajectory.duration * trajectory.rate) + 1) / trajectory.rate
    offset, q = session_offset(dynamics, 3, rng), []
    for _ in range(takes):
        t, joints, _ = simulate_take(chain, offset, trajectory, dynamics, rng)
        q.append(np.stack([np.interp(grid, t, joints[:, j]) for j in range(3)], axis=-1))
    measured = np.array(q) + MARKERS * rng.standard_normal((len(q), len(grid), 3))
    v = values(desired_trajectory(chain, trajectory), "v")[:-1] / trajectory.rate
    noise, before = process_noise(chain, measured, v), measured[:, :-1]
    a, back, _ = factors(chain, before, np.broadcast_to(v, before.shape), PIVOTED_LU)
    return flat(noise, a, back, rest_noise(noise, v))


def spatial(takes: int) -> Problems:
    """From steps that the model draws of the UR5."""
    chain, rng = scene("ur5").chain, np.random.default_rng(2017)
    path, qr = swing(320, scene("ur5").start.mean), Decomposition("qr_transposed")
    v = np.matvec(chain.jacobian(path[:-1]), np.diff(path, axis=0))
    before = np.tile(path[:-1], (takes, 1, 1))
    after, _ = draw_steps(WishartModel(SIGMA_B, qr), chain, before, v, rng)
    start, end = (q + MARKERS * rng.standard_normal(q.shape) for q in (before, after))
    a, back, _ = factors(chain, start, np.broadcast_to(v, start.shape), qr)
    # at rest two measurements differ by their noise alone
    return flat(end - start - chain.nominal_step(start, v), a, back, np.sqrt(2 * 6) * MARKERS)


def flat(noise: np.ndarray, a: np.ndarray, back: np.ndarray, rest: float) -> Problems:
    """Of takes and steps one after the other, weighed by the noise at ``rest`` in rad."""
    m = a.shape[-1]
    rows = noise.reshape(-1, m), a.reshape(-1, m), back.reshape(-1, m, m)
    return Problems(*rows, objective_weights(rest, m))


class Parametrised:
    """(BsampOpt) as printed, with the data as parameters: compiled once, then solved for each
    problem.
    """

    def __init__(self, weights: tuple[float, float], m: int) -> None:
        self.noise, self.map = cp.Parameter(m), cp.Parameter((m, m * m))
        self.s = cp.Variable((m, m), symmetric=True)
        # a product of two parameters would not be parametrised: J₂⁻¹Sa = (aᵀ ⊗ J₂⁻¹) vec S
        residual = cp.norm(self.noise - self.map @ cp.vec(self.s, order="F"))
        objective = cp.Minimize(weights[0] * residual + weights[1] * cp.norm(self.s, "fro"))
        self.problem = cp.Problem(objective, [self.s + np.eye(m) >> FLOOR * np.eye(m)])

    def __call__(self, these: Problems) -> list[float]:
        values = []
        for noise, a, back in zip(these.noise, these.a, these.back, strict=True):
            self.noise.value, self.map.value = noise, np.kron(a, back)
            values.append(self.problem.solve(solver=cp.CLARABEL))
        return values


@pytest.fixture
def few(size) -> int:
    """How many of the problems CVXPY solves."""
    return size(60, 4)


def test_ours(benchmark, problems, few):
    benchmark.extra_info |= {"role": "ours", "items": len(problems.noise)}
    fits = benchmark(problems.fits)
    benchmark.extra_info |= {
        "bound": int(fits.bound.sum()),
        "objective": float(fits.objective[problems.some(few)].mean()),
    }
    assert fits.bound.any()


def test_cvxpy(benchmark, problems, few):
    benchmark.extra_info |= {
        "role": "peer",
        "against": "CVXPY",
        "configuration": "one parametrised problem that is compiled once, then solved by Clarabel "
        "for each problem's values of the parameters; what the model takes on the way counts",
        "items": few,
        "target": TARGETS[problems.a.shape[1]],
    }
    chosen = problems.these(problems.some(few))
    values = benchmark(Parametrised(problems.weights, problems.a.shape[1]), chosen)
    benchmark.extra_info["objective"] = float(np.mean(values))
    np.testing.assert_allclose(values, chosen.fits().objective, rtol=1e-5, atol=1e-9)


def test_clarabel(benchmark, problems, few):
    # no target: without CVXPY, by a user who knows the cones
    benchmark.extra_info |= {"role": "peer", "against": "Clarabel alone", "items": few}
    benchmark.extra_info["configuration"] = (
        "each problem handed over as its cones, the matrix built by NumPy; its own tolerances"
    )
    chosen = problems.these(problems.some(few))
    solved = ConeProblem(problems.weights, problems.a.shape[1], FLOOR)
    values = benchmark(lambda: [*map(solved, chosen.noise, chosen.a, chosen.back)])
    benchmark.extra_info["objective"] = float(np.mean(values))
    np.testing.assert_allclose(values, chosen.fits().objective, rtol=1e-5, atol=1e-9)
