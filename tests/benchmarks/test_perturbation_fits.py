"""The perturbation samples of a whole training set, against CVXPY's parametrised problem."""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np
import pytest
from scenario import scene, swing

from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import factors
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.perturbation import fit_perturbations, objective_weights

GROUPS = {
    "youbot": "Perturbation fits 3 × 3, 32 000 convex problems",
    "ur5": "Perturbation fits 6 × 6, 32 000 convex problems",
}
TARGET = 500
FLOOR = 0.2
MARKERS = 8e-4  # rad, noise of a measured angle
SIGMA_B = 0.5  # so large that definiteness binds some of the problems


@dataclass(frozen=True)
class Problems:
    """ω, a, J₂⁺ of takes × steps problems of m × m, and the weights."""

    noise: np.ndarray
    a: np.ndarray
    back: np.ndarray
    weights: tuple[float, float]

    def subset(self, chosen: np.ndarray) -> Problems:
        return Problems(self.noise[chosen], self.a[chosen], self.back[chosen], self.weights)

    def fits(self):
        return fit_perturbations(self.noise, self.a, self.back, self.weights, FLOOR)

    def some(self, count: int) -> np.ndarray:
        """``count`` of the problems, evenly spread, with the same share of those that definiteness
        binds.
        """
        bound = self.fits().bound
        binding = round(count * bound.mean() + 0.5)
        parts = ((bound, binding), (~bound, count - binding))
        strides = [(these, number, max(these.sum() // number, 1)) for these, number in parts]
        return np.concatenate([np.flatnonzero(of)[::step][:n] for of, n, step in strides])


@pytest.fixture(params=GROUPS)
def problems(benchmark, request, size) -> Problems:
    """From steps that the model draws of an arm, measured with noise."""
    benchmark.group, takes = GROUPS[request.param], size(100, 3)
    stage, rng = scene(request.param), np.random.default_rng(2017)
    chain, decomposition = stage.chain, stage.model.decomposition
    path = swing(320, stage.start.mean)
    v = np.matvec(chain.jacobian(path[:-1]), np.diff(path, axis=0))
    before = np.tile(path[:-1], (takes, 1, 1))
    after, _ = draw_steps(WishartModel(SIGMA_B, decomposition), chain, before, v, rng)
    start, end = (q + MARKERS * rng.standard_normal(q.shape) for q in (before, after))
    a, back, _ = factors(chain, start, np.broadcast_to(v, (*start.shape[:2], v.shape[1])),
                         decomposition)  # fmt: skip
    noise, m = end - start - chain.nominal_step(start, v), a.shape[-1]
    # at rest two measurements differ by their noise alone
    weights = objective_weights(np.sqrt(2 * m) * MARKERS, m)
    return Problems(noise.reshape(-1, m), a.reshape(-1, m), back.reshape(-1, m, m), weights)


class Parametrised:
    """(BsampOpt) as printed, with the data as parameters: compiled once."""

    def __init__(self, weights: tuple[float, float], m: int) -> None:
        self.noise, self.map = cp.Parameter(m), cp.Parameter((m, m * m))
        self.s = cp.Variable((m, m), symmetric=True)
        # a product of two parameters would not be parametrised: J₂⁻¹Sa = (aᵀ ⊗ J₂⁻¹) vec S
        residual = cp.norm(self.noise - self.map @ cp.vec(self.s, order="F"))
        objective = cp.Minimize(weights[0] * residual + weights[1] * cp.norm(self.s, "fro"))
        self.problem = cp.Problem(objective, [self.s + np.eye(m) >> FLOOR * np.eye(m)])

    def __call__(self, chosen: Problems) -> list[float]:
        values = []
        for noise, a, back in zip(chosen.noise, chosen.a, chosen.back, strict=True):
            self.noise.value, self.map.value = noise, np.kron(a, back)
            values.append(self.problem.solve(solver=cp.CLARABEL))
        return values


def test_ours(benchmark, problems, size):
    benchmark.extra_info |= {"role": "ours", "items": len(problems.noise)}
    fits = benchmark(problems.fits)
    benchmark.extra_info["objective"] = float(fits.objective[problems.some(size(60, 4))].mean())
    assert fits.bound.any()


def test_cvxpy(benchmark, problems, size):
    few = size(60, 4)
    benchmark.extra_info |= {"role": "peer", "against": "CVXPY", "items": few, "target": TARGET}
    benchmark.extra_info["configuration"] = (
        "one parametrised problem, compiled once, then solved by Clarabel for each problem's "
        "values of the parameters; the time of the model between counts"
    )
    chosen = problems.subset(problems.some(few))
    values = benchmark(Parametrised(problems.weights, problems.a.shape[1]), chosen)
    benchmark.extra_info["objective"] = float(np.mean(values))
    np.testing.assert_allclose(values, chosen.fits().objective, rtol=1e-5, atol=1e-9)
