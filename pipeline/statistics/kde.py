"""Kernel density of one and of two variables with the kernel and bandwidth of MATLAB's ksdensity,
which drew the paper's force densities.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.statistics.spread import spread

REACH = 8.0  # bandwidths; beyond them a Gaussian kernel is below 2e-14 of its peak
NODES_PER_BANDWIDTH = 3
BLOCK = 32  # grid points at a time


def normal_reference_bandwidth(samples: np.ndarray) -> np.ndarray:
    """h_i = (MAD_i/0.6745)·(4/((p+2)N))^{1/(p+4)}, (p,), in the units of ``samples`` (N, p); MAD
    about the median.

    The rule counts the samples as independent. Raises ModelDomainError where more than half of a
    variable's samples are equal: its MAD is 0 and there is no density.
    """
    count, p = np.shape(samples)
    scale = np.median(np.abs(samples - np.median(samples, axis=0)), axis=0) / 0.6745
    if not np.all(scale > 0):
        raise ModelDomainError(
            "a variable without spread has no density: its median absolute deviation is 0 or "
            "missing",
            samples=count,
        )
    return scale * (4 / ((p + 2) * count)) ** (1 / (p + 4))


def marginal_density(samples: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(g,) Gaussian kernel density of ``samples`` (N,) at ``x`` (g,), per unit, with the
    :func:`normal_reference_bandwidth`; of a kernel what is below 2e-14 of its peak may be left out.

    Raises what that does.
    """
    (bandwidth,) = normal_reference_bandwidth(samples[:, None])
    sums = _smoothed(np.ones((len(samples), 1)), x, np.sort(samples), bandwidth)[:, 0]
    return sums / (np.sqrt(2 * np.pi) * bandwidth * len(samples))


def kernel_density(
    samples: np.ndarray, x: np.ndarray, y: np.ndarray, bandwidth: np.ndarray
) -> np.ndarray:
    """Product-Gaussian kernel density of ``samples`` (N, 2) at the grid ``x`` (gx,) × ``y`` (gy,),
    (gx, gy), per squared unit.

    ``bandwidth`` (2,). Every sample is spread on 3 × 3 nodes a third of a bandwidth apart by the
    quadratic B-spline, and the masses of the nodes are smoothed by a Gaussian narrowed by the
    spline's own variance, so that the two together are the kernel but for its fourth moment: no
    kernel is off by more than 8e-4 of its peak, wherever between the nodes its sample lies, and
    none is negative. Samples that no grid point can feel are left out but counted in N, so mass
    outside the grid stays outside.
    """
    step = bandwidth / NODES_PER_BANDWIDTH
    width = np.sqrt(bandwidth**2 - step**2 / 4)
    reach = REACH * bandwidth + step
    low, high = np.array([np.min(x), np.min(y)]) - reach, np.array([np.max(x), np.max(y)]) + reach
    rows, columns = np.ceil((high - low) / step).astype(int) + 4
    masses = np.zeros((rows, columns))
    spread(samples, low, step, masses)
    smoothed = _smoothed(masses, x, low[0] + step[0] * np.arange(rows), width[0])
    return _smoothed(smoothed.T, y, low[1] + step[1] * np.arange(columns), width[1]).T / (
        2 * np.pi * np.prod(width) * len(samples)
    )


def _smoothed(masses: np.ndarray, grid: np.ndarray, nodes: np.ndarray, width: float) -> np.ndarray:
    """(g, k) sums of ``masses`` (n, k) over ``nodes`` (n,), weighed by a Gaussian of deviation
    ``width`` about each of ``grid`` (g,).

    Block by block of the grid, each with the nodes that it can feel: most of the whole matrix of
    weights would be zeros.
    """
    result = np.empty((len(grid), masses.shape[1]))
    reach = REACH * width
    for start in range(0, len(grid), BLOCK):
        block = grid[start : start + BLOCK]
        felt = slice(*np.searchsorted(nodes, [block.min() - reach, block.max() + reach]))
        result[start : start + BLOCK] = (
            np.exp(-0.5 * ((block[:, None] - nodes[felt]) / width) ** 2) @ masses[felt]
        )
    return result
