"""Closed forms of the planar chain of three revolute joints, for whole batches of joint angles.

Frame of the plane: x horizontal, z up (the two task axes), rotations positive about y = z × x; task
rows in the order x (m), z (m), φ (rad). With cumulative angles φ_j = s_1 q_1 + … + s_j q_j and link
vectors r_j (at q = 0) the joints are at O_{j+1} = O_j + R(φ_j) r_j, O_4 being the end-effector EE.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import ArmConstants, Chain
from pipeline.core.columns import PLANE

SINGULAR_SINE = 1e-3  # |det J|/(l1 l2) = |sin q2|, below which a pose is singular


@dataclass(frozen=True)
class PlanarChain(Chain):
    """Geometry of a planar 3R chain; :func:`pipeline.arm.model.chain_of` reads it from a URDF."""

    task: ClassVar[tuple[str, ...]] = PLANE
    origin: ndarray  # (2,) O1 in the plane, m
    links: ndarray  # (3, 2) link vectors at q = 0, m
    signs: ndarray  # (3,) +1 or -1: sense of each joint about the plane's normal
    lower: ndarray  # (3,) joint limits, rad
    upper: ndarray  # (3,)
    max_speed: ndarray  # (3,) rad/s

    @property
    def lengths(self) -> ndarray:
        """(3,) lengths of the three segments O1O2, O2O3, O3EE in m."""
        return np.hypot(*self.links.T)

    @property
    def straight(self) -> float:
        """Angle of the second joint in rad, modulo π, at which the first two links are in line."""
        first, second = np.arctan2(*self.links[:2].T)
        return float(self.signs[1] * (first - second))

    def segment_headings(self, q: ndarray) -> ndarray:
        """(..., 3) angles ψ_j in rad about y from the z axis to the segments O_jO_{j+1}."""
        return np.cumsum(self.signs * q, axis=-1) + np.arctan2(*self.links.T)

    def joints_from_segments(self, psi: ndarray) -> ndarray:
        """(..., 3) joint angles in rad at the headings ``psi`` (..., 3), nearest to mid-range."""
        phi = np.asarray(psi, dtype=float) - np.arctan2(*self.links.T)
        q = self.signs * np.diff(phi, axis=-1, prepend=0.0)
        middle = (self.lower + self.upper) / 2
        return q - 2 * np.pi * np.round((q - middle) / (2 * np.pi))

    def _segments(self, q: ndarray) -> tuple[ndarray, ndarray]:
        """x and z (3, ...) in m of the segments, contiguous along the batch."""
        over = (3, *[1] * (np.ndim(q) - 1))
        turns = np.moveaxis(np.asarray(q, dtype=float), -1, 0) * self.signs.reshape(
            over
        )
        heading = np.cumsum(turns, axis=0)
        sine, cosine = np.sin(heading), np.cos(heading)
        x, z = (column.reshape(over) for column in self.links.T)
        return cosine * x + sine * z, cosine * z - sine * x

    def points(self, q: ndarray) -> ndarray:
        """(..., 4, 2) positions of O1, O2, O3 and EE in m for joint angles ``q`` (..., 3)."""
        steps = np.moveaxis(np.stack(self._segments(q)), (0, 1), (-1, -2))
        start = np.broadcast_to(self.origin, (*steps.shape[:-2], 1, 2))
        return np.concatenate([start, self.origin + np.cumsum(steps, axis=-2)], axis=-2)

    def pose(self, q: ndarray) -> ndarray:
        """(..., 3) end-effector pose (x, z, φ) in m, m, rad."""
        phi = np.cumsum(self.signs * np.asarray(q, dtype=float), axis=-1)[..., -1:]
        return np.concatenate([self.points(q)[..., -1, :], phi], axis=-1)

    def displacement(self, start: ndarray, end: ndarray) -> ndarray:
        """(..., 3) displacement from poses ``start`` to ``end`` (..., 3); φ keeps whole turns."""
        return end - start

    def jacobian(self, q: ndarray) -> ndarray:
        """(..., 3, 3) Jacobian J(q): rows x, z, φ, columns the joints (m/rad, m/rad, 1)."""
        x, z = self._segments(q)
        result = np.empty((*np.shape(q), 3))
        for j, sign in enumerate(self.signs):
            result[..., 0, j], result[..., 1, j] = (
                sign * z[j:].sum(0),
                -sign * x[j:].sum(0),
            )
        result[..., 2, :] = self.signs
        return result

    def singular(self, q: ndarray) -> ndarray:
        """(...,) True where the first two links are in line, or ``q`` is not finite."""
        bent = np.abs(np.sin(np.asarray(q)[..., 1] - self.straight)) >= SINGULAR_SINE
        return ~(bent & np.isfinite(q).all(axis=-1))

    def inverse_jacobian(self, q: ndarray, *, what: str = "pose") -> ndarray:
        """(..., 3, 3) J(q)⁻¹ in closed form; raises :class:`SingularJacobianError` naming the first
        singular ``what``. The first two joints move the wrist O3 at v − φ̇·k×(EE − O3), the third
        joint adds the rest of φ̇.
        """
        self.require_regular(q, what=what)
        (ax, bx, tx), (az, bz, tz) = self._segments(q)
        cross, wx, wz = az * bx - ax * bz, ax + bx, az + bz
        first = bx / cross, bz / cross, (bz * tx - bx * tz) / cross
        second = -wx / cross, -wz / cross, (wx * tz - wz * tx) / cross
        result = np.empty((*np.shape(q), 3))
        for column, phi in enumerate((0.0, 0.0, 1.0)):
            one, two = first[column], second[column]
            for row, step in enumerate((one, two, phi - one - two)):
                result[..., row, column] = self.signs[row] * step
        return result

    def numbers(self) -> ArmConstants:
        """Constants of the chain for compiled code; ``least`` is SINGULAR_SINE."""
        plane = np.concatenate([self.links.ravel(), self.signs, self.origin])
        other = np.empty((0, 6)), np.zeros(3), np.array([0, 2, 4]), np.ones(3)
        return ArmConstants(plane, *other, SINGULAR_SINE)


def segment_frames(chain: PlanarChain, q: ndarray) -> tuple[ndarray, ndarray]:
    """Rotations (..., 3, 3, 3) and origins (..., 3, 3) in m of the segments in the plane's frame
    (x, normal y, z) at ``q`` (..., 3) in rad. Segment j starts at O_j; its axes, the columns of its
    rotation, are z towards O_{j+1}, y along the normal, x = y × z.
    """
    origin, psi = np.zeros((*np.shape(q), 3)), chain.segment_headings(q)
    origin[..., [0, 2]] = chain.points(q)[..., :-1, :]
    rotation = np.zeros((*psi.shape, 3, 3))
    rotation[..., 0, 0], rotation[..., 0, 2] = np.cos(psi), np.sin(psi)
    rotation[..., 2, 0], rotation[..., 2, 2] = -np.sin(psi), np.cos(psi)
    rotation[..., 1, 1] = 1.0
    return rotation, origin
