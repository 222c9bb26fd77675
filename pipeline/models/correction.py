"""What a closed loop adds to the commands of a block of poses, compiled."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.arm.compiled import plane_of, pose
from pipeline.arm.interface import Chain
from pipeline.arm.numbers import Arm
from pipeline.arm.serial_compiled import displacement_rows, tip
from pipeline.core.compiled import passed
from pipeline.models.law import Poses, at, planar


def correction(chain: Chain) -> Callable:
    """That of the ``chain``, for compiled code."""
    return planar_correction if isinstance(chain, PlanarChain) else serial_correction


@passed
def planar_correction(
    arm: Arm, target: np.ndarray, share: float, poses: Poses, room: np.ndarray
) -> None:
    """Add ``share``·(``target`` − x(q)) to the commands of ``poses``; ``target`` (3,) is x, z, φ,
    and no ``room`` is needed.
    """
    plane, (v, here, _) = plane_of(arm), planar(poses)
    for i in range(poses.count):
        x, z, phi = pose(plane, at(here, i))
        v[0][i] += share * (target[0] - x)
        v[1][i] += share * (target[1] - z)
        v[2][i] += share * (target[2] - phi)


@passed
def serial_correction(
    arm: Arm, target: np.ndarray, share: float, poses: Poses, room: np.ndarray
) -> None:
    """The same for any arm; ``target`` (12,) is the tip's position and rotation, row by row."""
    tip(arm, poses.q, poses.start, poses.count, room)
    displacement_rows(arm, target, room, poses.count, poses.command, share)
