"""The perturbation samples of a whole training set, against CVXPY's parametrised problem."""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np
import pytest
from omegaconf import OmegaConf
from scenario import ROOT, youbot

from pipeline.core.config import compose_config
from pipeline.laboratory.dynamics import session_offset, simulate_take
from pipeline.laboratory.swing import desired_trajectory
from pipeline.models.noise import process_noise
from pipeline.models.wishart.decomposition import LU
from pipeline.models.wishart.dispersion import rest_noise
from pipeline.models.wishart.factors import factors
from pipeline.models.wishart.perturbation import fit_perturbations, objective_weights

pytestmark = pytest.mark.benchmark(group="Perturbation fits, 32 000 convex problems")
FLOOR = 0.2
MARKERS = 8e-4  # rad, what the noise of the markers leaves in a measured angle


@dataclass(frozen=True)
class Problems:
    """ω, a, J₂⁻¹ of takes × steps problems, and the weights."""

    noise: np.ndarray
    a: np.ndarray
    back: np.ndarray
    weights: tuple[float, float]

    def of(self, chosen: np.ndarray) -> Problems:
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
            np.flatnonzero(of)[:: max(of.sum() // number, 1)][:number]
            for of, number in ((bound, binding), (~bound, count - binding))
        ]
        return np.concatenate(spread)


@pytest.fixture
def problems(size) -> Problems:
    """From takes of the synthetic laboratory's arm."""
    chain, rng = youbot(), np.random.default_rng(2017)
    laboratory = OmegaConf.to_object(compose_config(ROOT / "params.yaml").dataset.laboratory)
    trajectory, dynamics = laboratory["trajectory"], laboratory["dynamics"]
    grid = np.arange(round(trajectory.duration * trajectory.rate) + 1) / trajectory.rate
    offset, q = session_offset(dynamics, rng), []
    for _ in range(size(100, 3)):
        t, joints = simulate_take(chain, offset, trajectory, dynamics, rng)
        q.append(np.stack([np.interp(grid, t, joints[:, j]) for j in range(3)], axis=-1))
    measured = np.array(q) + MARKERS * rng.standard_normal((len(q), len(grid), 3))
    v = (
        desired_trajectory(chain, trajectory)[["vx", "vz", "vphi"]].to_numpy()[:-1]
        / trajectory.rate
    )
    noise, before = process_noise(chain, measured, v), measured[:, :-1]
    a, back, _ = factors(chain, before, np.broadcast_to(v, before.shape), LU)
    return Problems(
        noise.reshape(-1, 3),
        a.reshape(-1, 3),
        back.reshape(-1, 3, 3),
        objective_weights(rest_noise(noise, v), 3),
    )


class Parametrised:
    """(BsampOpt) as printed, with the data as parameters: compiled once, then solved for each
    problem.
    """

    def __init__(self, weights: tuple[float, float]) -> None:
        self.noise, self.map, self.s = (
            cp.Parameter(3),
            cp.Parameter((3, 9)),
            cp.Variable((3, 3), symmetric=True),
        )
        # a product of two parameters would not be parametrised: J₂⁻¹Sa = (aᵀ ⊗ J₂⁻¹) vec S
        residual = cp.norm(self.noise - self.map @ cp.vec(self.s, order="F"))
        objective = cp.Minimize(weights[0] * residual + weights[1] * cp.norm(self.s, "fro"))
        self.problem = cp.Problem(objective, [self.s + np.eye(3) >> FLOOR * np.eye(3)])

    def __call__(self, of: Problems) -> list[float]:
        values = []
        for noise, a, back in zip(of.noise, of.a, of.back, strict=True):
            self.noise.value, self.map.value = noise, np.kron(a, back)
            values.append(self.problem.solve(solver=cp.CLARABEL))
        return values


@pytest.fixture
def few(size) -> int:
    """How many of the problems CVXPY solves."""
    return size(60, 4)


def test_ours(benchmark, problems, few):
    benchmark.extra_info |= {"role": "ours", "items": len(problems.noise)}
    fits = benchmark.pedantic(problems.fits, rounds=9, warmup_rounds=1)
    benchmark.extra_info |= {
        "bound": int(fits.bound.sum()),
        "objective": float(fits.objective[problems.some(few)].mean()),
    }
    assert fits.bound.any()


def test_cvxpy(benchmark, problems, few):
    benchmark.extra_info |= {"role": "peer", "items": few, "target": 1000}
    chosen = problems.of(problems.some(few))
    values = benchmark.pedantic(
        Parametrised(problems.weights), (chosen,), rounds=5, warmup_rounds=1
    )
    benchmark.extra_info["objective"] = float(np.mean(values))
    np.testing.assert_allclose(values, chosen.fits().objective, rtol=1e-5, atol=1e-9)
