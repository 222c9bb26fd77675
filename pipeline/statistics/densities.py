"""Kernel densities with the kernel and bandwidth of MATLAB's ksdensity, as in the paper's figure of
the force, and the two-sample energy test (Székely and Rizzo 2004).

A permutation test needs exchangeable samples. A record that is correlated in time is therefore
thinned to nearly independent samples.
"""

import numpy as np
from numpy import ndarray

from pipeline.core.compiled import compiled
from pipeline.core.errors import ModelDomainError

REACH = 8.0  # bandwidths; beyond them a Gaussian kernel is below 2e-14 of its peak
NODES_PER_BANDWIDTH = 3
BLOCK = 32  # grid points that are evaluated at once
WINDOW = 5  # autocorrelation times over which correlations are summed (Sokal 1997)
SPACING = 2  # autocorrelation times between thinned samples, whose correlation is about exp(−4)
MAX_SAMPLES = 300  # of a thinned record: the test stores the distances of all pairs
PERMUTATIONS = 1999


def normal_reference_bandwidth(samples: ndarray) -> ndarray:
    """Return the bandwidths (p,) h_i = (MAD_i/0.6745)·(4/((p+2)N))^{1/(p+4)} of ``samples`` (N, p).

    Samples are independent. Raises ModelDomainError if over half of a variable's samples are equal.
    """
    count, p = np.shape(samples)
    scale = np.median(np.abs(samples - np.median(samples, axis=0)), axis=0) / 0.6745
    if not np.all(scale > 0):
        message = (
            "a variable whose median absolute deviation is 0 or missing has no density"
        )
        raise ModelDomainError(message, samples=count)
    return scale * (4 / ((p + 2) * count)) ** (1 / (p + 4))


def marginal_density(samples: ndarray, x: ndarray) -> ndarray:
    """Return the Gaussian kernel density (g,) of ``samples`` (N,) at ``x`` (g,), per unit; raises
    ModelDomainError like :func:`normal_reference_bandwidth`.
    """
    (bandwidth,) = normal_reference_bandwidth(samples[:, None])
    sums = _smooth(np.ones((len(samples), 1)), x, np.sort(samples), bandwidth)[:, 0]
    return sums / (np.sqrt(2 * np.pi) * bandwidth * len(samples))


def kernel_density(
    samples: ndarray,
    x: ndarray,
    y: ndarray,
    bandwidth: ndarray,
) -> ndarray:
    """Return the product-Gaussian kernel density (gx, gy) of ``samples`` (N, 2) on the grid ``x``
    (gx,) × ``y`` (gy,), per squared unit; ``bandwidth`` (2,).

    A quadratic B-spline distributes every sample to 3 × 3 nodes, a third of a bandwidth apart. A
    Gaussian, narrowed by the spline's variance, smooths the nodes' masses. The error of a kernel is
    below 8e-4 of its peak.
    """
    step = bandwidth / NODES_PER_BANDWIDTH
    width = np.sqrt(bandwidth**2 - step**2 / 4)
    reach = REACH * bandwidth + step
    low = np.array([np.min(x), np.min(y)]) - reach
    high = np.array([np.max(x), np.max(y)]) + reach
    rows, columns = np.ceil((high - low) / step).astype(int) + 4
    masses = np.zeros((rows, columns))
    _add_to_nodes(np.ascontiguousarray(samples, dtype=float), low, step, masses)

    x_nodes = low[0] + step[0] * np.arange(rows)
    y_nodes = low[1] + step[1] * np.arange(columns)
    along_x = _smooth(masses, x, x_nodes, width[0])
    smoothed = _smooth(along_x.T, y, y_nodes, width[1]).T
    return smoothed / (2 * np.pi * np.prod(width) * len(samples))


