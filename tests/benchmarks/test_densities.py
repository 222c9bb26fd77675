"""The kernel density of many samples on a grid, against KDEpy's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from pipeline.statistics.densities import kernel_density, normal_reference_bandwidth

pytestmark = pytest.mark.benchmark(group="Densities, a million samples on 256 × 256 points")
SHOWN = 16  # every so many-th grid point is held against the exact sum


@dataclass(frozen=True)
class Density:
    """Correlated normal samples and a grid over all of them, as KDEpy needs it."""

    samples: np.ndarray
    grid: tuple[np.ndarray, np.ndarray]
    bandwidth: np.ndarray

    def error(self, shown: np.ndarray) -> float:
        """Greatest relative distance of the density at the ``shown`` points from the exact sum."""
        x, y = (g[::SHOWN] for g in self.grid)
        kernels = [
            np.exp(-0.5 * ((g[:, None] - self.samples[:, i]) / self.bandwidth[i]) ** 2)
            for i, g in enumerate((x, y))
        ]
        exact = kernels[0] @ kernels[1].T
        exact /= 2 * np.pi * np.prod(self.bandwidth) * len(self.samples)
        return float(np.abs(shown - exact).max() / exact.max())


@pytest.fixture
def problem(size) -> Density:
    samples = np.random.default_rng(28).multivariate_normal(
        [3.0, 5.0], [[5.0, -2.0], [-2.0, 2.0]], size(1_000_000, 1000)
    )
    bandwidth = normal_reference_bandwidth(samples)
    margin = 3 * bandwidth
    grid = np.linspace(samples.min(axis=0) - margin, samples.max(axis=0) + margin, size(256, 64))
    return Density(samples, (grid[:, 0], grid[:, 1]), bandwidth)


def test_ours(benchmark, problem):
    benchmark.extra_info |= {"role": "ours", "items": len(problem.samples)}
    density = benchmark(kernel_density, problem.samples, *problem.grid, problem.bandwidth)
    benchmark.extra_info["error"] = problem.error(density[::SHOWN, ::SHOWN])
    assert benchmark.extra_info["error"] < 1e-4


def test_kdepy(benchmark, peer, problem, tmp_path):
    benchmark.extra_info |= {"role": "peer", "items": len(problem.samples), "target": 5}
    benchmark.extra_info["against"] = "KDEpy"
    np.save(tmp_path / "samples.npy", problem.samples)
    x, y = problem.grid
    grid = {"x": x, "y": y, "bandwidth": problem.bandwidth, "shown": SHOWN}
    call = peer("densities", samples=str(tmp_path / "samples.npy"), **grid)
    density = benchmark(call)
    benchmark.extra_info["error"] = problem.error(np.array(density))
    assert benchmark.extra_info["error"] < 1e-2
