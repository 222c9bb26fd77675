"""Linear minimum-variance filter of deviations whose covariance over time is known.

For normal deviations and noise it is the exact posterior, by Gaussian process regression
(Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006, Sec. 2.2), and the Kalman
filter for a Markov law (Anderson & Moore, Optimal Filtering, 1979).

The path has the prior N(q̄, P). Frame j measures the pose p_j, interpolated between the ends of its
step, with the response A: y_j − b_j = p̄_j + A(p_j − p̄_j) + N(0, R_j). So H_j is A times the
weights of the two ends. With the frames in order of time and S = H P Hᵀ + R = L Lᵀ
one factorisation gives the posterior at every step given the frames so far,

    E q_k = q̄_k + G_kᵀ w,   Cov q_k = P_kk − G_kᵀ G_k,   G = L⁻¹ H P,   w = L⁻¹(y − b − p̄).

Two baselines use only the training takes: NONE of :mod:`pipeline.core.filters` uses the mean and
covariance at each step, MEMORY also the autocorrelation over time,

    Cov(e_k, e_l) = S_k^½ r(|k − l|) S_l^½,    r(l) = Σ e_kᵀe_{k+l} / Σ e_kᵀe_k,

with the deviations e_k from the mean and their covariance S_k at step k. Sums are over takes,
joints and steps. S_k and r exclude the measurement noise.
"""

from collections.abc import Sequence

import numpy as np
from numpy import ndarray

from pipeline.core.errors import ModelDomainError
from pipeline.core.filters import MEMORY, NONE
from pipeline.filtering.measurement import Frames, Measurements
from pipeline.models.model import root, without_measurement
from pipeline.statistics.takes import takes_moments


def linear_filter(
    path: ndarray,
    covariance: ndarray,
    takes: Sequence[Measurements],
    dt: float,
    response: ndarray | None = None,
) -> tuple[ndarray, ndarray]:
    """Return means (T, M+1, n) in rad and covariances (T, M+1, n, n) in rad² of the poses of the T
    ``takes`` at each step given the frames up to it. ``path`` (M+1, n) rad is q̄ at steps of ``dt``
    (s), ``covariance`` (M+1, n, M+1, n) rad² is P, ``response`` (n, n) is A (default identity).
    Raises ModelDomainError where P or R has a negative eigenvalue.
    """
    observation = np.eye(path.shape[1]) if response is None else response
    means = []
    covariances = []
    for take in takes:
        mean, posterior = _posterior(path, covariance, take, dt, observation)
        means.append(mean)
        covariances.append(posterior)
    return np.stack(means), np.stack(covariances)


def _posterior(
    path: ndarray,
    covariance: ndarray,
    measurements: Measurements,
    dt: float,
    observation: ndarray,
) -> tuple[ndarray, ndarray]:
    """Return mean (M+1, n) and covariance (M+1, n, n) at each step of one take."""
    from scipy.linalg import cho_factor, solve_triangular

    grid, n = path.shape
    frames = measurements.frames(grid - 1, dt)
    residual, across, total = _innovations(path, covariance, frames, observation)
    rows = residual.size
    try:
        factor, _ = cho_factor(total.reshape(rows, rows), lower=True)
    except np.linalg.LinAlgError:
        message = "the prior covariance of the path has a negative eigenvalue"
        raise ModelDomainError(message, take=measurements.take) from None
    white = solve_triangular(factor, residual.reshape(rows), lower=True)
    gain = solve_triangular(factor, across.reshape(rows, grid * n), lower=True)

    # a pose is filtered by the frames up to it
    so_far = np.arange(rows)[:, None] < n * frames.first[1:]
    gain = gain.reshape(rows, grid, n) * so_far[..., None]
    gain = np.moveaxis(gain, 0, 2)  # (M+1, n, nF)
    steps = np.arange(grid)
    mean = path + gain @ white
    return mean, covariance[steps, :, steps] - gain @ gain.swapaxes(1, 2)


def _innovations(
    path: ndarray,
    covariance: ndarray,
    frames: Frames,
    observation: ndarray,
) -> tuple[ndarray, ndarray, ndarray]:
    """Return the innovations (F, n) in rad of the ``frames``, the covariances HP (F, n, M+1, n) of
    each frame with each pose, and S (F, n, F, n), in rad².
    """
    grid, n = path.shape
    after = np.repeat(np.arange(grid), np.diff(frames.first))
    before = np.maximum(after - 1, 0)
    share = frames.share[:, None]
    expected = (1 - share) * path[before] + share * path[after]
    residual = frames.unbiased - expected

    share = share[:, :, None, None]
    across = (1 - share) * covariance[before] + share * covariance[after]
    observed = observation @ across.reshape(-1, n, grid * n)
    across = observed.reshape(-1, n, grid, n)

    among = np.moveaxis(across, 2, 0)
    among = (1 - share) * among[before] + share * among[after]
    total = np.moveaxis(among @ observation.T, 0, 2)
    frame = np.arange(len(after))
    unwhitened = np.linalg.inv(frames.whitening)
    total[frame, :, frame] += unwhitened @ unwhitened.swapaxes(-1, -2)
    return residual, across, total


