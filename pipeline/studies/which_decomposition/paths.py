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
        returns = back[:, None]
        duration = self.steps / self.rate
        elapsed = np.arange(self.steps + 1) / self.rate
        from_nearer_end = np.minimum(elapsed, duration - elapsed)
        time = np.where(returns, from_nearer_end, elapsed)
        rest = rng.uniform(*self.rest, returns.shape)
        one_way = np.where(returns, duration / 2, duration)
        moving = one_way - 2 * rest
        ramp = rng.uniform(*self.ramp, returns.shape) / moving
        place = np.clip((time - rest) / moving, 0.0, 1.0)
        # the completed share from the nearer end: parabola in the ramp, then a line
        from_end = np.minimum(place, 1 - place)
        divisor = 2 * np.maximum(ramp, np.finfo(float).tiny)
        in_ramp = from_end**2 / divisor
        at_full_speed = from_end - ramp / 2
        done = np.where(from_end < ramp, in_ramp, at_full_speed)
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
    q = []
    steps = []
    while sum(map(len, q)) < count:
        feasible = _feasible_paths(chain, law, kind, bound, rng)
        q.append(feasible.q)
        steps.append(feasible.step)
    return Paths(np.concatenate(q)[:count], np.concatenate(steps)[:count])


@dataclass
class Candidates:
    """C paths start + size·shape, a line or a loop, in the joints or the task."""

    chain: PlanarChain
    loop: bool
    start: np.ndarray  # (C, 3) joint angles in rad, or task coordinates
    axes: np.ndarray  # (C, 2, 3) direction, and the ellipse's other axis
    in_task: np.ndarray  # (C,) True for a path of the task
    elbow: np.ndarray  # (C,) sign of det J
    share: np.ndarray  # (C, steps+1) of the path that is completed at each pose
    rate: float  # poses a second
    size: np.ndarray  # (C,)

    def angles(self, chosen: np.ndarray, stride: int) -> np.ndarray:
        """Return the joint angles (c, L, 3) in rad of the paths ``chosen`` (c,) at every
        ``stride``-th pose, NaN out of reach.
        """
        share = self.share[chosen, ::stride, None]
        along = self.axes[chosen, None, 0]
        across = self.axes[chosen, None, 1]
        shape = share * along
        if self.loop:
            turn = 2 * np.pi * share
            ellipse = np.sin(turn) * along + (1 - np.cos(turn)) * across
            shape = ellipse / (2 * np.pi)
        size = self.size[chosen, None, None]
        q = self.start[chosen, None] + size * shape
        in_task = self.in_task[chosen]
        if np.any(in_task):
            elbow = self.elbow[chosen][in_task, None]
            q[in_task] = joint_angles(self.chain, q[in_task], elbow)
        return q

    def peak_speed(self, q: np.ndarray, stride: int) -> np.ndarray:
        """Return the greatest speed of a joint (c,) as a share of its limit on :meth:`angles`."""
        relative = np.abs(np.diff(q, axis=1)) / self.chain.max_speed
        return relative.max(axis=(1, 2)) * self.rate / stride


def _feasible_paths(
    chain: PlanarChain,
    law: TimeLaw,
    kind: str,
    bound: float,
    rng: np.random.Generator,
) -> Paths:
    """Draw BATCH candidates and return the feasible ones."""
    q = rng.uniform(chain.lower, chain.upper, (BATCH, 3))
    q = q[~chain.singular(q)]
    q = q[frobenius(chain.inverse_jacobian(q)) < bound]
    count = len(q)
    jacobian = chain.jacobian(q)
    axes = _random_axes(count, rng) * chain.max_speed
    coin = rng.uniform(size=count) < 0.5
    loop = kind == "loop"
    in_task = coin if loop else np.full(count, kind == "task line")
    axes[in_task] = np.einsum("pij,psj->psi", jacobian[in_task], axes[in_task])
    start = np.where(in_task[:, None], chain.coordinates(q), q)
    elbow = np.sign(np.linalg.det(jacobian))
    share = law.draw(coin & (not loop), rng)
    once = rng.uniform(*law.once, count)
    peak = once * rng.uniform(*law.peak, count)
    size = np.ones(count)
    candidates = Candidates(
        chain,
        loop,
        start,
        axes,
        in_task,
        elbow,
        share,
        law.rate,
        size,
    )

    chosen = np.arange(count)
    for _ in range(SCALINGS if in_task.any() else 1):
        q = candidates.angles(chosen, COARSE)
        ratio = peak / candidates.peak_speed(q, COARSE)
        # shorter if it leaves the reach
        candidates.size *= np.where(np.isfinite(ratio), ratio, 0.5)

    for stride, tolerance in ((COARSE, 5 * SPEED_TOLERANCE), (1, SPEED_TOLERANCE)):
        q = candidates.angles(chosen, stride)
        speed = candidates.peak_speed(q, stride)
        within = chain.within_limits(q).all(axis=1)
        within &= ~chain.singular(q).any(axis=1)
        within &= np.abs(speed / peak[chosen] - 1) < tolerance
        chosen = chosen[within]
        q = q[within]
        bounded = (frobenius(chain.inverse_jacobian(q)) < bound).all(axis=1)
        chosen = chosen[bounded]
        q = q[bounded]
    return Paths(q[:, :-1], np.diff(q, axis=1) / once[chosen, None, None])


def _random_axes(count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw isotropic directions of length 1, each with an axis across of uniform length below 1:
    (count, 2, 3).
    """
    along, across = rng.standard_normal((2, count, 3))
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along /= length
    parallel = np.vecdot(across, along)
    across -= parallel[:, None] * along
    length = np.linalg.norm(across, axis=1)
    scale = rng.uniform(0, 1, count) / length
    across *= scale[:, None]
    return np.stack([along, across], axis=1)


def joint_angles(chain: PlanarChain, pose: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """Return the angles (..., 3) in rad for the tip ``pose`` (..., 3) = (x, z, φ), NaN out of
    reach; ``elbow`` (...), the sign of det J, selects one of the two solutions.
    """
    first, second, tool = chain.lengths
    tool_x, tool_z = chain.links[2]
    heading = np.arctan2(tool_x, tool_z) + pose[..., 2]
    direction = np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    tip = pose[..., :2] - chain.origin
    wrist = tip - tool * direction
    # law of cosines
    square = np.vecdot(wrist, wrist)
    cosine = (square - first**2 - second**2) / (2 * first * second)
    with np.errstate(invalid="ignore"):
        angle = np.arccos(cosine)
    side = -np.prod(chain.signs) * elbow
    bend = side * angle
    across = second * np.sin(bend)
    along = first + second * np.cos(bend)
    to_wrist = np.arctan2(wrist[..., 0], wrist[..., 1])
    upper = to_wrist - np.arctan2(across, along)
    segments = np.stack([upper, upper + bend, heading], axis=-1)
    return chain.joints_from_segments(segments)
