"""How far the takes of a motion spread, predicted by a model and realised, and how far the orders
of motions agree.

The yardstick is the one-step noise ω of :mod:`pipeline.models.noise`, summed over the motion, tr
Cov(ω_k): that is what a model of steps states and a planner sums. What a step does is undone by the
next where a servo holds the arm, so the spread of the poses about their mean is told beside it. The
tip's are the same of the task's rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import kendalltau

from pipeline.core.errors import ModelDomainError
from pipeline.models.model import MotionModel
from pipeline.models.noise import process_noise
from pipeline.studies.planning.bench import Bench

PARTS, KINDS = ("joints", "tip"), ("step", "pose")
FEWEST = 3  # motions, fewer of which have hardly an order
DIGITS = 9  # of a prediction; what differs less is alike


def deviations(bench: Bench, path: np.ndarray, q: np.ndarray) -> dict[tuple[str, str], np.ndarray]:
    """What the takes ``q`` (takes, M+1, n) in rad of a ``path`` (M+1, n) do beyond it, by part and
    kind: (takes, M, n) and (takes, M, m) in a step, (takes, M+1, n) and (takes, M+1, m) at a pose.

    Raises SingularJacobianError.
    """
    chain, command = bench.chain, bench.command(path)
    tip = chain.pose(q)
    v = command[:, : len(chain.task)]
    return {
        ("joints", "step"): process_noise(chain, q, command),
        ("joints", "pose"): q - path,
        ("tip", "step"): chain.displacement(tip[:, :-1], tip[:, 1:]) - v,
        ("tip", "pose"): chain.displacement(chain.pose(path), tip),
    }


def products(deviation: np.ndarray) -> np.ndarray:
    """(takes, takes) inner products of the takes' ``deviation`` (takes, K, d) about their mean: all
    that the summed variance of any choice of takes hangs on.
    """
    centred = (deviation - deviation.mean(axis=0)).reshape(len(deviation), -1)
    # einsum, whose sums no linear algebra library orders
    return np.einsum("ik,jk->ij", centred, centred)


def summed_variance(product: np.ndarray, numbers: np.ndarray) -> float:
    """Σ_k tr of the sample covariance over the takes with these ``numbers``, as often as each is
    named; ``product`` (takes, takes).
    """
    times = np.bincount(numbers, minlength=len(product)).astype(float)
    count = times.sum()
    about_mean = times @ np.diag(product) - times @ product @ times / count
    return float(about_mean / (count - 1))


def predicted(bench: Bench, model: MotionModel, path: np.ndarray) -> dict[str, np.ndarray] | None:
    """(M,) tr Cov of the steps of a ``path`` (M+1, n) in rad by part, in rad² and in the squared
    units of the task; None where the ``model`` has no covariance somewhere on it.
    """
    q, command = path[:-1], bench.command(path)
    try:
        covariance = model.covariance(bench.chain, q, command)
    except ModelDomainError:
        return None
    j = bench.chain.jacobian(q)
    return {
        "joints": np.trace(covariance, axis1=-2, axis2=-1),
        "tip": np.einsum("kai,kij,kaj->k", j, covariance, j),
    }


def agreement(prediction: Mapping[str, float], realised: Mapping[str, float]) -> float:
    """Kendall's τ_b of two orders of the motions that both know (Kendall, Biometrika 33, 1945): 1
    where they agree, −1 where they are opposite; NaN for FEWEST or where one has no order.
    """
    names = [name for name in prediction if name in realised]
    if len(names) < FEWEST:
        return float("nan")
    first = [float(f"{prediction[name]:.{DIGITS}g}") for name in names]
    if len(set(first)) == 1:
        return float("nan")
    return float(kendalltau(first, [realised[name] for name in names]).statistic)


def least(sums: Mapping[str, float]) -> str:
    """The motion of the least of ``sums``."""
    return min(sums, key=sums.__getitem__)


def ends(values: Sequence[float], tails: tuple[float, float]) -> tuple[float, float]:
    """The quantiles ``tails`` of ``values``; NaN where one of them is missing."""
    low, high = np.quantile(values, tails)
    return float(low), float(high)
