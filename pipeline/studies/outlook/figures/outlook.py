"""Motion models on a hexapod, and the wrench of towing cables.

(a) Standard deviation of the platform's rotation after one step, along the motion; all models give
the legs the same noise. (b) Error of the matrix model of the wrench over the number of cables, mean
over the repeats: variances with the diagonal Σ_S (full lines), covariances with the full Σ_S
(dashed).
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import (
    BLUE,
    GREEN,
    MODELS,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)

LINES = {
    "additive": MODELS["additive"] | {"label": "additive"},
    "gaussian": MODELS["gaussian"] | {"label": "Gaussian"},
    "qr_transposed": {"label": r"Wishart, QR of $J^{\mathsf{T}}$", "color": BLUE, "ls": "--"},
    "qr": {"label": "Wishart, QR of $J$", "color": GREEN, "ls": (0, (6, 1.5, 1, 1.5))},
}
PARTS = {"forces": BLUE, "moments": VERMILLION}
ERRORS = {"variance": "-", "covariance": "--"}


def draw(hexapod: pd.DataFrame, towing: pd.DataFrame) -> Figure:
    """The rotation on the left, the wrench on the right."""
    figure, ((rotation, wrench),) = panels(TWO_COLUMNS, 2.6, columns=2)
    for model, line in LINES.items():
        rows = hexapod[hexapod["model"] == model]
        rotation.plot(rows["place"], 1e3 * rows["rotation"], **line)
    rotation.set(xlabel="share of the motion", ylabel="std of the rotation (mrad)", ylim=(0, None))
    means = towing.groupby(["part", "agents"])[list(ERRORS)].mean()
    for part, color in PARTS.items():
        for error, dashes in ERRORS.items():
            rows = 100 * means.loc[part, error]
            label = f"{error} of {part}"
            wrench.plot(rows.index, rows, dashes, color=color, marker="o", ms=2.5, label=label)
    wrench.set(xscale="log", yscale="log", xlabel="number of cables", ylabel="error (%)")
    ticks = list(means.index.unique("agents"))
    wrench.set_xticks(ticks, [str(m) for m in ticks])
    wrench.set_xticks([], minor=True)
    wrench.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    wrench.set_yticks([], minor=True)
    for name, axes in zip("ab", (rotation, wrench), strict=True):
        letter(axes, name)
        axes.legend()
    return figure
