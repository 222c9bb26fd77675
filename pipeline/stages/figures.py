"""figures: the paper's figures and their captions, drawn from the tables of the other stages."""

from __future__ import annotations

from pathlib import Path

from pipeline.core import config
from pipeline.figures.drawing import draw_all

OUT = Path("reports/figures")
DRAWN = 3  # models in the paper's figures: more lines than these cannot be told apart


def run() -> None:
    """Draw every figure whose tables the dataset has into ``reports/figures``."""
    settings = config.sections("figures")
    robot, force = settings.dataset.robot, settings.dataset.force
    options = {
        "models": list(settings.models)[:DRAWN],
        "joints": robot.joints if robot else [],
        "mode": settings.simulation.mode,
        "configurations": force.configurations if force else {},
    }
    draw_all("pipeline.figures", OUT, options, settings.compute, "figures")
