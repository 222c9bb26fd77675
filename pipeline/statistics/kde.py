"""Kernel density of two variables with the kernel and bandwidth of MATLAB's ksdensity, which drew the paper's force densities."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.stats import median_abs_deviation

from pipeline.errors import ModelDomainError

REACH = 8.0  # bandwidths; beyond them a Gaussian kernel is below 2e-14 of its peak
BINS_PER_BANDWIDTH = 16


def normal_reference_bandwidth(samples: np.ndarray) -> np.ndarray:
    """h_i = (MAD_i/0.6745)·(4/((p+2)N))^{1/(p+4)}, (p,), in the units of ``samples`` (N, p); MAD about the median.

    The rule counts the samples as independent. Raises ModelDomainError where more than half of a variable's samples are equal: its MAD
    is 0 and there is no density.
    """
    count, p = np.shape(samples)
    scale = median_abs_deviation(samples, axis=0) / 0.6745
    if not np.all(scale > 0):
        raise ModelDomainError("a variable without spread has no density: its median absolute deviation is 0 or missing", samples=count)
    return scale * (4 / ((p + 2) * count)) ** (1 / (p + 4))


def _shares(values: np.ndarray, start: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """The two bins next to each of ``values`` and the linear share of each, both (2, N)."""
    position = (values - start) / step
    below = np.floor(position).astype(int)
    return np.stack([below, below + 1]), np.stack([below + 1 - position, position - below])


def kernel_density(samples: np.ndarray, x: np.ndarray, y: np.ndarray, bandwidth: np.ndarray) -> np.ndarray:
    """Product-Gaussian kernel density of ``samples`` (N, 2) at the grid ``x`` (gx,) × ``y`` (gy,), (gx, gy), per squared unit.

    ``bandwidth`` (2,). The samples are spread linearly on bins of a sixteenth of a bandwidth; the product kernel then is two matrix
    products. Samples that no grid point can feel are left out of the bins but counted in N, so mass outside the grid stays outside.
    """
    low = np.array([np.min(x), np.min(y)]) - REACH * bandwidth
    high = np.array([np.max(x), np.max(y)]) + REACH * bandwidth
    step = bandwidth / BINS_PER_BANDWIDTH
    felt = samples[np.all((samples >= low) & (samples <= high), axis=1)]
    bins = np.ceil((high - low) / step).astype(int) + 2
    (rows, row_shares), (columns, column_shares) = (_shares(felt[:, i], low[i], step[i]) for i in (0, 1))
    shares = (row_shares[:, None] * column_shares[None]).ravel()
    where = np.broadcast_arrays(rows[:, None], columns[None])
    weights = coo_array((shares, (where[0].ravel(), where[1].ravel())), shape=tuple(bins)).tocsr()
    kernels = [
        np.exp(-0.5 * ((grid[:, None] - (low[i] + step[i] * np.arange(bins[i]))) / bandwidth[i]) ** 2) for i, grid in enumerate((x, y))
    ]
    return (kernels[0] @ weights) @ kernels[1].T / (2 * np.pi * np.prod(bandwidth) * len(samples))
