"""Joint angles of an arm in space from motion capture, of rigid bodies on its links or of single
markers: the least sum of squared distances between points and where the links carry them.

A rigid body comes as the points that it carries (``pipeline/recordings/motion_capture.py``): so one
law serves bodies and markers, in metres alone. Where the points of a body are its own markers, its
turn has by this the weight that its markers give it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from pipeline.arm.model import chain_of, link_chains
from pipeline.arm.serial import SerialChain
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Robot
from pipeline.core.options.instruments import Mocap
from pipeline.perception.joint_track import JointTrack, fill_gaps

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


BLOCK = 16  # frames that are solved at once, from the one before them
OPEN = 0.1  # share of a joint's turn that lies among the motions that no point shows


def track_rows(
    rows: pd.DataFrame, mocap: Mocap, points: Carried, joints: Sequence[str], *, take: str
) -> JointTrack:
    """Angles of the ``joints`` of one take from its ``rows`` of the table ``markers``; markers
    without a label stay unused. See :func:`track_joints`.
    """
    labelled = rows[rows.link > 0].sort_values(["link", "marker", "k"], kind="stable")
    positions = labelled[["x", "y", "z"]].to_numpy().reshape(len(points.owner), -1, 3)
    gates = {"gate": mocap.gate, "max_gap": mocap.max_gap}
    return track_joints(positions.transpose(1, 0, 2), points, joints, **gates, take=take)


def track_joints(
    positions: np.ndarray,
    points: Carried,
    joints: Sequence[str],
    *,
    gate: float,
    max_gap: int,
    take: str = "",
) -> JointTrack:
    """Joint angles of one take.

    The first frame that one posture alone fits is the start, the others follow from it in blocks. A
    frame with a point beyond the gate goes without the link whose absence lets it fit best; one
    that does not fit then, or whose points do not decide every joint, is missing. Counts: samples
    ``missing`` and ``rejected``; frames ``unfit``, ``undecided``, ``interpolated`` and ``held``.
    Raises RecordingError where no frame is decided, or fits, and for longer gaps than ``max_gap``.

    Args:
        positions: (N, P, 3) of the points in the base frame, m, NaN where missing.
        points: where the arm carries them.
        joints: names of the n joints, for messages.
        gate: m; how far a point may lie from where the arm carries it.
        max_gap: frames; shorter runs of missing ones are filled.
        take: name of the take, for messages.
    """
    frames, n = len(positions), len(joints)
    first, start = _first(positions, points, joints, gate, take)
    q, residual = np.full((frames, n), np.nan), np.full(frames, np.nan)
    errors, missing = np.full((frames, n), np.nan), np.isnan(positions[..., 0])
    counts = {"missing": int(missing.sum()), "rejected": 0, "unfit": 0, "undecided": 0}
    for way in (range(first, frames), range(first - 1, -1, -1)):
        last = start
        for begin in range(0, len(way), BLOCK):
            block = way[begin : begin + BLOCK]
            starts = np.broadcast_to(last, (len(block), n))
            for k, solution in zip(block, points.solve_all(positions[block], starts), strict=True):
                if not solution.decided:
                    counts["undecided"] += 1
                    continue
                if solution.distances.max() > gate:
                    solution = points.without_a_link(positions[k], last, gate)
                if solution is None:
                    counts["unfit"] += 1
                    continue
                counts["rejected"] += int((~missing[k] & ~solution.seen).sum())
                last = q[k] = solution.q
                residual[k], errors[k] = solution.residual, points.errors(solution)
    q, filled = fill_gaps(q, np.isfinite(residual), max_gap, take, lack="is decided")
    known = np.isfinite(errors).all(axis=1)
    error = np.sqrt(np.mean(errors[known] ** 2, axis=0)).tolist() if known.any() else []
    stated = dict(zip(joints, error, strict=False))
    return JointTrack(q, residual, counts | filled, missing.size, stated)


def _first(
    positions: np.ndarray, points: Carried, joints: Sequence[str], gate: float, take: str
) -> tuple[int, np.ndarray]:
    """The first frame that one posture alone fits, and that posture (n,); RecordingError where
    there is none.
    """
    several, undecided = 0, None
    for k, measured in enumerate(positions):
        if np.isnan(measured[:, 0]).all():
            continue
        postures = points.postures(measured, gate)
        decided = [one for one in postures if one.decided]
        if len(decided) == len(postures) == 1:
            return k, decided[0].q
        several = max(several, len(decided))
        undecided = next((one for one in postures if not one.decided), undecided)
    key = "dataset.mocap.markers"
    if undecided is not None:
        values, vectors = np.linalg.eigh(undecided.normal)
        share = (vectors[:, values < LEAST_LEVER**2] ** 2).sum(axis=1)
        left = [name for name, part in zip(joints, share, strict=True) if part > OPEN]
        raise RecordingError(
            f"the markers and bodies leave {', '.join(left)} open: follow another link",
            take=take,
            key=key,
        )
    if several > 1:
        raise RecordingError(
            f"{several} postures of the arm fit the markers and bodies: follow another link, or say"
            " about which one a take starts",
            take=take,
            key="dataset.mocap.posture",
        )
    raise RecordingError(
        f"no posture of the arm has all markers and bodies of a frame within {gate:g} m: check "
        "their places and mounts, the base, and the gate",
        take=take,
        key=key,
    )
