"""Test of whether a recorded standard deviation goes up and down with a model's, made so that the
model itself passes.

Statistic is the correlation over time of the modelled and the recorded standard deviation of one
joint. Few takes make the recorded one uncertain, so that even a true model reaches a correlation
well below 1, the lower the fewer the takes and the less its standard deviation varies. The limit is
√½, where the model explains half of the variation of the recorded curve, or a quantile of the
correlation over draws of as many takes from the model itself, if that is lower. The power is the
share of draws of constant noise that the limit rejects.

Draws have the model's own law at each step, tails included, and consecutive steps of a take are
correlated as the recorded ones are on average: the ranks of the draws follow a first-order
autoregression with the recorded correlation of neighbouring steps (a Gaussian copula). Not
modelled are correlations that last otherwise, such as a deviation that differs between recordings,
and any dependence between joints; the limits of several joints hold for independent ones.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from scipy.special import ndtr, ndtri

from pipeline.statistics.agreement import correlation, lag_one_correlation

RECOGNISED = 0.95  # share of draws of a true model that pass in all joints
POWER = 0.8  # least share of draws of constant noise that a test has to reject to be evidence
REPLICATES = 200
HALF_EXPLAINED = 0.5**0.5
CLOSE_TO_ONE = 0.9999  # greatest correlation of neighbouring steps that is drawn


def following_tests(
    std: np.ndarray,
    draws: np.ndarray,
    noise: np.ndarray,
    steps: Mapping[str, np.ndarray],
    joints: tuple[str, ...],
    rng: np.random.Generator,
) -> pd.DataFrame:
    """A row for each joint and each set of steps: the ``correlation`` over time of the modelled and
    the recorded standard deviation, its ``limit`` and the ``power`` at that limit.

    The limits are such that a true model passes in all joints at once in at least RECOGNISED of the
    draws; the quantiles are normal ones of Fisher's transform of the drawn correlations. A constant
    standard deviation has no row.

    Args:
        std: (M, n) rad, the model's standard deviation, measurement noise included.
        draws: (S, M, n) rad, noise of the model with the measurement noise.
        noise: (takes, M, n) rad, recorded noise, at least two takes.
        steps: by name the (M,) steps that the correlation runs over.
        joints: names of the n joints.
        rng: draws the takes.
    """
    rows, recorded = [], noise.std(axis=0, ddof=1)
    quantile = ndtri(1 - RECOGNISED ** (1 / len(joints)))
    for j, joint in enumerate(joints):
        variates = _autoregression(noise[..., j], rng)
        ordered = np.sort(draws[..., j].T, axis=1)
        ranks = (ndtr(variates) * ordered.shape[1]).astype(np.intp).reshape(len(ordered), -1)
        taken = np.take_along_axis(ordered, ranks, axis=1).reshape(variates.shape)
        own, constant = taken.std(axis=-1, ddof=1), variates.std(axis=-1, ddof=1)
        for name, chosen in steps.items():
            modelled = std[chosen, j]
            if chosen.sum() < 3 or np.ptp(modelled) == 0:
                continue
            fisher = np.arctanh(_correlations(modelled, own[chosen]))
            reached = float(np.tanh(fisher.mean() + quantile * fisher.std(ddof=1)))
            limit = min(HALF_EXPLAINED, reached)
            rejected = _correlations(modelled, constant[chosen]) < limit
            rows.append(
                {
                    "joint": joint,
                    "steps": name,
                    "correlation": correlation(modelled, recorded[chosen, j]),
                    "limit": limit,
                    "power": float(rejected.mean()),
                }
            )
    return pd.DataFrame(rows, columns=["joint", "steps", "correlation", "limit", "power"])


def constant_noise_variation(noise: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n,) coefficient of variation over time of the standard deviation of so many takes that noise
    of one law at all steps stays below in RECOGNISED of the draws, in all joints at once.

    The law is that of all steps of ``noise`` (takes, M, n) in rad together, correlated from step to
    step as ``noise`` is.
    """
    share, result = RECOGNISED ** (1 / noise.shape[-1]), []
    for j in range(noise.shape[-1]):
        variates = _autoregression(noise[..., j], rng)
        ordered = np.sort((noise[..., j] - noise[..., j].mean(axis=0)).ravel())
        taken = ordered[(ndtr(variates) * len(ordered)).astype(np.intp)]
        curves = taken.std(axis=-1, ddof=1)
        result.append(np.quantile(curves.std(axis=0) / curves.mean(axis=0), share))
    return np.array(result)


def _autoregression(noise: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(M, REPLICATES, takes) standard normal variates, correlated from step to step as ``noise``
    (takes, M) is.
    """
    takes, count = noise.shape
    share = np.clip(lag_one_correlation(noise), -CLOSE_TO_ONE, CLOSE_TO_ONE)
    variates = rng.standard_normal((count, REPLICATES, takes))
    variates[1:] *= np.sqrt(1 - share**2)
    for k in range(1, count):
        variates[k] += share * variates[k - 1]
    return variates


def _correlations(curve: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(R,) Pearson's correlations of ``curve`` (K,) with each column of ``others`` (K, R)."""
    a, b = curve - curve.mean(), others - others.mean(axis=0)
    return a @ b / (np.linalg.norm(a) * np.linalg.norm(b, axis=0))
