"""Contents of one C3D file as ezc3d reads them.

On a damaged file the library may crash or never return: call it in a process of its own.
"""

from __future__ import annotations

import os
import re

import numpy as np

# groups of POINT whose entries name points that a model computed: angles in degrees, moments in
# N·mm and others, of Vicon's Nexus and of Visual3D
OUTPUTS = re.compile(r"(ANGLES|FORCES|MOMENTS|POWERS|SCALARS|REACTIONS)\d*")


def contents(file: str) -> dict[str, np.ndarray]:
    """Return ``points`` (3, P, N) in the file's unit, ``residuals`` (P, N), ``labels`` (≥ or < P,),
    ``outputs`` (the labels of points that are no markers), ``units`` and ``rate`` as stated,
    ``start`` (TRIAL:ACTUAL_START_FIELD, two words or none); the numbers of ``analog`` channels and
    force ``plates``.
    """
    import ezc3d

    # by its descriptor, since the library takes no name that is not UTF-8
    descriptor = os.open(file, os.O_RDONLY)
    try:
        recording = ezc3d.c3d(f"/proc/self/fd/{descriptor}")
    finally:
        os.close(descriptor)
    parameters = recording["parameters"]
    point = parameters["POINT"]
    labels = sorted((name for name in point if re.fullmatch(r"LABELS\d*", name)), key=_numbered)
    outputs = [name for name in point if OUTPUTS.fullmatch(name)]
    return {
        "points": recording["data"]["points"][:3],
        "residuals": recording["data"]["meta_points"]["residuals"][0],
        "labels": np.array(_values(point, *labels), dtype=str),
        "outputs": np.array([str(name) for name in _values(point, *outputs)], dtype=str),
        "units": np.array(_values(point, "UNITS"), dtype=str),
        "rate": np.array(_values(point, "RATE"), dtype=float),
        "start": np.array(_values(parameters.get("TRIAL", {}), "ACTUAL_START_FIELD"), dtype=int),
        "analog": np.array(recording["data"]["analogs"].shape[1]),
        "plates": np.array(sum(_values(parameters.get("FORCE_PLATFORM", {}), "USED")[:1])),
    }


def _numbered(name: str) -> tuple[int, str]:
    """Sort LABELS2 before LABELS10."""
    return len(name), name


def _values(group: dict, *names: str) -> list:
    """All values that a group of parameters has under ``names``, in their order."""
    return [value for name in names if name in group for value in group[name]["value"]]
