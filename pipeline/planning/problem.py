"""A task path that the tip follows step by step, the limits that its joints keep, and the cost of a
step: its uncertainty under a motion model. Newton's method brings poses to the path.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.models.model import MotionModel

REACHED = 1e-9  # of a displacement from the path, in m: beyond it a pose is not on it
CLOSE = REACHED / 100  # likewise, at which Newton's method ends
ROUND = 1e-9  # of the poses a turn apart, in m and rad: within it they are one
STRIDE = 0.5  # rad, of the longest step of Newton's method
OBJECTIVES = ("trace", "log_det")
BLOCK = 1024  # poses whose matrices stay in the processor's cache
NONE = 1e-12  # of the greatest variance: below it a covariance has none along an axis
TURN = 2 * np.pi

# the cost (N,) of the steps ``v`` (N, m) of the task at the poses ``q`` (N, n) in rad, infinite at
# a pose that no motion may take
Cost = Callable[[np.ndarray, np.ndarray], np.ndarray]


class InfeasibleError(PipelineError):
    """A path that no motion follows within the limits; ``step`` is the first at which it fails."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A path of M steps for an arm of n joints and m ≤ n task rows, within the chain's limits.

    Raises ConfigError for a path of fewer than two finite poses and for numbers out of range.
    """

    chain: Chain
    path: np.ndarray  # (M+1, p) poses x_k, as ``chain.pose`` gives them
    rate: float  # steps a second
    margin: float  # least value in m of ``chain.least_singular_value``
    smoothness: float  # weight of a squared null-space step, in units of the cost for a rad²

    def __post_init__(self) -> None:
        if np.ndim(self.path) != 2 or len(self.path) < 2 or not np.isfinite(self.path).all():
            raise ConfigError("a path needs two finite poses at least", key="path")
        for key, least in (("rate", 0.0), ("margin", 0.0), ("smoothness", -1e-300)):
            if not least < (value := getattr(self, key)) < np.inf:
                sign = "positive" if least == 0 else "not negative"
                raise ConfigError(f"{key} must be finite and {sign}, not {value}", key=key)

    @cached_property
    def steps(self) -> np.ndarray:
        """(M, m) the task steps v_k from x_k to x_{k+1}."""
        return self.chain.displacement(self.path[:-1], self.path[1:])

    def nominal(self, q: np.ndarray) -> np.ndarray:
        """(M, n) J⁺v_k in rad at the poses ``q`` (M, n)."""
        return np.matvec(self.chain.inverse_jacobian(q), self.steps)

    def objective(self, each: np.ndarray, joints: np.ndarray) -> float:
        """Σ cost + smoothness·Σ‖w_k‖² of ``joints`` (M+1, n); w_k is a step's null-space part."""
        w = np.diff(joints, axis=0) - self.nominal(joints[:-1])
        return float(each.sum() + self.smoothness * np.sum(w**2))

    @property
    def reach(self) -> np.ndarray:
        """(n,) greatest step of each joint in rad, by its greatest speed."""
        return self.chain.max_speed / self.rate

    @property
    def spare(self) -> int:
        """The redundant degrees n − m."""
        return len(self.chain.lower) - len(self.chain.task)

    @cached_property
    def comes_round(self) -> np.ndarray:
        """(n,) True of a joint whose whole turn leaves the pose of the tip as it is."""
        pose, turns = self.chain.pose, TURN * np.eye(len(self.chain.lower))
        return np.all(np.abs(pose(turns) - pose(0 * turns)) < ROUND, axis=-1)

    @property
    def turning(self) -> np.ndarray:
        """(n,) True of a joint that comes round within its limits."""
        return self.comes_round & (self.chain.upper - self.chain.lower > TURN)

    def nearest_turns(self, q: np.ndarray) -> np.ndarray:
        """``q`` (..., n) in rad less the turns that take it from the middle of its limits."""
        lower, upper = self.chain.lower, self.chain.upper
        middle = np.where(np.isfinite(upper - lower), (lower + upper) / 2, 0.0)
        return middle + self.less_turns(q - middle)

    def less_turns(self, step: np.ndarray) -> np.ndarray:
        """The ``step`` (..., n) in rad, of half a turn at most where a joint comes round."""
        return step - TURN * np.round(step / TURN) * self.comes_round

    def clear(self, q: np.ndarray) -> np.ndarray:
        """(P,) True of those of ``q`` (P, n) that keep the margin."""
        return ~self.chain.singular(q) & (self.chain.least_singular_value(q) >= self.margin)

    def failure(self, joints: np.ndarray) -> InfeasibleError | None:
        """First step at which the motion ``joints`` (M+1, n) in rad fails, and how, else None."""
        chain = self.chain
        off = chain.displacement(chain.pose(joints), self.path)
        speeding = np.any(np.abs(np.diff(joints, axis=0)) > self.reach * (1 + 1e-9), axis=-1)
        faults = {
            "the motion leaves the path": length_of(off) > REACHED,
            "the motion leaves the joint limits": ~chain.within_limits(joints),
            "the motion comes nearer to a singular pose than the margin": ~self.clear(joints),
            "the motion is faster than the joints can be": np.r_[speeding, False],
        }
        first = [(int(bad.argmax()), why) for why, bad in faults.items() if bad.any()]
        return InfeasibleError(min(first)[1], step=min(first)[0]) if first else None


