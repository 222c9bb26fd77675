"""What is left of the matrix models' advantage: log scores of every model against the first.

Paired difference of the mean log score to that of the first model, in nats a step, with its 95 %
interval over takes; right of zero is better. From left to right: all held-out steps that were
commanded to move; these in thirds by the norm of the inverse Jacobian, so that the last third is
the nearest to a singular pose; and the posterior of the particle filter in an open and in a closed
loop, and without any filter, where there is a depth camera. To look at: whether a matrix model
beats the models that merely scale with speed, and whether that grows towards singular poses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import GREY, TWO_COLUMNS, model_lines, panels

TABLES = {"model_scores": "data/studies/baselines"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
NEEDS = "motion that rests"

SCORE = "log_score"


def draw(model_scores: pd.DataFrame) -> Figure:
    """One panel per group of steps of table ``model_scores`` but that of all steps, one line per
    model.
    """
    rows = model_scores[(model_scores["score"] == SCORE) & (model_scores["steps"] != "all")]
    groups, models = list(dict.fromkeys(rows["steps"])), list(dict.fromkeys(rows["model"]))
    lines = model_lines(models)
    figure, (row,) = panels(
        TWO_COLUMNS, 0.95 + 0.22 * len(models), columns=len(groups), sharex=True, sharey=True
    )
    for axes, group in zip(row, groups, strict=True):
        axes.axvline(0, color=GREY, linewidth=0.5)
        scored = rows[rows["steps"] == group].set_index("model")
        for height, model in enumerate(models[1:]):
            if model not in scored.index:  # no filter predicts no step
                continue
            if not np.isfinite(scored.loc[model, "difference"]):
                axes.text(
                    0.5,
                    height,
                    "does not exist",
                    transform=axes.get_yaxis_transform(),
                    ha="center",
                    va="center",
                    fontsize=7,
                )
                continue
            middle, low, high = scored.loc[model, ["difference", "low", "high"]]
            reach = [[middle - low], [high - middle]] if np.isfinite(low) else None
            axes.errorbar(
                middle,
                height,
                xerr=reach,
                fmt="o",
                markersize=3,
                capsize=2,
                linewidth=0.9,
                color=lines[model]["color"],
            )
        axes.set_title(_title(group), fontsize=7)
        # a model that is far worse must not hide the differences of the others
        axes.set_xscale("symlog", linthresh=1.0)
        axes.set_xticks([-10, -1, 0, 1], ["−10", "−1", "0", "1"])
    figure.supxlabel(
        f"difference in log score to {lines[models[0]]['label']} (nats a step)", fontsize=8
    )
    row[0].set_yticks(range(len(models) - 1), [lines[model]["label"] for model in models[1:]])
    row[0].invert_yaxis()
    return figure


def _title(group: str) -> str:
    """The name of a group of steps in as many lines as it has parts, the norm as the paper prints
    it.
    """
    return group.replace(", ", ",\n").replace(": ", ":\n").replace("‖J⁻¹‖", "$\\|J^{-1}\\|$")
