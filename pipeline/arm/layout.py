"""An arm with every joint at zero: where its joints and its tip lie in some frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Layout:
    """The n joints of an arm, one behind the other, and its tip."""

    names: tuple[str, ...]  # of the joints
    sliding: np.ndarray  # (n,) whether a joint is prismatic
    axes: np.ndarray  # (n, 3) unit vectors that the joints turn about or slide along
    points: np.ndarray  # (n, 3) one of each axis, m
    rotation: np.ndarray  # (3, 3) of the tip
    position: np.ndarray  # (3,) of the tip, m
    lower: np.ndarray  # (n,) joint limits, rad or m; infinite of a continuous joint
    upper: np.ndarray  # (n,)
    max_speed: np.ndarray  # (n,) rad/s or m/s, likewise where the URDF has none

    def seen_from(self, rotation: np.ndarray, translation: np.ndarray) -> Layout:
        """The same in the frame whose axes are the columns of ``rotation`` (3, 3), and whose origin
        is ``translation`` (3,) in m.
        """
        return replace(
            self,
            axes=self.axes @ rotation,
            points=(self.points - translation) @ rotation,
            rotation=rotation.T @ self.rotation,
            position=(self.position - translation) @ rotation,
        )

    def placements(self) -> np.ndarray:
        """(n + 1, 12) rotation (9, row by row) and translation (3, m) of a frame of each joint,
        whose z axis is the joint's, in that of the joint before, the first in this frame; last the
        tip's.

        The x axis is the one of the frame before as far as it is across the joint's, so that
        parallel joints have parallel frames.
        """
        result, before, origin = [], np.eye(3), np.zeros(3)
        for axis, point in zip(self.axes, self.points, strict=True):
            across = before[:, 0] if abs(before[:, 0] @ axis) < 0.9 else before[:, 1]
            x = across - axis * (axis @ across)
            x /= np.linalg.norm(x)
            frame = np.stack([x, np.cross(axis, x), axis], axis=1)
            result.append([*(before.T @ frame).ravel(), *((point - origin) @ before)])
            before, origin = frame, point
        tip = [*(before.T @ self.rotation).ravel(), *((self.position - origin) @ before)]
        return np.array([*result, tip])
