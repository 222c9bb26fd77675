"""The kernel density of many samples on a grid, against KDEpy's, and the perturbation samples of a
whole training set, against CVXPY's parametrised problem.
"""

from __future__ import annotations

from typing import NamedTuple

import cvxpy as cp
import numpy as np
import pytest
from scenario import SIGMA_B, scene, swing

from pipeline.models.draws import draw_steps
from pipeline.models.wishart.decomposition import factors
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.perturbation import fit_perturbations, objective_weights
from pipeline.statistics.densities import kernel_density, normal_reference_bandwidth

DENSITIES = "Densities, a million samples on 256 × 256 points"
SHOWN = 16  # every so many-th grid point is compared with the exact sum
FITS = {
    "youbot": "Perturbation fits 3 × 3, 32 000 convex problems",
    "ur5": "Perturbation fits 6 × 6, 32 000 convex problems",
}
FLOOR = 0.2
MARKERS = 8e-4  # rad, noise of a measured angle


class Density(NamedTuple):
    """Correlated normal samples and a grid over all of them, as KDEpy needs it."""

    samples: np.ndarray
    x: np.ndarray
    y: np.ndarray
    bandwidth: np.ndarray

    def error(self, shown: np.ndarray) -> float:
        """Greatest distance of the density at the ``shown`` points from the exact sum, relative to
        its greatest value.
        """
        scaled = [
            (grid[::SHOWN, None] - samples) / bandwidth
            for grid, samples, bandwidth in zip(
                self[1:3], self.samples.T, self.bandwidth, strict=True
            )
        ]
        kernels = [np.exp(-0.5 * each**2) for each in scaled]
        exact = kernels[0] @ kernels[1].T
        exact /= 2 * np.pi * np.prod(self.bandwidth) * len(self.samples)
        return float(np.abs(shown - exact).max() / exact.max())


@pytest.fixture
def density(size) -> Density:
    covariance, count = [[5.0, -2.0], [-2.0, 2.0]], size(1_000_000, 1000)
    samples = np.random.default_rng(28).multivariate_normal([3.0, 5.0], covariance, count)
    bandwidth = normal_reference_bandwidth(samples)
    low, high = samples.min(axis=0) - 3 * bandwidth, samples.max(axis=0) + 3 * bandwidth
    return Density(samples, *np.linspace(low, high, size(256, 64)).T, bandwidth)


@pytest.mark.benchmark(group=DENSITIES)
def test_our_density(benchmark, density):
    values = benchmark(kernel_density, *density)
    error = density.error(values[::SHOWN, ::SHOWN])
    benchmark.extra_info |= {"role": "ours", "items": len(density.samples), "error": error}
    assert error < 1e-4


@pytest.mark.benchmark(group=DENSITIES)
def test_kdepy(benchmark, peer, density, tmp_path):
    np.save(tmp_path / "samples.npy", density.samples)
    grid = density._asdict() | {"samples": str(tmp_path / "samples.npy"), "shown": SHOWN}
    error = density.error(np.array(benchmark(peer("densities", **grid))))
    stated = {"role": "peer", "against": "KDEpy", "target": 5, "error": error}
    benchmark.extra_info |= stated | {"items": len(density.samples)}
    assert error < 1e-2


class Problems(NamedTuple):
    """ω, a, J₂⁺ of takes × steps problems of m × m, and the weights."""

    noise: np.ndarray
    a: np.ndarray
    back: np.ndarray
    weights: tuple[float, float]

    def fits(self):
        return fit_perturbations(*self, FLOOR)

    def sample(self, count: int) -> np.ndarray:
        """Indices of ``count`` of the problems, evenly spread, with the same share of those that
        definiteness binds.
        """
        bound = self.fits().bound
        binding = round(count * bound.mean() + 0.5)
        parts = ((bound, binding), (~bound, count - binding))
        strides = [(these, number, max(these.sum() // number, 1)) for these, number in parts]
        return np.concatenate([np.flatnonzero(of)[::step][:n] for of, n, step in strides])


@pytest.fixture(params=FITS)
def problems(benchmark, request, size) -> Problems:
    """Problems of steps that the model draws of an arm, measured with noise."""
    benchmark.group, takes = FITS[request.param], size(100, 3)
    stage, rng = scene(request.param), np.random.default_rng(2017)
    chain, decomposition = stage.chain, stage.model.decomposition
    path = swing(320, stage.start.mean)
    v = np.matvec(chain.jacobian(path[:-1]), np.diff(path, axis=0))
    before, commands = np.tile(path[:-1], (takes, 1, 1)), np.tile(v, (takes, 1, 1))
    # σ_B so large that definiteness binds some of the problems
    model = WishartModel(2 * SIGMA_B, decomposition)
    after, _ = draw_steps(model, chain, before, v, rng)
    start, end = (q + MARKERS * rng.standard_normal(q.shape) for q in (before, after))
    a, back, _ = factors(chain, start, commands, decomposition)
    noise, m = end - start - chain.nominal_step(start, commands), a.shape[-1]
    # at rest two measurements differ by their noise alone
    weights = objective_weights(np.sqrt(2 * m) * MARKERS, m)
    return Problems(noise.reshape(-1, m), a.reshape(-1, m), back.reshape(-1, m, m), weights)


class Parametrised:
    """(BsampOpt) as printed, with the data as parameters: compiled once."""

    def __init__(self, weights: tuple[float, float], m: int) -> None:
        self.noise, self.map = cp.Parameter(m), cp.Parameter((m, m * m))
        s = cp.Variable((m, m), symmetric=True)
        # a product of two parameters would not be parametrised: J₂⁻¹Sa = (aᵀ ⊗ J₂⁻¹) vec S
        residual = cp.norm(self.noise - self.map @ cp.vec(s, order="F"))
        objective = cp.Minimize(weights[0] * residual + weights[1] * cp.norm(s, "fro"))
        self.problem = cp.Problem(objective, [s + np.eye(m) >> FLOOR * np.eye(m)])

    def __call__(self, chosen: Problems) -> list[float]:
        values = []
        for noise, a, back in zip(*chosen[:3], strict=True):
            self.noise.value, self.map.value = noise, np.kron(a, back)
            values.append(self.problem.solve(solver=cp.CLARABEL))
        return values


def test_our_fits(benchmark, problems, size):
    fits = benchmark(problems.fits)
    objective = float(fits.objective[problems.sample(size(60, 4))].mean())
    benchmark.extra_info |= {"role": "ours", "items": len(problems.noise), "objective": objective}
    assert fits.bound.any()


def test_cvxpy(benchmark, problems, size):
    few = size(60, 4)
    chosen = problems.sample(few)
    part = Problems(*(values[chosen] for values in problems[:3]), problems.weights)
    values = benchmark(Parametrised(problems.weights, problems.a.shape[1]), part)
    benchmark.extra_info |= {"role": "peer", "against": "CVXPY", "items": few, "target": 500}
    benchmark.extra_info |= {"objective": float(np.mean(values)), "configuration": (
        "one parametrised problem, compiled once, then solved by Clarabel for each problem's "
        "values of the parameters; the time of the model between counts")}  # fmt: skip
    np.testing.assert_allclose(values, part.fits().objective, rtol=1e-5, atol=1e-9)
