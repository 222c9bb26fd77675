"""Sections of the options with sample values, and a params.yaml, for what a test does not state."""

from pathlib import Path
from typing import Any

from pipeline.core.options.analysis import ArticulationSection, Filter
from pipeline.core.options.dataset import (
    Dataset,
    Depth,
    JointLogSection,
    Motion,
    Pose,
    Robot,
    Workspace,
)

ORIGIN = Pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
ROBOT = Robot("arm.urdf", ["a", "b", "c"], plane=True)
MOTION = Motion(100.0, 10)
SPACE = Workspace(0.06, 0.05, 0.06, -0.015, 0.0, 30, 1500)
SAMPLES: dict[type, dict[str, Any]] = {
    ArticulationSection: {
        "gamma1": 1.0,
        "gamma2": 1 / 3,
        "length_range": 0.05,
        "max_gap": 3,
    }
    | {"minimum_points": 150, "end_point": "commanded", "noise_window": 2},
    Dataset: {
        "name": "t",
        "recordings": "recordings",
        "robot": ROBOT,
        "motion": MOTION,
    },
    Depth: {"takes": "*", "encoding": "plain", "units_per_metre": 1000.0, "rate": 30.0}
    | {"camera": ORIGIN, "workspace": SPACE, "search": 0.3},
    JointLogSection: {
        "movements": "*",
        "start": [],
        "end": [],
        "rest": 0,
        "tolerance": 1e-3,
    },
}
CHOICES = {
    "dataset": "youbot",
    "models": "[additive, wishart, gaussian]",
    "filter": "systematic",
    "articulation": "least_squares",
    "simulation": "one_step",
    "wrench": "paper",
    "scale": "paper",
    "compute": "local",
    "seed": "2017",
    "overrides": "{}",
}


def made(structure: type, **values: Any) -> Any:
    """A section of type ``structure`` with these ``values``."""
    return structure(**SAMPLES[structure] | values)


def parameters(folder: Path, comment: str = "", **choices: str | None) -> Path:
    """params.yaml in ``folder`` with other ``choices``, without those that are None."""
    lines = [
        f"{key}: {value} {comment}"
        for key, value in (CHOICES | choices).items()
        if value is not None
    ]
    (folder / "params.yaml").write_text("\n".join(lines) + "\n")
    return folder / "params.yaml"


def filter_options(
    particles: int = 1000,
    scheme: str = "systematic",
    threshold: float = 0.5,
) -> Filter:
    """Options of the particle filter."""
    return Filter(scheme, threshold, particles)
