"""Figure of the error of each model's mean (Sec. 4.1.2)."""

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures import style


def mean_error(deviation: pd.DataFrame, models: list[str]) -> Figure:
    """Draw Fig. (MeanError): one line per model."""
    figure, ((axes,),) = style.panels(style.ONE_COLUMN, 2.4)
    for model, line in style.model_lines(models).items():
        rows = deviation[deviation["source"] == model]
        axes.plot(rows["t"], rows["error"], linewidth=0.8, **line)
    axes.set(xlabel="time (s)", ylabel="error of the mean (rad)", xlim=(0, deviation["t"].max()))
    axes.set_ylim(bottom=0)
    style.legend(figure, ncols=2)
    return figure
