"""Planning problem: task path, joint limits, and the cost of a step (uncertainty under a motion
model). Newton's method for poses on the path.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray

from pipeline.arm.chain import Chain
from pipeline.core.errors import ConfigError, PipelineError, SingularJacobianError
from pipeline.models.model import MotionModel

PATH_TOLERANCE = 1e-9  # m, greatest displacement from the path of a pose on it
TOLERANCE = PATH_TOLERANCE / 100  # m, displacement at which Newton's method ends
TURN_TOLERANCE = (
    1e-9  # m and rad, greatest change of the tip by a whole turn of a joint
)
LONGEST_STEP = 0.5  # rad, longest step of Newton's method
BATCH_POSES = 1024  # poses whose matrices fit the processor's cache
ZERO_VARIANCE = (
    1e-12  # variance/greatest variance below which a variance counts as zero
)
TURN = 2 * np.pi

# cost (N,) of task steps ``v`` (N, m) at poses ``q`` (N, n) in rad, infinite at a forbidden pose
Cost = Callable[[ndarray, ndarray], ndarray]


class InfeasibleError(PipelineError):
    """Error: no motion follows the path within the limits; ``step`` is the first that fails."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A path of M steps for an arm of n joints and m ≤ n task rows, within the chain's limits.
    Raises ConfigError for a path of fewer than two finite poses and for numbers out of range.
    """

    chain: Chain
    path: ndarray  # (M+1, p) poses x_k, as returned by ``chain.pose``
    rate: float  # steps per second
    margin: float  # least value in m of ``chain.least_singular_value``
    smoothness: (
        float  # weight of a squared null-space step, in units of the cost per rad²
    )

    def __post_init__(self) -> None:
        if (
            np.ndim(self.path) != 2
            or len(self.path) < 2
            or not np.isfinite(self.path).all()
        ):
            raise ConfigError("a path needs at least two finite poses", key="path")
        for key, least in (("rate", 0.0), ("margin", 0.0), ("smoothness", -1e-300)):
            if not least < (value := getattr(self, key)) < np.inf:
                sign = "positive" if least == 0 else "not negative"
                raise ConfigError(
                    f"{key} must be finite and {sign}, not {value}", key=key
                )

    @cached_property
    def steps(self) -> ndarray:
        """(M, m) task steps v_k from x_k to x_{k+1}."""
        return self.chain.displacement(self.path[:-1], self.path[1:])

    def objective(self, costs: ndarray, joints: ndarray) -> float:
        """Σ cost + smoothness·Σ‖w_k‖² of ``joints`` (M+1, n), w_k a step's null-space part."""
        nominal = np.matvec(self.chain.inverse_jacobian(joints[:-1]), self.steps)
        w = np.diff(joints, axis=0) - nominal
        return float(costs.sum() + self.smoothness * np.sum(w**2))

    @property
    def reach(self) -> ndarray:
        """(n,) greatest step of each joint in rad at its speed limit."""
        return self.chain.max_speed / self.rate

    @property
    def spare(self) -> int:
        """Redundant degrees of freedom n − m."""
        return len(self.chain.lower) - len(self.chain.task)

    @cached_property
    def comes_round(self) -> ndarray:
        """(n,) True for a joint whose whole turn does not change the pose of the tip."""
        pose, turns = self.chain.pose, TURN * np.eye(len(self.chain.lower))
        return np.all(np.abs(pose(turns) - pose(0 * turns)) < TURN_TOLERANCE, axis=-1)

    @property
    def turning(self) -> ndarray:
        """(n,) True for a joint of :attr:`comes_round` with limits wider than a turn."""
        return self.comes_round & (self.chain.upper - self.chain.lower > TURN)

    def nearest_turns(self, q: ndarray) -> ndarray:
        """``q`` (..., n) in rad, shifted by whole turns to within half a turn of mid-range."""
        lower, upper = self.chain.lower, self.chain.upper
        middle = np.where(np.isfinite(upper - lower), (lower + upper) / 2, 0.0)
        return middle + self.less_turns(q - middle)

    def less_turns(self, step: ndarray) -> ndarray:
        """``step`` (..., n) in rad without whole turns of joints of :attr:`comes_round`."""
        return step - TURN * np.round(step / TURN) * self.comes_round

    def clear(self, q: ndarray) -> ndarray:
        """(P,) True for poses ``q`` (P, n) with a least singular value above the margin."""
        return ~self.chain.singular(q) & (
            self.chain.least_singular_value(q) >= self.margin
        )

    def failure(self, joints: ndarray) -> InfeasibleError | None:
        """First fault of the motion ``joints`` (M+1, n) in rad, with its step; else None."""
        chain = self.chain
        off = chain.displacement(chain.pose(joints), self.path)
        speeding = np.any(
            np.abs(np.diff(joints, axis=0)) > self.reach * (1 + 1e-9), axis=-1
        )
        faults = {
            "the motion leaves the path": length_of(off) > PATH_TOLERANCE,
            "the motion leaves the joint limits": ~chain.within_limits(joints),
            "the least singular value of the motion is below the margin": ~self.clear(
                joints
            ),
            "the motion exceeds the joints' speed limits": np.r_[speeding, False],
        }
        first = [(int(bad.argmax()), why) for why, bad in faults.items() if bad.any()]
        return InfeasibleError(min(first)[1], step=min(first)[0]) if first else None


