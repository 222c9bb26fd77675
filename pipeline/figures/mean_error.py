"""Error of the mean of each model's realisations.

Euclidean distance over all joints between the mean of a model's realisations and the mean of
the training takes, at every step. All models share the nominal motion, so what differs is the bias
of each model and the sampling error of a finite number of realisations.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style

TABLES = {"deviation": "data/score"}


def draw(deviation: pd.DataFrame, models: list[str]) -> Figure:
    """Fig. (MeanError): one line per model."""
    figure, ((axes,),) = style.panels(style.ONE_COLUMN, 2.4)
    for model, line in style.model_lines(models).items():
        rows = deviation[deviation["source"] == model]
        axes.plot(rows["t"], rows["error"], linewidth=0.8, **line)
    axes.set(xlabel="time (s)", ylabel="error of the mean (rad)", xlim=(0, deviation["t"].max()))
    axes.set_ylim(bottom=0)
    style.legend(figure, ncols=2)
    return figure
