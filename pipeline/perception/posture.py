"""Least-squares joint angles of an arm from measured points on its links."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.arm.chain import SerialChain, joint_axes, segment_frames
from pipeline.arm.model import Arm, chain_of, link_chains
from pipeline.core.columns import SPACE
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Mocap, Robot

STEPS = 100  # greatest number; a far start needs about 20, the previous frame's posture 2 or 3
LEAST_STEP = 1e-10  # rad, or m of a prismatic joint; a smaller step ends the search
# m/rad, or 1; a joint motion that moves the points by less is undetermined
LEAST_LEVER = 0.01
STARTS = 64  # start postures of a search over the joint ranges
SAME_POSTURE = 0.05  # rad, or m; postures that differ by less count as one
# m; least distance in the plane between two markers of a planar arm's link
MIN_LEVER = 0.01


class Solution(NamedTuple):
    """Joint angles and their fit to the points; in a batch every array has one more first axis."""

    q: np.ndarray  # (n,) rad, or m
    # m, rms distance; NaN if undetermined or a point is beyond the gate
    residual: np.ndarray
    # (P,) m, from measured to modelled points; 0 for missing points
    distances: np.ndarray
    normal: np.ndarray  # (n, n) JᵀJ of the points
    decided: np.ndarray  # True if the points determine every joint


@dataclass(frozen=True)
class MarkedArm:
    """P points on L links of an arm of n joints."""

    # (L,) from the base to each link; task: whole pose in m and rad
    chains: list[SerialChain]
    sliding: np.ndarray  # (n,) True for prismatic joints
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite where a joint has none
    upper: np.ndarray  # (n,)
    owner: np.ndarray  # (P,) index of each point's link
    places: np.ndarray  # (P, 3) m, positions in the link's frame
    gate: float  # m, greatest distance of a point from its measured place
    posture: np.ndarray | None = None  # (n,) approximate posture at the start of a take
    joints: tuple[str, ...] = ()  # names of the n joints of an arm in space
    arm: Arm | None = None  # of a planar arm

    def link_masks(self) -> list[np.ndarray]:
        """Return the mask (P,) of the points of each link."""
        return [self.owner == link for link in range(len(self.chains))]

    def carry(self, q: np.ndarray) -> np.ndarray:
        """Return the points of the arm at ``q`` (S, n), (S, P, 3) m in the base's frame."""
        carried = np.empty((len(q), *self.places.shape))
        for link, on_link in enumerate(self.link_masks()):
            position, lever = self._levers(link, q)
            carried[:, on_link] = position[:, None] + lever
        return carried

    def _levers(self, link: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a link's position (S, 3) and its points relative to it (S, points, 3) in m."""
        chain = self.chains[link]
        joints = len(chain.lower)  # those that move the link
        pose = chain.pose(q[:, :joints])
        position = pose[:, :3]
        rotation = pose[:, 3:].reshape(-1, 3, 3)
        places = self.places[self.owner == link]
        levers = places @ np.swapaxes(rotation, -1, -2)
        return position, levers

    def solve(self, measured: np.ndarray, starts: np.ndarray) -> Solution:
        """Return the least-squares joint angles for ``measured`` (S, P, 3) m from ``starts`` (S, n)
        by Levenberg and Marquardt. Steps use the eigenvectors of JᵀJ, so that angles hardly change
        along undetermined directions.
        """
        q = np.array(starts, dtype=float)
        state = self._equations(q, measured)  # overwritten where a step is accepted
        normal, gradient, distances = state
        damping = np.zeros(len(q))
        moving = np.arange(len(q))
        for _ in range(STEPS):
            step, greatest = _damped_steps(
                normal[moving],
                gradient[moving],
                damping[moving],
            )
            far = np.abs(step).max(axis=1) >= LEAST_STEP
            moving = moving[far]
            step = step[far]
            greatest = greatest[far]
            if not len(moving):
                break

            stepped = self._equations(q[moving] + step, measured[moving])
            before = (distances[moving] ** 2).sum(axis=1)
            nearer = (stepped[2] ** 2).sum(axis=1) <= before
            accepted = moving[nearer]
            q[accepted] += step[nearer]
            for array, new in zip(state, stepped, strict=True):
                array[accepted] = new[nearer]
            now = damping[moving]
            less = np.where(now > 1e-9 * greatest, 0.1 * now, 0.0)
            more = np.maximum(10.0 * now, 1e-3 * greatest)
            damping[moving] = np.where(nearer, less, more)

        decided = np.linalg.eigvalsh(normal)[:, 0] >= LEAST_LEVER**2
        number = np.sum(~np.isnan(measured[..., 0]), axis=-1)
        mean_square = (distances**2).sum(axis=-1) / np.maximum(number, 1)
        rms = np.sqrt(mean_square)
        fits = decided & (distances <= self.gate).all(axis=-1)
        residual = np.where(fits, rms, np.nan)
        return Solution(q, residual, distances, normal, decided)

    def _equations(
        self,
        q: np.ndarray,
        measured: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return JᵀJ (S, n, n), Jᵀr (S, n), ‖r‖ (S, P) in m; r is ``measured`` minus modelled."""
        starts, n = q.shape
        normal = np.zeros((starts, n, n))
        gradient = np.zeros((starts, n))
        distances = np.zeros(measured.shape[:2])
        for link, on_link in enumerate(self.link_masks()):
            m = len(self.chains[link].lower)
            position, lever = self._levers(link, q)
            way = measured[:, on_link] - position[:, None] - lever
            seen = ~np.isnan(way[..., :1])
            way = np.where(seen, way, 0.0)

            jacobian = self.chains[link].jacobian(q[:, :m])
            moved = _point_jacobian(jacobian, lever) * seen[..., None]
            moved = moved.reshape(starts, -1, m)

            normal[:, :m, :m] += np.swapaxes(moved, -1, -2) @ moved
            gradient[:, :m] += np.vecmat(way.reshape(starts, -1), moved)
            distances[:, on_link] = np.linalg.norm(way, axis=-1)
        return normal, gradient, distances

    def postures(self, measured: np.ndarray) -> list[Solution]:
        """Return the postures within the joint limits at which every point of ``measured`` (P, 3) m
        is within the gate. Searches start from the stated posture or over the joint ranges; angles
        are within half a turn of the stated posture or of mid-range.
        """
        centre, starts = self._search_starts()
        points = np.broadcast_to(measured, (len(starts), *measured.shape))
        lower = self.lower - SAME_POSTURE
        upper = self.upper + SAME_POSTURE
        postures: list[Solution] = []
        for arrays in zip(*self.solve(points, starts), strict=True):
            solution = Solution(*arrays)
            turns = np.round((solution.q - centre) / (2 * np.pi))
            turns = np.where(self.sliding, 0.0, turns)
            q = solution.q - 2 * np.pi * turns

            in_limits = np.all((q >= lower) & (q <= upper))
            if solution.distances.max() > self.gate or not in_limits:
                continue
            differences = [np.abs(q - posture.q).max() for posture in postures]
            if all(difference > SAME_POSTURE for difference in differences):
                postures.append(solution._replace(q=q))
        return postures

    def _search_starts(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the stated posture (n,) or mid-range, and start postures (S, n) of a search."""
        from scipy.stats import qmc

        if self.posture is not None:
            return self.posture, self.posture[None]
        finite = np.isfinite(self.upper - self.lower)
        middle = np.where(finite, self.lower + self.upper, 0.0) / 2
        reach = np.where(finite, self.upper - middle, np.pi)
        sequence = qmc.Sobol(len(middle), scramble=False).fast_forward(1)
        shares = sequence.random(STARTS)
        starts = middle + (2 * shares - 1) * np.minimum(reach, np.pi)
        return middle, starts


def _damped_steps(
    normal: np.ndarray,
    gradient: np.ndarray,
    damping: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the steps (S, n) of Levenberg and Marquardt from JᵀJ (S, n, n), Jᵀr (S, n) and the
    ``damping`` (S,), and the greatest eigenvalue (S,) of JᵀJ.
    """
    values, vectors = np.linalg.eigh(normal)
    along = np.matvec(np.swapaxes(vectors, -1, -2), gradient)
    along /= np.maximum(values, LEAST_LEVER**2) + damping[:, None]
    return np.matvec(vectors, along), values[:, -1]


def _point_jacobian(jacobian: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Return the Jacobian (S, points, 3, m) of points: v + ω × ``lever`` of each joint, from the
    ``jacobian`` (S, 6, m) of their link and the ``lever`` (S, points, 3) in m.
    """
    wx, wy, wz = jacobian[:, 3:, None].swapaxes(0, 1)
    x, y, z = lever.T[..., None].swapaxes(1, 2)
    turning_x = wy * z - wz * y
    turning_y = wz * x - wx * z
    turning_z = wx * y - wy * x
    turning = np.stack([turning_x, turning_y, turning_z], axis=2)
    return jacobian[:, None, :3] + turning


def points_in_space(robot: Robot, mocap: Mocap) -> MarkedArm:
    """Return the points of ``mocap`` on the links of ``robot``; raises ConfigError for a link that
    has no point, does not exist or does not move, and for a posture with a wrong number of joints.
    """
    key = "dataset.mocap.markers"
    chain = chain_of(robot)
    chains = link_chains(robot, mocap.markers, key)
    numbers = [len(points) for points in mocap.markers.values()]
    for link, number in zip(mocap.markers, numbers, strict=True):
        if not number:
            message = f"{link} needs markers with the position x, y, z"
            raise ConfigError(message, key=key)
    posture = None
    if mocap.posture is not None:
        posture = np.array(mocap.posture)
        if len(posture) != len(chain.lower):
            message = f"{len(posture)} angles for an arm of {len(chain.lower)} joints"
            raise ConfigError(message, key="dataset.mocap.posture")
    places = []
    for points in mocap.markers.values():
        places += points.values()
    return MarkedArm(
        chains=[*chains.values()],
        sliding=np.asarray(chain.sliding, bool),
        lower=chain.lower,
        upper=chain.upper,
        owner=np.repeat(np.arange(len(chains)), numbers),
        places=np.array(places),
        gate=mocap.gate,
        posture=posture,
        joints=tuple(robot.joints),
    )


def points_in_plane(arm: Arm, template: np.ndarray, gate: float) -> MarkedArm:
    """Return the points of a planar arm at ``template`` (segment, marker, xyz) in m in the
    segments' frames; raises ConfigError for another shape and for markers in line.
    """
    key = "dataset.mocap.markers"
    if np.shape(template) != (3, 3, 3):
        message = "each of the three segments of a planar arm needs three markers with x, y, z"
        raise ConfigError(message, key=key, shape=np.shape(template))
    for link, corners in enumerate(template, start=1):
        _, width, _ = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
        edges = corners - np.roll(corners, 1, axis=0)
        sides = np.linalg.norm(edges[:, [0, 2]], axis=1)
        if width < MIN_LEVER / 2 or sides.min() < MIN_LEVER:
            message = "the markers of a link are in line, or two of them are too close in the plane"
            raise ConfigError(f"{message} of the arm", key=key, link=link)
    chain = arm.chain
    links = len(template)
    return MarkedArm(
        chains=_chains_in_space(arm),
        sliding=chain.sliding,
        lower=chain.lower,
        upper=chain.upper,
        owner=np.repeat(np.arange(links), 3),
        places=template.reshape(-1, 3),
        gate=gate,
        arm=arm,
    )


def _chains_in_space(arm: Arm) -> list[SerialChain]:
    """Return the chain from the base to each segment of a planar ``arm``, with the whole pose."""
    chain = arm.chain
    links = len(arm.chain.signs)
    origin = arm.to_base(chain.placements[0, 9:])
    base = arm.rotation @ chain.placements[0, :9].reshape(3, 3)
    placements = [np.append(base, origin), *chain.placements[1:-1]]
    segments = segment_frames(chain, np.zeros(links))[0]
    chains = []
    for j in range(links):
        end = joint_axes(chain.signs[j]).T @ segments[j]
        to_link = np.array([*placements[: j + 1], np.append(end, np.zeros(3))])
        to_segment = SerialChain(
            SPACE,
            1.0,
            to_link,
            chain.sliding[: j + 1],
            chain.lower[: j + 1],
            chain.upper[: j + 1],
            chain.max_speed[: j + 1],
        )
        chains.append(to_segment)
    return chains
