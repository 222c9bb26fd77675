"""The kernel density of many samples on a grid, against KDEpy's, and the perturbation samples of a
whole training set, against CVXPY's parametrised problem.
"""

from collections.abc import Callable
from typing import NamedTuple

import cvxpy as cp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scenario import SIGMA_B, scene, swing
from scipy.stats import norm

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


@pytest.fixture
def density(size) -> tuple[np.ndarray, ...]:
    """Correlated normal samples (N, 2), a grid over all of them, x and y, and the bandwidth."""
    mean = [3.0, 5.0]
    covariance = [[5.0, -2.0], [-2.0, 2.0]]
    rng = np.random.default_rng(28)
    samples = rng.multivariate_normal(mean, covariance, size(1_000_000, 1000))
    bandwidth = normal_reference_bandwidth(samples)
    margin = 3 * bandwidth
    ends = samples.min(axis=0) - margin, samples.max(axis=0) + margin
    x, y = np.linspace(*ends, size(256, 64)).T
    return samples, x, y, bandwidth


def error_of(values: np.ndarray, samples, x, y, bandwidth) -> float:
    """Greatest distance of the density at every SHOWN-th point from the exact sum, relative to its
    greatest value.
    """
    along_x = norm.pdf(x[::SHOWN, None], samples[:, 0], bandwidth[0])
    along_y = norm.pdf(y[::SHOWN, None], samples[:, 1], bandwidth[1])
    exact = along_x @ along_y.T / len(samples)
    return float(np.abs(values - exact).max() / exact.max())


@pytest.mark.benchmark(group=DENSITIES)
def test_our_density(benchmark, density):
    values = benchmark(kernel_density, *density)
    error = error_of(values[::SHOWN, ::SHOWN], *density)
    benchmark.extra_info |= {"role": "ours", "items": len(density[0]), "error": error}
    assert error < 1e-4


@pytest.mark.benchmark(group=DENSITIES)
def test_kdepy(benchmark, peer, density, tmp_path):
    samples, x, y, bandwidth = density
    file = tmp_path / "samples.npy"
    np.save(file, samples)
    grid = {"x": x, "y": y, "bandwidth": bandwidth, "shown": SHOWN}
    run = peer("densities", samples=str(file), **grid)

    error = error_of(np.array(benchmark(run)), *density)

    stated = {"role": "peer", "against": "KDEpy", "target": 5, "error": error}
    benchmark.extra_info |= stated | {"items": len(samples)}
    assert error < 1e-2


class Problems(NamedTuple):
    """ω, a, J₂⁺ of takes × steps problems of m × m, and the weights."""

    noise: np.ndarray
    a: np.ndarray
    back: np.ndarray
    weights: tuple[float, float]

    def fits(self):
        return fit_perturbations(*self, FLOOR)

    def some(self, count: int) -> "Problems":
        """``count`` of the problems, evenly spread."""
        chosen = np.linspace(0, len(self.noise) - 1, count).astype(int)
        return Problems(*(values[chosen] for values in self[:3]), self.weights)


@pytest.fixture(params=FITS)
def problems(benchmark, request, size) -> Problems:
    """Problems of steps that the model draws of an arm, measured with noise."""
    benchmark.group = FITS[request.param]
    stage = scene(request.param)
    takes = size(100, 3)
    chain = stage.chain
    decomposition = stage.model.decomposition
    # σ_B so large that definiteness binds some of the problems
    model = WishartModel(2 * SIGMA_B, decomposition)

    rng = np.random.default_rng(2017)
    path = swing(320, stage.start.mean)
    v = np.matvec(chain.jacobian(path[:-1]), np.diff(path, axis=0))
    before, commands = (np.tile(array, (takes, 1, 1)) for array in (path[:-1], v))
    after, _ = draw_steps(model, chain, before, v, rng)
    start = before + MARKERS * rng.standard_normal(before.shape)
    end = after + MARKERS * rng.standard_normal(after.shape)

    a, back, _ = factors(chain, start, commands, decomposition)
    noise = end - start - chain.nominal_step(start, commands)
    m = a.shape[-1]
    # at rest two measurements differ by their noise alone
    weights = objective_weights(np.sqrt(2 * m) * MARKERS, m)
    vectors = noise.reshape(-1, m), a.reshape(-1, m)
    return Problems(*vectors, back.reshape(-1, m, m), weights)


def parametrised(
    weights: tuple[float, float],
    m: int,
) -> Callable[[Problems], list[float]]:
    """(BsampOpt) as printed, with the data as parameters: compiled once."""
    noise = cp.Parameter(m)
    matrix = cp.Parameter((m, m * m))
    s = cp.Variable((m, m), symmetric=True)
    # a product of two parameters would not be parametrised: J₂⁻¹Sa = (aᵀ ⊗ J₂⁻¹) vec S
    residual = cp.norm(noise - matrix @ cp.vec(s, order="F"))
    objective = cp.Minimize(weights[0] * residual + weights[1] * cp.norm(s, "fro"))
    problem = cp.Problem(objective, [s + np.eye(m) >> FLOOR * np.eye(m)])

    def solve(chosen: Problems) -> list[float]:
        values = []
        for omega, a, back in zip(*chosen[:3], strict=True):
            noise.value = omega
            matrix.value = np.kron(a, back)
            values.append(problem.solve(solver=cp.CLARABEL))
        return values

    return solve


def test_our_fits(benchmark, problems, size):
    fits = benchmark(problems.fits)
    objective = float(problems.some(size(60, 4)).fits().objective.mean())
    stated = {"role": "ours", "items": len(problems.noise), "objective": objective}
    benchmark.extra_info |= stated
    assert fits.bound.any()


def test_cvxpy(benchmark, problems, size):
    solved = problems.some(size(60, 4))
    values = benchmark(parametrised(problems.weights, problems.a.shape[1]), solved)
    benchmark.extra_info |= {"role": "peer", "against": "CVXPY", "items": len(values)}
    benchmark.extra_info |= {"target": 500, "objective": float(np.mean(values))}
    benchmark.extra_info["configuration"] = (
        "one parametrised problem, compiled once, then solved by Clarabel for each problem's "
        "values of the parameters; the time of the model between counts"
    )
    assert_allclose(values, solved.fits().objective, rtol=1e-5, atol=1e-9)
