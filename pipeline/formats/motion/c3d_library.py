"""What one C3D file holds, by ezc3d.

On a damaged file the library may crash or never return: this is called in a process of its own.
"""

from __future__ import annotations

import numpy as np


def contents(file: str) -> dict[str, np.ndarray]:
    """``points`` (3, P, N) in the file's unit, ``residuals`` (P, N), ``labels`` (P,), ``units`` and
    ``rate`` as stated, ``first`` frame; how many ``analog`` channels and force ``plates`` there are
    beside.
    """
    import ezc3d

    recording = ezc3d.c3d(file)
    point = recording["parameters"]["POINT"]
    groups = sorted(
        (name for name in point if name.startswith("LABELS")), key=lambda name: (len(name), name)
    )
    return {
        "points": recording["data"]["points"][:3],
        "residuals": recording["data"]["meta_points"]["residuals"][0],
        "labels": np.array([label for name in groups for label in point[name]["value"]], dtype=str),
        "units": np.array(point["UNITS"]["value"] if "UNITS" in point else [], dtype=str),
        "rate": np.array(point["RATE"]["value"] if "RATE" in point else [], dtype=float),
        "first": np.array(recording["header"]["points"]["first_frame"]),
        "analog": np.array(recording["data"]["analogs"].shape[1]),
        "plates": np.array(_stated(recording["parameters"].get("FORCE_PLATFORM", {}), "USED")),
    }


def _stated(group: dict, name: str) -> int:
    """The whole number that a group of parameters states under ``name``, 0 where it does not."""
    return int(next(iter(group[name]["value"]), 0)) if name in group else 0
