"""Oracles of the particle filter: the Kalman filter with measurements between the steps, and how
far runs are off an exact posterior.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import multivariate_normal

from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, Start


def kalman(
    steps: np.ndarray,
    dt: float,
    inverse: np.ndarray,
    start: Start,
    noise: np.ndarray,
    measurements: Measurements,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Exact filtering means (M+1, 3), covariances (M+1, 3, 3) and log-evidence, on the pair of
    poses that bound a step.

    Args:
        steps: (M, 3) commanded steps of the task.
        dt: time of a step, s.
        inverse: (3, 3) what a step of the task moves the joints by.
        start: law of the first pose.
        noise: (3, 3) covariance of the motion noise of a step.
        measurements: of the poses, at times of their own.
    """
    frames, due, shares = measurements.schedule(len(steps), dt)
    mean, covariance = np.tile(start.mean, 2), np.tile(start.covariance, (2, 2))
    means, covariances, evidence = [], [], 0.0
    for k in range(len(steps) + 1):
        if k > 0:
            last = covariance[3:, 3:]
            mean = np.concatenate([mean[3:], mean[3:] + inverse @ steps[k - 1]])
            covariance = np.block([[last, last], [last, last + noise]])
        for frame, share in zip(frames[due == k], shares[due == k], strict=True):
            looks = np.hstack([(1 - share) * np.eye(3), share * np.eye(3)])
            spread = looks @ covariance @ looks.T + measurements.covariance[frame]
            surprise = measurements.y[frame] - measurements.bias[frame] - looks @ mean
            gain = np.linalg.solve(spread, looks @ covariance).T
            mean, covariance = mean + gain @ surprise, covariance - gain @ looks @ covariance
            evidence += multivariate_normal.logpdf(surprise, np.zeros(3), spread)
        means.append(mean[3:])
        covariances.append(covariance[3:, 3:])
    return np.array(means), np.array(covariances), evidence


def distance(
    runs: list[Posterior], mean: np.ndarray, covariance: np.ndarray, evidence: float
) -> np.ndarray:
    """Root mean square deviation of the runs' average from the exact mean and covariance, and that
    of the log-evidence, each in standard errors taken from the independent runs; about 1 where the
    filter is right.
    """
    deviations = []
    for values, exact in (
        (np.array([run.mean for run in runs]), mean),
        (np.array([run.covariance for run in runs]), covariance),
        (np.array([run.log_evidence for run in runs]), np.array(evidence)),
    ):
        error = values.std(axis=0, ddof=1) / np.sqrt(len(runs))
        varies = error > 1e-15
        deviations.append(
            np.sqrt(np.mean(((values.mean(axis=0) - exact)[varies] / error[varies]) ** 2))
        )
    return np.array(deviations)