def settle(
    chain: Chain, q: ndarray, target: ndarray, rounds: int
) -> tuple[ndarray, ndarray]:
    """Return the poses (P, n) in rad after at most ``rounds`` Newton steps J⁺(target − x) from
    ``q``, and (P,) True where they reach ``target`` (P, p). A singular pose is not moved.
    """
    q, reached = np.array(q, dtype=float), np.zeros(len(q), dtype=bool)
    lanes = np.arange(len(q))
    for left in range(rounds, -1, -1):
        off = chain.displacement(chain.pose(q[lanes]), target[lanes])
        far = ~(length_of(off) <= TOLERANCE)
        reached[lanes] = ~far
        lanes, off = lanes[far], off[far]
        if left == 0 or len(lanes) == 0:
            break
        try:
            inverse = chain.inverse_jacobian(q[lanes])
        except SingularJacobianError:
            regular = ~chain.singular(q[lanes])
            lanes, off = lanes[regular], off[regular]
            inverse = chain.inverse_jacobian(q[lanes])
        step = np.matvec(inverse, off)
        q[lanes] += (
            step * (LONGEST_STEP / np.maximum(length_of(step), LONGEST_STEP))[:, None]
        )
    return q, reached


def length_of(steps: ndarray) -> ndarray:
    """(...,) norms of ``steps`` (..., n)."""
    return np.sqrt(np.vecdot(steps, steps))


def uncertainty(model: MotionModel, chain: Chain, objective: str) -> Cost:
    """Return the cost function of a step under ``model``: tr Cov(q_{k+1} | q_k) in rad², or ln det
    Cov. The cost is infinite at a singular pose; ln det also if a moving step has no variance along
    an axis. A zero command without noise costs 0. Raises ModelDomainError as ``model.covariance``.

    If the covariance has the rank m of the task, e.g. under a matrix model with n > m, ln det uses
    the m variances in the row space of J, else all n.
    """

    def of_regular(q: ndarray, v: ndarray) -> ndarray:
        covariance = model.covariance(chain, q, v)
        if objective == "trace":
            return np.trace(covariance, axis1=-2, axis2=-1)
        variances, n = np.linalg.eigvalsh(covariance), covariance.shape[-1]
        present = variances > ZERO_VARIANCE * variances[:, -1:]
        rank = np.where(present.all(axis=-1), n, len(chain.task))
        counted = np.arange(n) >= n - rank[:, None]
        still = ~np.any(v, axis=-1) & ~present[:, -1]
        lost = np.any(counted & ~present, axis=-1) & ~still
        counted &= present & ~still[:, None]
        logs = np.log(variances, out=np.zeros_like(variances), where=counted).sum(
            axis=-1
        )
        return np.where(lost, np.inf, logs)

    def cost(q: ndarray, v: ndarray) -> ndarray:
        result, regular = np.full(len(q), np.inf), np.flatnonzero(~chain.singular(q))
        for first in range(0, len(regular), BATCH_POSES):
            part = regular[first : first + BATCH_POSES]
            result[part] = of_regular(q[part], v[part])
        return result

    return cost
