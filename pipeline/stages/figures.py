"""figures: the paper's figures and their captions, drawn from the tables of the other stages."""

import json
from pathlib import Path

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.figures.drawing import draw_all

SCORE = Path("data/score")
OUT = Path("data/figures")
DRAWN = 3  # greatest number of models in a figure whose lines can be distinguished


def run() -> None:
    """Draw every figure whose tables the dataset has into ``data/figures``, with the captions."""
    settings = config.sections("figures")
    robot = settings.dataset.robot
    force = settings.dataset.force
    models = list(settings.models)
    if contracts.exists("deviation", SCORE):  # it has the models with a fit
        fitted = set(contracts.read("deviation", SCORE)["source"])
        models = [model for model in models if model in fitted]
    evidence = json.loads((SCORE / "evidence.json").read_text(encoding="utf-8"))
    recordings = "simulated recordings" if evidence["synthetic"] else "recordings"
    options = {
        "models": models[:DRAWN],
        "joints": robot.joints if robot else [],
        "mode": settings.simulation.mode,
        "configurations": force.configurations if force else {},
        "recordings": recordings,
    }
    draw_all(OUT, options, settings.compute)
