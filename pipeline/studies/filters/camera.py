"""How the depth camera's error depends on the pose: the response that the informed yardstick knows.

The segment of the tool ends at the commanded end-effector, so of a deviation d the camera shows
A d, with A = I + B and B the slope of its error on d.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.core.columns import columns, members, values
from pipeline.filtering.measurement import Measurements, measurements
from pipeline.perception.depth_noise import errors_of, leave_one_out


def slope(errors: pd.DataFrame, deviation: pd.DataFrame) -> np.ndarray:
    """(n, n) B by least squares over all frames of all takes, both about their means at each frame;
    ``errors`` as :func:`pipeline.perception.depth_noise.errors_of` gives them, of the camera
    and, as ``deviation``, of the mean path.
    """
    centred = []
    for table in (errors, deviation):
        family = columns("e", members(table, "e"))
        centred.append(
            (table[family] - table.groupby("frame")[family].transform("mean")).to_numpy()
        )
    error, off = centred
    return np.linalg.lstsq(off, error)[0].T


def informed(
    angles: pd.DataFrame, joints: pd.DataFrame, path: np.ndarray, window: int
) -> tuple[list[Measurements], np.ndarray]:
    """Each test take's measurements with the noise that is left when B d is known, and A = I + B.

    The noise is estimated without the take, as for every filter; B, n² numbers, from all.

    Args:
        angles: table of the depth camera's joint angles.
        joints: table of the test takes' measured poses.
        path: (M+1, n) rad, mean of the training takes.
        window: frames on either side that the covariance is estimated over.
    """
    errors = errors_of(angles, joints)
    names = members(joints, "q")
    family = columns("e", names)
    means = joints.copy()
    takes = joints["take"].nunique()
    means[columns("q", names)] = np.tile(path, (takes, 1))
    # pose minus mean path at each frame, as the camera's error with the one and with the other
    off = errors_of(angles, means)
    off[family] -= errors[family]
    response = np.eye(len(names)) + slope(errors, off)
    left = errors.copy()
    left[family] -= values(off, "e") @ (response - np.eye(len(names))).T
    return measurements(angles, leave_one_out(left, window=window)), response
