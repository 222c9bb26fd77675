"""What a step costs: its uncertainty under a motion model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ConfigError, ModelDomainError, SingularJacobianError
from pipeline.models.model import MotionModel

OBJECTIVES = ("trace", "log_det")
BLOCK = 1024  # poses whose matrices stay in the processor's cache
NONE = 1e-12  # of the greatest variance: below it a covariance has none along an axis

# the cost (N,) of the steps ``v`` (N, m) of the task at the poses ``q`` (N, n) in rad
Cost = Callable[[np.ndarray, np.ndarray], np.ndarray]


def uncertainty(model: MotionModel, chain: Chain, objective: str) -> Cost:
    """tr Cov(q_{k+1} | q_k) in rad², or its ln det, of a step under ``model``.

    The sum of covariances over a motion is a matrix and no objective; that of either number is.
    Where the covariance has the rank m of the task, as that of a matrix model with more joints than
    rows, ln det is that in the row space of J, of the m variances there; else that of all n. A step
    that commands nothing and has no noise costs nothing. The cost is that of the task step: no
    model of the paper gives noise to a step in the null space of J, and what the scaled model
    gives to one is left out.

    The cost raises what ``model.covariance`` does, and ModelDomainError where a step that moves has
    no variance along an axis, so that there is no ln det. Raises ConfigError for another objective.
    """
    if objective not in OBJECTIVES:
        raise ConfigError(
            f"no objective {objective!r}; there are {', '.join(OBJECTIVES)}", key="objective"
        )

    def trace(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.trace(model.covariance(chain, q, v), axis1=-2, axis2=-1)

    def log_det(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return _log_det(model.covariance(chain, q, v), np.any(v, axis=-1), len(chain.task))

    return trace if objective == "trace" else log_det


def _log_det(covariance: np.ndarray, moving: np.ndarray, m: int) -> np.ndarray:
    """(N,) of ``covariance`` (N, n, n), zero where it is zero and nothing is ``moving`` (N,)."""
    variances = np.linalg.eigvalsh(covariance)
    n = variances.shape[-1]
    present = variances > NONE * variances[:, -1:]
    rank = np.where(present.all(axis=-1), n, m)
    counted = np.arange(n) >= n - rank[:, None]
    still = ~moving & ~present[:, -1]
    lost = np.any(counted & ~present, axis=-1) & ~still
    if lost.any():
        raise ModelDomainError(
            "a step has no variance along some axis of the row space, and so no ln det; plan with "
            "the objective trace",
            index=(int(lost.argmax()),),
        )
    logs = np.log(variances, out=np.zeros_like(variances), where=counted & ~still[:, None])
    return logs.sum(axis=-1)


def where_defined(cost: Cost, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(N,) the ``cost``, infinite at the poses where it is refused, in blocks.

    Raises ModelDomainError where the model has no covariance at any pose.
    """
    blocks = range(0, len(q), BLOCK)
    parts = [_defined(cost, q[k : k + BLOCK], v[k : k + BLOCK]) for k in blocks]
    return np.concatenate([np.empty(0), *parts])


def _defined(cost: Cost, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(N,) of one block, which is halved where a part of it is refused."""
    try:
        return cost(q, v)
    except (ModelDomainError, SingularJacobianError) as error:
        if "index" not in error.evidence:
            raise
        if len(q) == 1:
            return np.array([np.inf])
        half = len(q) // 2
        parts = ((q[:half], v[:half]), (q[half:], v[half:]))
        return np.concatenate([_defined(cost, *part) for part in parts])
