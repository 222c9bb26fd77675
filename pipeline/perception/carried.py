"""Points on the links of an arm in space, and the joint angles that bring them where they were
measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.arm.model import chain_of, link_chains
from pipeline.arm.numbers import Arm
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from pipeline.core.options.motion_capture import Mocap
from pipeline.perception.least_squares import LEAST_LEVER, solve

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

    arm: Arm
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite where a joint has none
    upper: np.ndarray  # (n,)
    links: np.ndarray  # (L, n + 2, 6) frames of the chain to each link
    joints: np.ndarray  # (L,) how many joints move it
    owner: np.ndarray  # (P,) the link of each point
    places: np.ndarray  # (P, 3) m, in the link's frame
    bodies: np.ndarray  # (L,) whether a link's points are those that a rigid body carries
    posture: np.ndarray | None  # (n,) about where a take starts

    def solve(self, measured: np.ndarray, start: np.ndarray) -> Solution:
        """The joint angles near ``start`` (n,) for the points ``measured`` (P, 3) in m in the base
        frame, NaN where missing.
        """
        n, points = len(start), np.array(measured, dtype=float, order="C")
        q, normal, distances = start.copy(), np.empty((n, n)), np.empty(len(points))
        layout = (self.arm, self.links, self.joints, self.owner, self.places)
        square = solve(*layout, points, q, normal, distances)
        least = np.linalg.eigvalsh(normal)[0]
        seen = ~np.isnan(points[:, 0])
        return Solution(q, square, distances, seen, normal, bool(least >= LEAST_LEVER**2))

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
        for start in starts:
            solution = self.solve(measured, start)
            if solution.distances.max() > gate:
                continue
            turns = np.round((solution.q - centre) / (2 * np.pi))
            q = solution.q - 2 * np.pi * np.where(self.arm.sliding > 0, 0.0, turns)
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
    links = np.zeros((len(chains), len(chain.lower) + 2, 6))
    for link, part in zip(links, chains.values(), strict=True):
        frames = part.numbers().frames
        link[: len(frames)] = frames
    return Carried(
        arm=chain.numbers(),
        lower=chain.lower,
        upper=chain.upper,
        links=links,
        joints=np.array([len(part.lower) for part in chains.values()]),
        owner=np.repeat(np.arange(len(places)), [len(points) for points in places.values()]),
        places=np.concatenate([*places.values()]),
        bodies=np.array([link in mocap.bodies for link in places]),
        posture=posture,
    )
