"""What is planned: a task path that the tip follows step by step, and what its joints must keep."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.models.model import frobenius

REACHED = 1e-9  # of a displacement from the path, in m: beyond it a pose is not on it
ROUND = 1e-9  # of the poses a turn apart, in m and rad: within it they are one


class InfeasibleError(PipelineError):
    """A path that no motion follows within what was asked; ``step`` is the first at which it
    fails.
    """


@dataclass(frozen=True, eq=False)
class Problem:
    """A path of M steps for an arm of n joints and m ≤ n task rows.

    The limits of the joints, in rad and rad/s, are those of the chain. Raises ConfigError for a
    path of fewer than two poses or one that is not finite, and for numbers out of range.
    """

    chain: Chain
    path: np.ndarray  # (M+1, p) poses x_k, as ``chain.pose`` gives them
    rate: float  # steps a second
    # that the least singular value of J stays at or above, in m: that of ``chain.jacobian``, whose
    # angular rows are multiplied by the task's characteristic length (1 m in a plane)
    margin: float
    smoothness: float  # weight of a squared null-space step, in units of the cost for a rad²

    def __post_init__(self) -> None:
        if np.ndim(self.path) != 2 or len(self.path) < 2 or not np.isfinite(self.path).all():
            raise ConfigError("a path needs two finite poses at least", key="path")
        for key, least in (("rate", 0.0), ("margin", 0.0), ("smoothness", -1e-300)):
            value = getattr(self, key)
            if not least < value < np.inf:
                sign = "positive" if least == 0 else "not negative"
                raise ConfigError(f"{key} must be finite and {sign}, not {value}", key=key)

    @cached_property
    def steps(self) -> np.ndarray:
        """(M, m) the task steps v_k from x_k to x_{k+1}."""
        return self.chain.displacement(self.path[:-1], self.path[1:])

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
        """(n,) whether a whole turn of a joint leaves the pose of the tip as it is."""
        pose, turns = self.chain.pose, 2 * np.pi * np.eye(len(self.chain.lower))
        return np.all(np.abs(pose(turns) - pose(0 * turns)) < ROUND, axis=-1)

    def nearest_turns(self, q: np.ndarray) -> np.ndarray:
        """``q`` (..., n) in rad with whole turns taken off the joints that may have them, so that
        they are nearest to the middle of their limits.
        """
        lower, upper = self.chain.lower, self.chain.upper
        middle = np.where(np.isfinite(upper - lower), (lower + upper) / 2, 0.0)
        return middle + self.less_turns(q - middle)

    def less_turns(self, step: np.ndarray) -> np.ndarray:
        """The ``step`` (..., n) between two poses in rad, of half a turn at most where a joint
        comes round.
        """
        return step - 2 * np.pi * np.round(step / (2 * np.pi)) * self.comes_round

    def clearance(self, q: np.ndarray) -> np.ndarray:
        """(...,) least singular value of J at ``q`` (..., n) in m."""
        return np.linalg.svd(self.chain.jacobian(q), compute_uv=False)[..., -1]

    def clear(self, q: np.ndarray) -> np.ndarray:
        """(P,) whether ``q`` (P, n) keeps the margin.

        The least singular value is between 1 and sqrt(m) times 1/‖J⁺‖_F, which decides most poses.
        """
        result = ~self.chain.singular(q)
        regular = np.flatnonzero(result)
        bound = 1 / frobenius(self.chain.inverse_jacobian(q[regular]))
        result[regular] = bound * np.sqrt(len(self.chain.task)) >= self.margin
        open_ = regular[result[regular] & (bound < self.margin)]
        result[open_] = self.clearance(q[open_]) >= self.margin
        return result

    def failure(self, joints: np.ndarray) -> tuple[int, str] | None:
        """The first step at which the motion ``joints`` (M+1, n) in rad fails, and how; None where
        it keeps everything.
        """
        chain = self.chain
        off = chain.displacement(chain.pose(joints), self.path)
        speeding = np.any(np.abs(np.diff(joints, axis=0)) > self.reach * (1 + 1e-9), axis=-1)
        faults = {
            "the motion leaves the path": np.linalg.norm(off, axis=-1) > REACHED,
            "the motion leaves the joint limits": ~chain.within_limits(joints),
            "the motion comes nearer to a singular pose than the margin": ~self.clear(joints),
            "the motion is faster than the joints can be": np.r_[speeding, False],
        }
        first = {why: int(bad.argmax()) for why, bad in faults.items() if bad.any()}
        return min(((k, why) for why, k in first.items()), default=None)
