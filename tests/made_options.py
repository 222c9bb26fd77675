"""Sections of the options with sample values for all that a test does not state."""

from __future__ import annotations

from typing import Any

from pipeline.core.options.analysis import ArticulationSection
from pipeline.core.options.dataset import Dataset, Motion, Robot
from pipeline.core.options.instruments import Depth, JointLogSection, Pose, Workspace

ORIGIN = Pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
SAMPLES: dict[type, dict[str, Any]] = {
    ArticulationSection: {
        **{"gamma1": 1.0, "gamma2": 1 / 3, "length_range": 0.05, "minimum_points": 150},
        **{"max_gap": 3, "end_point": "commanded", "noise_window": 2},
    },
    Dataset: {
        "name": "t",
        "recordings": "recordings",
        "robot": Robot("arm.urdf", ["a", "b", "c"], plane=True),
        "motion": Motion(100.0, 10),
    },
    Depth: {
        "takes": "*",
        "encoding": "plain",
        "units_per_metre": 1000.0,
        "rate": 30.0,
        "camera": ORIGIN,
        "workspace": Workspace(0.06, 0.05, 0.06, -0.015, 0.0, 30, 1500),
        "search": 0.3,
    },
    JointLogSection: {"movements": "*", "start": [], "end": [], "rest": 0, "tolerance": 1e-3},
}


def made(structure: type, **values: Any) -> Any:
    """A section of type ``structure`` with these ``values``."""
    return structure(**SAMPLES[structure] | values)
