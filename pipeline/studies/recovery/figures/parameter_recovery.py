"""What the estimators return of known parameters.

Data were drawn from each model at the recorded poses and commands, with the measurement noise of
the recordings, and given to every estimator of that model. A row is an estimator, a mark in it a
parameter, in the order in which the row names them. (a) Bias of the estimate in percent of the
parameter, with its 95 % interval over the data sets; the scale is linear between the dotted lines
and logarithmic beyond. (b) Share of the data sets whose 95 % interval, by the bootstrap over takes,
holds the parameter; grey: where 95 % of such shares lie when the interval is what it says.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from pipeline.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    SKY,
    TWO_COLUMNS,
    VERMILLION,
    letter,
    panels,
)

TABLES = {"parameter_recovery": "data/studies/recovery"}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
NEEDS = "motion that rests"

# by the first word of the data
COLOURS = {"additive": SKY, "wishart": BLUE, "gaussian": BLACK, "scaled": GREEN}
FURTHER = ORANGE
LINEAR = 5.0  # percent
TICKS = (-80, -40, -20, -10, -5, -2.5, 0, 2.5, 5, 10, 20, 40, 80)
SPACING, GAP = 0.12, 0.17  # in, between the marks of a row and between rows


def symbols(joints: Sequence[str]) -> dict[str, str]:
    """How the figure writes the parameters that it shows."""
    numbered = list(enumerate(joints, 1))
    return {
        **{f"sigma_omega_{j}{j}_rad2": rf"$\Sigma_{{{j}{j}}}$" for j, _ in numbered},
        "sigma_b": r"$\sigma_B$",
        "u": "$u$",
        "alpha": r"$\alpha$",
        "noise_level": r"$\alpha\sqrt{u^2-\langle\Vert J^{-1}\Vert^2\rangle}$",
        **{f"std_at_rest_{joint}_rad": f"$a_{j}$" for j, joint in numbered},
        **{f"std_share_of_the_step_{joint}": f"$b_{j}$" for j, joint in numbered},
    }


def draw(parameter_recovery: pd.DataFrame, joints: list[str]) -> Figure:
    """Table ``parameter_recovery``: of every estimator the parameters that have a symbol here,
    those of joints by the places of ``joints``; covariances are left to the table.
    """
    written = symbols(joints)
    shown = parameter_recovery[parameter_recovery["parameter"].isin(written)]
    rows = list(shown.groupby(["data", "estimator"], sort=False))
    places, end = [], 0.0
    for _, row in rows:
        places.append(end + GAP + SPACING * np.arange(len(row)))
        end = places[-1][-1]
    figure, ((bias, coverage),) = panels(
        TWO_COLUMNS, end + GAP + 0.55, columns=2, sharey=True, width_ratios=(1.6, 1)
    )
    for (((data, _), row), place), shade in zip(
        zip(rows, places, strict=True), np.arange(len(rows)) % 2, strict=True
    ):
        colour = COLOURS.get(data.split()[0], FURTHER)
        _marks(
            bias,
            100 * row["relative_bias"],
            place,
            colour,
            196 * row["relative_bias_standard_error"],
        )
        _marks(coverage, 100 * row["coverage"], place, colour, None)
        if shade:
            for axes in (bias, coverage):
                axes.axhspan(
                    place[0] - GAP / 2, place[-1] + GAP / 2, color=GREY, alpha=0.12, linewidth=0
                )
    labels = [
        f"{_name(data, estimator)}: {', '.join(written[name] for name in row['parameter'])}"
        for (data, estimator), row in rows
    ]
    bias.set_yticks([place.mean() for place in places], labels)
    bias.set(xlabel="relative bias (%)", ylim=(end + GAP, 0))
    bias.set_xscale("symlog", linthresh=LINEAR)
    # as far as the marks reach on either side, and never less than the linear part
    low, high = (
        side * max(1.2 * LINEAR, 1.15 * (side * _ends(shown, side)).max()) for side in (-1, 1)
    )
    bias.set(xlim=(low, high))
    bias.set_xticks([tick for tick in TICKS if low <= tick <= high], minor=False)
    bias.xaxis.set_major_formatter("{x:g}")
    bias.xaxis.set_minor_locator(NullLocator())
    bias.axvline(0, color=VERMILLION, linewidth=0.8, zorder=1)
    for side in (-LINEAR, LINEAR):
        bias.axvline(side, color=GREY, linewidth=0.6, linestyle=":", zorder=1)
    half = 196 * np.sqrt(0.95 * 0.05 / shown["datasets"].min())
    coverage.axvspan(95 - half, min(95 + half, 100), color=LIGHT_GREY, linewidth=0, zorder=0)
    coverage.axvline(95, color=VERMILLION, linewidth=0.8, zorder=1)
    coverage.set(xlabel="coverage of the 95 % interval (%)", xlim=(-3, 103))
    for axes, name in ((bias, "a"), (coverage, "b")):
        axes.tick_params(axis="y", length=0)
        letter(axes, name)
    return figure


def _marks(
    axes: Axes, values: pd.Series, places: np.ndarray, colour: str, half: pd.Series | None
) -> None:
    axes.errorbar(
        values,
        places,
        xerr=half,
        color=colour,
        marker="o",
        markersize=3,
        linestyle="none",
        elinewidth=0.9,
        clip_on=False,
    )


def _name(data: str, estimator: str) -> str:
    """The estimator, and of the Wishart model what was drawn."""
    name = estimator.replace("_", " ")
    return f"{name}, true {data.split()[1]}" if data.startswith("wishart") else name


def _ends(shown: pd.DataFrame, side: int) -> pd.Series:
    """Ends of the intervals of the bias on one ``side``, −1 or 1, in percent."""
    return 100 * shown["relative_bias"] + side * 196 * shown["relative_bias_standard_error"]
