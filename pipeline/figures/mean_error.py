"""Figure of the error of each model's mean (Sec. 4.1.2)."""

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style

PANELS = {
    "error": "error of the sampled mean (rad)",
    "bias": "exact bias of a step (rad)",
}


def mean_error(deviation: pd.DataFrame, models: list[str]) -> Figure:
    """Draw Fig. (MeanError) beside the exact bias: one line per model, both panels on one scale."""
    shared = {"sharex": True, "sharey": True}
    figure, (row,) = style.panels(style.ONE_COLUMN, 2.3, columns=2, **shared)
    for axes, (name, label) in zip(row, PANELS.items(), strict=True):
        for model, line in style.model_lines(models).items():
            rows = deviation[deviation["source"] == model]
            axes.plot(rows["t"], rows[name], linewidth=0.8, **line)
        axes.set(xlabel="time (s)", ylabel=label)
    row[0].set(xlim=(0, deviation["t"].max()), ylim=(0, None))
    style.letters(row)
    style.legend(figure, ncols=2)
    return figure
