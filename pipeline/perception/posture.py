"""Least-squares posture of any chain: joint angles at which its points lie as measured."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.arm.chain import segment_frames
from pipeline.arm.model import Arm, chain_of, link_chains
from pipeline.arm.serial import SerialChain
from pipeline.core.columns import SPACE
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Mocap, Robot

STEPS = 100  # at most; from a far start some twenty, from the frame before two or three
SETTLED = 1e-10  # rad, or m of a prismatic joint: the last step
# m a radian, or 1: a turn of the joints that moves all points together by less is not decided by
# them
LEAST_LEVER = 0.01
STARTS = 64  # postures from which one that fits is looked for
ALIKE = 0.05  # rad, or m: postures no farther apart are one
MIN_LEVER = 0.01  # m; two markers of a planar arm's link are at least so far apart in its plane


class Solution(NamedTuple):
    """Joint angles, and how the points fit them; of a batch each array has the batch first."""

    q: np.ndarray  # (n,) rad, or m
    distances: np.ndarray  # (P,) m, from the points where the arm carries them; 0 of missing ones
    residual: np.ndarray  # m, rms distance of the points that are not missing
    normal: np.ndarray  # (n, n) JᵀJ of the points
    decided: np.ndarray  # whether the points decide every joint


@dataclass(frozen=True)
class Carried:
    """P points on L links of an arm of n joints."""

    chains: list[SerialChain]  # (L,) to each link, its task the whole pose in m and rad
    sliding: np.ndarray  # (n,) whether a joint is prismatic
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite where a joint has none
    upper: np.ndarray  # (n,)
    owner: np.ndarray  # (P,) the link of each point
    places: np.ndarray  # (P, 3) m, in the link's frame
    gate: float  # m, beyond which no point is from its measured place
    posture: np.ndarray | None = None  # (n,) about where a take starts
    joints: tuple[str, ...] = ()  # names of the n joints of an arm in space
    arm: Arm | None = None  # of a planar arm

    def of_links(self) -> list[np.ndarray]:
        """Return the mask (P,) of the points of each link."""
        return [self.owner == link for link in range(len(self.chains))]

    def carry(self, q: np.ndarray) -> np.ndarray:
        """Return where the arm at ``q`` (S, n) carries the points, (S, P, 3) m in the base."""
        result = np.empty((len(q), *self.places.shape))
        for link, mine in enumerate(self.of_links()):
            position, lever = self._levers(link, q)
            result[:, mine] = position[:, None] + lever
        return result

    def _levers(self, link: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (S, 3) of a link and its points relative to it (S, points, 3), m."""
        pose = self.chains[link].pose(q[:, : len(self.chains[link].lower)])
        turn = np.swapaxes(pose[:, 3:].reshape(-1, 3, 3), -1, -2)
        return pose[:, :3], self.places[self.owner == link] @ turn

    def fit(self, measured: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return joint angles (S, n) and residuals (S,), NaN where none is within the gate."""
        solution = self.solve_all(measured, starts)
        fits = solution.decided & (solution.distances <= self.gate).all(axis=-1)
        return solution.q, np.where(fits, solution.residual, np.nan)

    def solve_all(self, measured: np.ndarray, starts: np.ndarray) -> Solution:
        """Return the joint angles of least squares near each of the ``starts`` (S, n) for
        ``measured`` (S, P, 3) by Levenberg and Marquardt, with steps from the eigenvalues of JᵀJ:
        along directions that the points do not decide the angles stay about where they were.
        """
        q = np.array(starts, dtype=float)
        normal, gradient, distances = self._equations(q, measured)
        damping, moving = np.zeros(len(q)), np.arange(len(q))
        for _ in range(STEPS):
            values, vectors = np.linalg.eigh(normal[moving])
            along = np.matvec(np.swapaxes(vectors, -1, -2), gradient[moving])
            along /= np.maximum(values, LEAST_LEVER**2) + damping[moving, None]
            step = np.matvec(vectors, along)
            far = np.abs(step).max(axis=1) >= SETTLED
            moving, step, greatest = moving[far], step[far], values[far, -1]
            if not len(moving):
                break
            equations = self._equations(q[moving] + step, measured[moving])
            better = (equations[2] ** 2).sum(axis=1) <= (distances[moving] ** 2).sum(axis=1)
            taken, now = moving[better], damping[moving]
            q[taken] += step[better]
            for kept, new in zip((normal, gradient, distances), equations, strict=True):
                kept[taken] = new[better]
            less = np.where(now > 1e-9 * greatest, 0.1 * now, 0.0)
            damping[moving] = np.where(better, less, np.maximum(10.0 * now, 1e-3 * greatest))
        decided = np.linalg.eigvalsh(normal)[:, 0] >= LEAST_LEVER**2
        number = np.maximum((~np.isnan(measured[..., 0])).sum(axis=-1), 1)
        residual = np.sqrt((distances**2).sum(axis=-1) / number)
        return Solution(q, distances, residual, normal, decided)

    def _equations(self, q: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, ...]:
        """JᵀJ (S, n, n), Jᵀr (S, n) and |r| (S, P) in m of the ways r to ``measured`` (S, P, 3)."""
        starts, n = q.shape
        normal, gradient = np.zeros((starts, n, n)), np.zeros((starts, n))
        distances = np.zeros(measured.shape[:2])
        for link, mine in enumerate(self.of_links()):
            m = len(self.chains[link].lower)
            position, lever = self._levers(link, q)
            jacobian = self.chains[link].jacobian(q[:, :m])
            way = measured[:, mine] - position[:, None] - lever
            seen = ~np.isnan(way[..., :1])
            way = np.where(seen, way, 0.0)
            # (S, points, 3, m): v + ω × lever of each joint
            wx, wy, wz = jacobian[:, 3:, None].swapaxes(0, 1)
            x, y, z = lever.T[..., None].swapaxes(1, 2)
            turning = np.stack([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x], axis=2)
            moved = (jacobian[:, None, :3] + turning) * seen[..., None]
            moved = moved.reshape(starts, -1, m)
            normal[:, :m, :m] += np.swapaxes(moved, -1, -2) @ moved
            gradient[:, :m] += np.vecmat(way.reshape(starts, -1), moved)
            distances[:, mine] = np.linalg.norm(way, axis=-1)
        return normal, gradient, distances

    def postures(self, measured: np.ndarray) -> list[Solution]:
        """Return the postures within the joint limits at which every point of ``measured`` (P, 3)
        is within the gate: as far as starts all over the limits find them, or about the stated
        one; of whole turns the nearest to it or to mid-range.
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
        points, result = np.broadcast_to(measured, (len(starts), *measured.shape)), []
        solutions = self.solve_all(points, np.array(starts))
        for one in (Solution(*each) for each in zip(*solutions, strict=True)):
            turns = np.round((one.q - centre) / (2 * np.pi))
            q = one.q - 2 * np.pi * np.where(self.sliding, 0.0, turns)
            fits = one.distances.max() <= self.gate
            fits &= np.all((q >= self.lower - ALIKE) & (q <= self.upper + ALIKE))
            if fits and all(np.abs(q - other.q).max() > ALIKE for other in result):
                result.append(one._replace(q=q))
        return result


def points_in_space(robot: Robot, mocap: Mocap) -> Carried:
    """Return the points of ``mocap`` on the links of ``robot``; ConfigError for links that it does
    not have or move, or without points, and for a posture of another number of joints.
    """
    key = "dataset.mocap.markers"
    chain, chains = chain_of(robot), link_chains(robot, mocap.markers, key)
    places = [np.array([*own.values()], dtype=float) for own in mocap.markers.values()]
    for link, own in zip(mocap.markers, places, strict=True):
        if own.ndim != 2:
            raise ConfigError(f"{link} needs markers, each with its place x, y, z", key=key)
    posture = None if mocap.posture is None else np.array(mocap.posture)
    if posture is not None and len(posture) != len(chain.lower):
        message = f"{len(posture)} angles for an arm of {len(chain.lower)} joints"
        raise ConfigError(message, key="dataset.mocap.posture")
    owner = np.repeat(np.arange(len(places)), [len(own) for own in places])
    limits = np.asarray(chain.sliding, bool), chain.lower, chain.upper
    points = owner, np.concatenate(places), mocap.gate, posture, tuple(robot.joints)
    return Carried([*chains.values()], *limits, *points)


def points_in_plane(arm: Arm, template: np.ndarray, gate: float) -> Carried:
    """Return points at ``template`` (3, 3, 3) m in the segments' frames; ConfigError for a line."""
    key = "dataset.mocap.markers"
    if np.shape(template) != (3, 3, 3):
        message = "a planar arm needs three markers, each with its place x, y, z, on each of its"
        raise ConfigError(f"{message} three segments", key=key, shape=np.shape(template))
    for link, corners in enumerate(template, start=1):
        spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)[1]
        sides = np.linalg.norm((corners - np.roll(corners, 1, axis=0))[:, [0, 2]], axis=1)
        if spread < MIN_LEVER / 2 or sides.min() < MIN_LEVER:
            message = "the markers of a link are in line, or two of them are too close in the plane"
            raise ConfigError(f"{message} of the arm", key=key, link=link)
    chain, links = arm.chain, len(template)
    # the frame of a joint that turns about ± the plane's normal y: z along its axis, x the plane's
    frames = np.array([[[1.0, 0, 0], [0, 0, sign], [0, -sign, 0]] for sign in chain.signs])
    ends = np.swapaxes(frames, -1, -2) @ segment_frames(chain, np.zeros(links))[0]
    origin = arm.to_base(np.array([chain.origin[0], 0.0, chain.origin[1]]))
    placements, chains = [np.append(arm.rotation @ frames[0], origin)], []
    none, limits = np.zeros(links, dtype=bool), (chain.lower, chain.upper, chain.max_speed)
    for j in range(links):
        to_link = np.array([*placements, np.append(ends[j], np.zeros(3))])
        own = (each[: j + 1] for each in (none, *limits))
        chains.append(SerialChain(SPACE, 1.0, to_link, *own))
        if j + 1 < links:
            step = frames[j].T @ [chain.links[j, 0], 0.0, chain.links[j, 1]]
            placements.append(np.append(frames[j].T @ frames[j + 1], step))
    owner, places = np.repeat(np.arange(links), 3), template.reshape(-1, 3)
    return Carried(chains, none, chain.lower, chain.upper, owner, places, gate, arm=arm)