def settle(
    chain: Chain, q: np.ndarray, target: np.ndarray, rounds: int
) -> tuple[np.ndarray, np.ndarray]:
    """(P, n) in rad the poses that the steps J⁺(target − x) lead to from ``q`` (P, n), and (P,)
    True where they reach the poses ``target`` (P, p); a lane that meets a singular pose does not.
    """
    q, reached = np.array(q, dtype=float), np.zeros(len(q), dtype=bool)
    lanes = np.arange(len(q))
    for left in range(rounds, -1, -1):
        off = chain.displacement(chain.pose(q[lanes]), target[lanes])
        far = ~(length_of(off) <= CLOSE)
        reached[lanes] = ~far
        lanes, off = lanes[far], off[far]
        if left == 0 or len(lanes) == 0:
            break
        regular = ~chain.singular(q[lanes])
        lanes = lanes[regular]
        step = np.matvec(chain.inverse_jacobian(q[lanes]), off[regular])
        q[lanes] += step * (STRIDE / np.maximum(length_of(step), STRIDE))[:, None]
    return q, reached


def length_of(steps: np.ndarray) -> np.ndarray:
    """(...,) norms of ``steps`` (..., n)."""
    return np.sqrt(np.vecdot(steps, steps))


def uncertainty(model: MotionModel, chain: Chain, objective: str) -> Cost:
    """tr Cov(q_{k+1} | q_k) in rad², or its ln det, of a step under ``model``; infinite at a
    singular pose, and where a step that moves has no ln det, as it has no variance along an axis.

    Where the covariance has the rank m of the task, as under a matrix model with more joints than
    rows, ln det is taken of the m variances in the row space of J; else of all n. A step that
    commands nothing and has no noise costs nothing. Noise that the scaled model gives to a step in
    the null space of J is left out. The cost raises what ``model.covariance`` does.
    """

    def of_regular(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        covariance = model.covariance(chain, q, v)
        if objective == "trace":
            return np.trace(covariance, axis1=-2, axis2=-1)
        variances, n = np.linalg.eigvalsh(covariance), covariance.shape[-1]
        present = variances > NONE * variances[:, -1:]
        rank = np.where(present.all(axis=-1), n, len(chain.task))
        counted = np.arange(n) >= n - rank[:, None]
        still = ~np.any(v, axis=-1) & ~present[:, -1]
        lost = np.any(counted & ~present, axis=-1) & ~still
        counted &= present & ~still[:, None]
        logs = np.log(variances, out=np.zeros_like(variances), where=counted).sum(axis=-1)
        return np.where(lost, np.inf, logs)

    def cost(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        result, regular = np.full(len(q), np.inf), np.flatnonzero(~chain.singular(q))
        for first in range(0, len(regular), BLOCK):
            part = regular[first : first + BLOCK]
            result[part] = of_regular(q[part], v[part])
        return result

    return cost
