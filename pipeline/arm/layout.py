"""An arm with every joint at zero: where its joints and its tip lie in some frame, the plane of
parallel joints, and the planar chain of three of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.arm.chain import JOINTS, PlanarChain
from pipeline.core.errors import ConfigError


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


PLANAR_TOLERANCE = 1e-6  # sine of the angle by which an axis may lean out of the common normal
SHORTEST_LINK = 1e-3  # m; joints nearer than this do not span a chain


def plane_of(layout: Layout, file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3), whose columns are the plane's x, normal y and z, and origin (3,) in m of the
    plane in which the tip of ``layout`` moves.

    The y axis is the axis of the first revolute joint, the z axis the frame's z as far as it lies
    in the plane (the frame's y where the plane is horizontal); the first of the joints lies in y =
    0. Raises ConfigError, naming ``file``, where a joint turns about another direction or slides
    out of the plane.
    """
    if layout.sliding.all():
        message = "robot.plane: no joint turns, and there is no plane to turn in; set it to false"
        raise ConfigError(message, file=file)
    normal = layout.axes[~layout.sliding][0]
    normal = normal / np.linalg.norm(normal)
    leaning = np.where(
        layout.sliding,
        np.abs(layout.axes @ normal),
        np.linalg.norm(np.cross(normal, layout.axes), axis=1),
    )
    if np.any(leaning > PLANAR_TOLERANCE):
        wrong = [
            name
            for name, lean in zip(layout.names, leaning, strict=True)
            if lean > PLANAR_TOLERANCE
        ]
        message = (
            "robot.joints: the axes are not parallel, so they form no planar chain: "
            f"not to that of {layout.names[int(np.argmin(layout.sliding))]} is {', '.join(wrong)}"
        )
        raise ConfigError(message, file=file, axes=layout.axes.round(4).tolist())
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    up = up - normal * (up @ normal)
    up /= np.linalg.norm(up)
    rotation = np.stack([np.cross(normal, up), normal, up], axis=1)
    return rotation, normal * (normal @ layout.points[0])


def unlike_three(layout: Layout) -> str | None:
    """Why the joints are not those of a :class:`PlanarChain`, three revolute ones with limits; None
    where they are.
    """
    unlike = layout.sliding | ~np.isfinite([layout.lower, layout.upper]).all(axis=0)
    wrong = ", ".join(name for name, is_so in zip(layout.names, unlike, strict=True) if is_so)
    if wrong or len(layout.names) != JOINTS:
        which = f", which {wrong} is not" if wrong else ""
        return f"{list(layout.names)} must be three revolute joints with limits{which}"
    return None


def planar_chain(layout: Layout, file: Path) -> PlanarChain:
    """The chain of a ``layout`` of three revolute joints in the frame of its plane
    (:func:`plane_of`); raises ConfigError, naming ``file``, where joints or tip lie on one axis.
    """
    places = np.vstack([layout.points, layout.position])[:, [0, 2]]
    links = np.diff(places, axis=0)
    if np.any(np.hypot(*links.T) < SHORTEST_LINK):
        raise ConfigError(
            "robot: joints or tool of the chain lie on one axis",
            file=file,
            lengths=np.hypot(*links.T).round(4).tolist(),
        )
    return PlanarChain(
        origin=places[0],
        links=links,
        signs=np.sign(layout.axes[:, 1]),
        lower=layout.lower,
        upper=layout.upper,
        max_speed=layout.max_speed,
    )