@compiled
def _add_to_nodes(samples, low, step, masses):
    """Distribute ``samples`` (N, 2) over the ``masses`` of the nodes at ``low`` + k·``step``."""
    rows, columns = masses.shape
    flat = masses.reshape(-1)
    start0 = low[0]
    start1 = low[1]
    per0 = 1 / step[0]
    per1 = 1 / step[1]
    for i in range(samples.shape[0]):
        # three nodes, the second of which is nearest
        row = (samples[i, 0] - start0) * per0 - 0.5
        column = (samples[i, 1] - start1) * per1 - 0.5
        if (0.0 <= row) & (row < rows - 2) & (0.0 <= column) & (column < columns - 3):
            first_row = np.int64(row)
            first_column = np.int64(column)
            place = np.uint64(first_row * columns + first_column)
            # from the middle of the first two nodes
            t = row - first_row
            s = column - first_column
            down = 0.5 - t + 0.5 * t * t, 0.5 + t - t * t, 0.5 * t * t
            across = 0.5 - s + 0.5 * s * s, 0.5 + s - s * s, 0.5 * s * s
            for k in range(3):
                for j in range(3):
                    flat[place + np.uint64(j)] += down[k] * across[j]
                place += np.uint64(columns)


def _smooth(masses: ndarray, grid: ndarray, nodes: ndarray, width: float) -> ndarray:
    """Return the sums (g, k) of ``masses`` (n, k) at the sorted ``nodes`` (n,), weighted by a
    Gaussian of standard deviation ``width`` about each point of ``grid`` (g,).
    """
    sums = np.empty((len(grid), masses.shape[1]))
    reach = REACH * width
    for start in range(0, len(grid), BLOCK):
        block = grid[start : start + BLOCK]
        ends = [block.min() - reach, block.max() + reach]
        near = slice(*np.searchsorted(nodes, ends))
        distances = (block[:, None] - nodes[near]) / width
        weights = np.exp(-0.5 * distances**2)
        sums[start : start + BLOCK] = weights @ masses[near]
    return sums


def autocorrelation_time(record: ndarray) -> float:
    """Return the integrated autocorrelation time τ = 1 + 2·Σρ_k ≥ 1, in samples, of the slowest
    component of ``record`` (N, p). The component's mean varies as a mean of N/τ independent samples
    does. The sum ends at the first lag k ≥ WINDOW·τ. Raises ModelDomainError for a constant
    component.
    """
    count = len(record)
    ranges = np.ptp(record, axis=0)
    if count < 2 or np.any(ranges == 0):
        message = "a record whose values are all equal has no autocorrelation time"
        raise ModelDomainError(message, samples=count)
    # zero padding to twice the length avoids the wrap-around of circular correlation
    centred = record - np.mean(record, axis=0)
    spectrum = np.fft.rfft(centred, 2 * count, axis=0)
    power = np.abs(spectrum) ** 2
    covariance = np.fft.irfft(power, axis=0)[:count]
    times = 2 * np.cumsum(covariance / covariance[0], axis=0) - 1
    lags = np.arange(count)[:, None]
    ends = np.argmax(lags >= WINDOW * times, axis=0)
    at_ends = np.take_along_axis(times, ends[None], axis=0)[0]
    return float(max(1.0, *at_ends))


def thin_record(record: ndarray) -> ndarray:
    """Return samples (K, p) of ``record`` (N, p), ⌈2τ⌉ or more apart; ModelDomainError if K = 1."""
    independent = int(np.ceil(SPACING * autocorrelation_time(record)))
    step = max(independent, -(-len(record) // MAX_SAMPLES))
    if len(record) <= step:
        message = "the record is too short for its autocorrelation time: record longer"
        raise ModelDomainError(message, samples=len(record), step=step)
    return record[::step]


def energy_test(
    a: ndarray,
    b: ndarray,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Return the energy distance 2E‖A − B‖ − E‖A − A′‖ − E‖B − B′‖ of independent samples ``a``
    (K, p) and ``b`` (L, p), in their unit, and its p-value: the share of divisions with at least
    this distance, among the true and PERMUTATIONS random divisions of the pooled samples.
    """
    pooled = np.concatenate([a, b])
    squares = [np.subtract.outer(x, x) ** 2 for x in pooled.T]
    distances = np.sqrt(sum(squares))
    sizes = np.array([len(a), len(b)])
    weights = np.repeat([1.0, -1.0] / sizes, sizes)
    observed = -weights @ distances @ weights

    rows = np.tile(weights, (PERMUTATIONS, 1))
    divisions = rng.permuted(rows, axis=1)
    permuted = -np.einsum("ki,ki->k", divisions @ distances, divisions)
    # with the true division
    as_distant = 1 + np.sum(permuted >= observed)
    p_value = as_distant / (1 + PERMUTATIONS)
    return float(observed), float(p_value)
