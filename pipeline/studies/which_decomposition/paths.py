"""Random paths of the paper's arm: the prior of the study.

Three kinds have equal weight: lines in the joints, lines in the task (x, z, φ), and ellipses in the
joints or the task through the start. A line is one way or there and back with equal probability.
The start is uniform within the joint limits, the direction isotropic in the joints' speeds; the
fastest joint has the drawn peak speed. A path is feasible if every pose is within the joint limits
and has ‖J⁻¹‖_F < û. Neither collisions nor the models of the noise select paths.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.models.model import frobenius

KINDS = ("joint line", "task line", "loop")
BATCH = 2000  # candidates that are drawn at once
COARSE = 8  # steps between two poses of the first, coarse check
SCALINGS = 6  # fixed-point steps that give a path of the task its peak speed
SPEED_TOLERANCE = 0.02  # relative, of the peak speed of a path of the task


@dataclass(frozen=True)
class TimeLaw:
    """Timing of a motion: rest, linear ramp, constant speed, linear ramp, rest; ranges are uniform.

    A motion there and back takes half the time each way. ``once`` is the motion's share of the
    duration: below 1 the motion is faster and is repeated, with equal means over the steps.
    """

    steps: int
    rate: float  # steps a second
    rest: tuple[float, float]  # s
    ramp: tuple[float, float]  # s
    peak: tuple[float, float]  # of the fastest joint, as a share of its speed limit
    once: tuple[float, float] = (1.0, 1.0)

    def draw(self, back: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return the completed share (P, steps+1) of each path; ``back`` (P,) marks returns."""
        column, duration = back[:, None], self.steps / self.rate
        time = np.arange(self.steps + 1) / self.rate
        time = np.where(column, np.minimum(time, duration - time), time)
        rest = rng.uniform(*self.rest, column.shape)
        moving = np.where(column, duration / 2, duration) - 2 * rest
        ramp = rng.uniform(*self.ramp, column.shape) / moving
        place = np.clip((time - rest) / moving, 0.0, 1.0)
        from_end = np.minimum(place, 1 - place)
        share = np.maximum(ramp, np.finfo(float).tiny)
        done = np.where(from_end < ramp, from_end**2 / (2 * share), from_end - ramp / 2)
        done = done / (1 - ramp)
        return np.where(place < 0.5, done, 1 - done)


class Paths(NamedTuple):
    """P feasible paths of K steps."""

    q: np.ndarray  # (P, K, n) rad, at the start of every step
    step: np.ndarray  # (P, K, n) rad


def draw_paths(
    chain: PlanarChain,
    law: TimeLaw,
    kind: str,
    bound: float,
    count: int,
    rng: np.random.Generator,
) -> Paths:
    """Return ``count`` random feasible paths of a ``kind``; ``bound`` û on ‖J⁻¹‖_F (1/m and 1)."""
    parts: list[Paths] = []
    while sum(len(part.q) for part in parts) < count:
        parts.append(_feasible_paths(chain, law, kind, bound, rng))
    return Paths(
        *(np.concatenate(column)[:count] for column in zip(*parts, strict=True))
    )


def _feasible_paths(
    chain: PlanarChain, law: TimeLaw, kind: str, bound: float, rng: np.random.Generator
) -> Paths:
    """Draw BATCH paths start + size·shape, in the joints or the task; return feasible ones."""
    q = rng.uniform(chain.lower, chain.upper, (BATCH, 3))
    q = q[~chain.singular(q)]
    q = q[frobenius(chain.inverse_jacobian(q)) < bound]
    count = len(q)
    # direction, and the ellipse's other axis
    first, other = rng.standard_normal((2, count, 3))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    other -= np.vecdot(other, first)[:, None] * first
    other *= (rng.uniform(0, 1, count) / np.linalg.norm(other, axis=1))[:, None]
    axes = np.stack([first, other], axis=1) * chain.max_speed
    coin, loop = rng.uniform(size=count) < 0.5, kind == "loop"
    task = coin if loop else np.full(count, kind == "task line")
    axes[task] = np.einsum("pij,psj->psi", chain.jacobian(q)[task], axes[task])
    start = np.where(task[:, None], chain.coordinates(q), q)
    elbow = np.sign(np.linalg.det(chain.jacobian(q)))
    share = law.draw(coin & (not loop), rng)
    once = rng.uniform(*law.once, count)
    peak, size = once * rng.uniform(*law.peak, count), np.ones(count)

    def angles(chosen: np.ndarray, stride: int) -> tuple[np.ndarray, np.ndarray]:
        """Return (C, L, 3) rad at every ``stride``-th pose of the paths ``chosen`` (C,), and the
        greatest speed of a joint (C,) as a share of its limit.
        """
        shape, of_task = share[chosen, ::stride, None], task[chosen]
        along, across = np.moveaxis(axes[chosen, None], 2, 0)
        turn = 2 * np.pi * shape
        ellipse = (np.sin(turn) * along + (1 - np.cos(turn)) * across) / (2 * np.pi)
        q = start[chosen, None] + size[chosen, None, None] * (
            ellipse if loop else shape * along
        )
        if np.any(of_task):
            q[of_task] = joint_angles(chain, q[of_task], elbow[chosen][of_task, None])
        speed = (np.abs(np.diff(q, axis=1)) / chain.max_speed).max(axis=(1, 2))
        return q, speed * law.rate / stride

    chosen = np.arange(count)
    for _ in range(SCALINGS if task.any() else 1):
        ratio = peak / angles(chosen, COARSE)[1]
        size *= np.where(
            np.isfinite(ratio), ratio, 0.5
        )  # shorter if it leaves the reach
    for stride in (COARSE, 1):
        q, speed = angles(chosen, stride)
        kept = chain.within_limits(q).all(axis=1) & ~chain.singular(q).any(axis=1)
        kept &= np.abs(speed / peak[chosen] - 1) < SPEED_TOLERANCE * (
            5 if stride > 1 else 1
        )
        chosen, q = chosen[kept], q[kept]
        kept = (frobenius(chain.inverse_jacobian(q)) < bound).all(axis=1)
        chosen, q = chosen[kept], q[kept]
    return Paths(q[:, :-1], np.diff(q, axis=1) / once[chosen, None, None])


def joint_angles(chain: PlanarChain, pose: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """Return the angles (..., 3) in rad for the tip ``pose`` (..., 3) = (x, z, φ), NaN out of
    reach; ``elbow`` (...), the sign of det J, selects one of the two solutions.
    """
    first, second, tool = chain.lengths
    heading = np.arctan2(chain.links[2, 0], chain.links[2, 1]) + pose[..., 2]
    wrist = pose[..., :2] - chain.origin
    wrist = wrist - tool * np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    square = np.vecdot(wrist, wrist)
    with np.errstate(invalid="ignore"):
        bend = np.arccos((square - first**2 - second**2) / (2 * first * second))
    bend = -np.prod(chain.signs) * elbow * bend
    upper = np.arctan2(wrist[..., 0], wrist[..., 1])
    upper = upper - np.arctan2(second * np.sin(bend), first + second * np.cos(bend))
    return chain.joints_from_segments(np.stack([upper, upper + bend, heading], axis=-1))