def baseline_predictions(
    training: ndarray,
    poses: ndarray,
    measurement: ndarray,
) -> dict[str, tuple[ndarray, ndarray]]:
    """Return the prediction errors (..., K − 1, n) in rad of ``poses`` (..., K, n) and the
    predicted covariances (K − 1, n, n) in rad², by baseline. MEMORY uses the pose y_k = e_k + N(0,
    Σ) measured one step before: E(e_{k+1} | y_k) = Cov(e_{k+1}, e_k)(S_k + Σ)⁻¹ y_k. ``training``
    (takes, K, n) rad are the training takes, ``measurement`` (n, n) rad² is Σ.
    """
    mean, covariance = takes_moments(training)
    deviation = poses - mean
    roots = deviation_roots(training, measurement)
    measured = roots @ roots + measurement  # S_k + Σ
    lag_one = autocorrelation(training, measurement)[1]
    across = lag_one * (roots[1:] @ roots[:-1])
    transposed = across.swapaxes(1, 2)
    gain = np.linalg.solve(measured[:-1], transposed).swapaxes(1, 2)

    before = deviation[..., :-1, :]
    after = deviation[..., 1:, :]
    errors = after - np.matvec(gain, before)
    left = measured[1:] - gain @ transposed
    symmetric = (left + left.swapaxes(1, 2)) / 2
    return {NONE: (after, covariance[1:]), MEMORY: (errors, symmetric)}


def autocorrelated_filter(
    poses: ndarray,
    measurement: ndarray,
    takes: Sequence[Measurements],
    dt: float,
) -> tuple[ndarray, ndarray]:
    """Return the result of :func:`linear_filter` with the law of the training takes. ``poses``
    (takes, K, n) rad are the training takes, ``measurement`` (n, n) rad² is the covariance of the
    measurement noise.
    """
    roots = deviation_roots(poses, measurement)
    steps = np.arange(len(roots))
    lags = np.abs(np.subtract.outer(steps, steps))
    correlation = autocorrelation(poses, measurement)[lags]
    prior = np.einsum("kia,lja,kl->kilj", roots, roots, correlation)  # Cov(e_k, e_l)
    return linear_filter(poses.mean(axis=0), prior, takes, dt)


def white_steps(start: ndarray, variances: ndarray) -> ndarray:
    """Return the covariance P (M+1, n, M+1, n) in rad² of poses whose first has the covariance
    ``start`` (n, n) and whose steps have independent noise of the ``variances`` (M, n).
    """
    before_first = np.zeros_like(variances[:1])
    summed = np.vstack([before_first, np.cumsum(variances, axis=0)])
    grid = np.arange(len(summed))
    # a pose and a later one share the noise of the steps before the earlier
    earlier = np.minimum.outer(grid, grid)
    shared = summed[earlier]
    covariance = start + shared[..., None] * np.eye(len(start))
    return np.ascontiguousarray(covariance.transpose(0, 2, 1, 3))


def deviation_roots(poses: ndarray, measurement: ndarray) -> ndarray:
    """Return S_k^½ (K, n, n) in rad of ``poses`` (takes, K, n), zero along axes without a variance
    beyond the measurement's.
    """
    _, covariances = takes_moments(poses)
    roots = []
    for covariance in covariances:
        of_motion, _ = without_measurement(covariance, measurement)
        roots.append(root(of_motion))
    return np.stack(roots)


def autocorrelation(poses: ndarray, measurement: ndarray) -> ndarray:
    """Return r (K,) of ``poses`` (takes, K, n); r of white noise if there are no deviations. Where
    the white spectrum of the measurement exceeds the spectrum of the takes by chance, the
    difference is set to zero, so that r is positive semidefinite.
    """
    takes, steps, _ = poses.shape
    deviation = poses - poses.mean(axis=0)
    spectrum = np.fft.rfft(deviation, 2 * steps, axis=1)
    power = np.sum(np.abs(spectrum) ** 2, axis=(0, 2))
    noise = (takes - 1) * steps * np.trace(measurement)
    power_of_motion = np.maximum(power - noise, 0.0)
    products = np.fft.irfft(power_of_motion, 2 * steps)[:steps]
    if not products[0] > 0:
        return np.eye(1, steps)[0]
    return products / products[0]
