"""Points on the links of an arm in space, and the joint angles that bring them where they were
measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.arm.model import chain_of, link_chains
from pipeline.arm.serial import SerialChain
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from pipeline.core.options.motion_capture import Mocap

STEPS = 100  # at most; from a far start some twenty, from the frame before two or three
SETTLED = 1e-10  # rad, or m of a prismatic joint: the last step
# m a radian, or 1: a turn of the joints that moves all points together by less is not decided by
# them
LEAST_LEVER = 0.01
STARTS = 64  # postures from which one that fits is looked for
ALIKE = 0.05  # rad, or m: postures no farther apart are one
BODY = 6  # numbers that a rigid body's pose holds, however many points it carries


class Solution(NamedTuple):
    """Joint angles, and how the points fit them."""

    q: np.ndarray  # (n,) rad, or m
    square: float  # m², sum of squares of the distances
    distances: (
        np.ndarray
    )  # (P,) m, of the points from where the arm carries them; 0 of missing ones
    seen: np.ndarray  # (P,) whether a point was used
    normal: np.ndarray  # (n, n) JᵀJ of the points
    decided: bool  # whether the points decide every joint

    @property
    def residual(self) -> float:
        """m, rms distance of the points."""
        return float(np.sqrt(self.square / max(self.seen.sum(), 1)))


@dataclass(frozen=True)
class Carried:
    """P points on L links of an arm of n joints."""

    chains: list[SerialChain]  # (L,) to each link, its task the whole pose in m and rad
    sliding: np.ndarray  # (n,) whether a joint is prismatic
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite where a joint has none
    upper: np.ndarray  # (n,)
    owner: np.ndarray  # (P,) the link of each point
    places: np.ndarray  # (P, 3) m, in the link's frame
    bodies: np.ndarray  # (L,) whether a link's points are those that a rigid body carries
    posture: np.ndarray | None  # (n,) about where a take starts

    def solve(self, measured: np.ndarray, start: np.ndarray) -> Solution:
        """Return the joint angles near ``start`` (n,) for the points ``measured`` (P, 3) in m in
        the base frame, NaN where missing.
        """
        return self.solve_all(measured[None], np.asarray(start, dtype=float)[None])[0]

    def solve_all(self, measured: np.ndarray, starts: np.ndarray) -> list[Solution]:
        """Return the joint angles of least sum of squares near each of the ``starts`` (S, n), for
        the points ``measured`` (S, P, 3) of each, by Levenberg and Marquardt.

        A step comes from the eigenvalues of JᵀJ, J (3P, n) the points' derivatives: along
        directions that the points do not decide the angles stay about where they were.
        """
        q, seen = np.array(starts, dtype=float), ~np.isnan(measured[..., 0])
        normal, gradient, distances = self._equations(q, measured)
        damping, moving = np.zeros(len(q)), np.ones(len(q), bool)
        for _ in range(STEPS):
            values, vectors = np.linalg.eigh(normal)
            along = np.matvec(np.swapaxes(vectors, -1, -2), gradient)
            along /= np.maximum(values, LEAST_LEVER**2) + damping[:, None]
            step = np.matvec(vectors, along)
            moving &= np.abs(step).max(axis=1) >= SETTLED
            if not moving.any():
                break
            further, next_gradient, next_distances = self._equations(q + step, measured)
            lower = (next_distances**2).sum(axis=1) <= (distances**2).sum(axis=1)
            better, worse = moving & lower, moving & ~lower
            q[better] += step[better]
            normal[better], gradient[better] = further[better], next_gradient[better]
            distances[better] = next_distances[better]
            greatest = values[:, -1]
            less = np.where(damping > 1e-9 * greatest, 0.1 * damping, 0.0)
            more = np.maximum(10.0 * damping, 1e-3 * greatest)
            damping = np.where(better, less, np.where(worse, more, damping))
        least = np.linalg.eigvalsh(normal)[:, 0]
        return [
            Solution(*each, decided=bool(value >= LEAST_LEVER**2))
            for *each, value in zip(
                q, (distances**2).sum(axis=1), distances, seen, normal, least, strict=True
            )
        ]

    def _equations(
        self, q: np.ndarray, measured: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return JᵀJ (S, n, n), Jᵀr (S, n) and |r| (S, P) in m of the ways r from the points at
        ``q`` (S, n) to ``measured`` (S, P, 3); missing points count for nothing.
        """
        starts, n = q.shape
        normal, gradient = np.zeros((starts, n, n)), np.zeros((starts, n))
        distances = np.zeros(measured.shape[:2])
        for link, chain in enumerate(self.chains):
            mine, m = self.owner == link, len(chain.lower)
            pose, jacobian = chain.pose(q[:, :m]), chain.jacobian(q[:, :m])
            lever = self.places[mine] @ np.swapaxes(pose[:, 3:].reshape(-1, 3, 3), -1, -2)
            way = measured[:, mine] - pose[:, None, :3] - lever
            seen = ~np.isnan(way[..., :1])
            way = np.where(seen, way, 0.0)
            # (S, points, 3, m): v + ω × lever of each joint
            (wx, wy, wz), (x, y, z) = (
                jacobian[:, 3:, None].swapaxes(0, 1),
                lever.T[..., None].swapaxes(1, 2),
            )
            turning = np.stack([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x], axis=2)
            moved = (jacobian[:, None, :3] + turning) * seen[..., None]
            moved = moved.reshape(starts, -1, m)
            normal[:, :m, :m] += np.swapaxes(moved, -1, -2) @ moved
            gradient[:, :m] += np.vecmat(way.reshape(starts, -1), moved)
            distances[:, mine] = np.linalg.norm(way, axis=-1)
        return normal, gradient, distances

    def postures(self, measured: np.ndarray, gate: float) -> list[Solution]:
        """The postures within the joint limits at which every point of ``measured`` (P, 3) lies
        within ``gate`` (m) of where the arm carries it: as far as starts all over the limits find
        them, or the one about the posture that is asked for.

        Of angles that differ by whole turns, those nearest to the posture asked for, or to the
        middle of the limits.
        """
        from scipy.stats import qmc

        finite = np.isfinite(self.upper - self.lower)
        centre = np.where(finite, np.where(finite, self.lower + self.upper, 0.0) / 2, 0.0)
        if self.posture is None:
            reach = np.minimum(np.where(finite, self.upper - centre, np.pi), np.pi)
            shares = qmc.Sobol(len(centre), scramble=False).fast_forward(1).random(STARTS)
            starts = centre + (2 * shares - 1) * reach
        else:
            centre, starts = self.posture, [self.posture]
        result: list[Solution] = []
        points = np.broadcast_to(measured, (len(starts), *measured.shape))
        for solution in self.solve_all(points, np.array(starts)):
            if solution.distances.max() > gate:
                continue
            turns = np.round((solution.q - centre) / (2 * np.pi))
            q = solution.q - 2 * np.pi * np.where(self.sliding, 0.0, turns)
            inside = (q >= self.lower - ALIKE) & (q <= self.upper + ALIKE)
            if inside.all() and all(np.abs(q - other.q).max() > ALIKE for other in result):
                result.append(solution._replace(q=q))
        return result

    def without_a_link(
        self, measured: np.ndarray, start: np.ndarray, gate: float
    ) -> Solution | None:
        """The best of the solutions near ``start`` (n,) that leave out one link's points and have
        every other within ``gate`` (m); None where there is none, or it does not decide the joints.
        """
        solutions = [
            self.solve(np.where((self.owner == link)[:, None], np.nan, measured), start)
            for link in np.unique(self.owner[~np.isnan(measured[:, 0])])
        ]
        fitting = [one for one in solutions if one.decided and one.distances.max() <= gate]
        return min(fitting, key=lambda one: one.residual, default=None)

    def errors(self, solution: Solution) -> np.ndarray:
        """(n,) standard errors of the joint angles by JᵀJ and the residuals; NaN where the points
        hold no more numbers than there are joints.
        """
        owners = self.owner[solution.seen]
        held = sum(
            min(BODY, 3 * number) if self.bodies[link] else 3 * number
            for link, number in zip(*np.unique(owners, return_counts=True), strict=True)
        )
        free = held - len(solution.q)
        if free <= 0:
            return np.full(len(solution.q), np.nan)
        return np.sqrt(solution.square / free * np.diag(np.linalg.inv(solution.normal)))


def carried(robot: Robot, mocap: Mocap) -> Carried:
    """The points of ``mocap`` on the links of ``robot``; raises ConfigError for links that it does
    not have or does not move, and for one without points.
    """
    key = "dataset.mocap.markers"
    chain, chains = chain_of(robot), link_chains(robot, mocap.markers, key)
    places = {link: np.array([*m.values()], dtype=float) for link, m in mocap.markers.items()}
    for link, points in places.items():
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise ConfigError(f"{link} needs markers, each with its place x, y, z", key=key)
    posture = None if mocap.posture is None else np.array(mocap.posture)
    if posture is not None and len(posture) != len(chain.lower):
        message = f"{len(posture)} angles for an arm of {len(chain.lower)} joints"
        raise ConfigError(message, key="dataset.mocap.posture")
    return Carried(
        chains=list(chains.values()),
        sliding=np.asarray(chain.sliding, dtype=bool),
        lower=chain.lower,
        upper=chain.upper,
        owner=np.repeat(np.arange(len(places)), [len(points) for points in places.values()]),
        places=np.concatenate([*places.values()]),
        bodies=np.array([link in mocap.bodies for link in places]),
        posture=posture,
    )
