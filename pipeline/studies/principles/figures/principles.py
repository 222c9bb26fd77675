"""What the laboratory's arm asks of its motors, and how long its deviations last.

(a) Torque of each joint at full speed: mean over the takes (line) and one standard deviation about
it (band), as shares of what the motor gives at most. To look at: whether the bands stay within −1
and 1. (b) Correlation of the deviation from the mean path with itself some time later. Dotted: the
time between two frames of a depth camera. To look at: how much is left there for a filter.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from pipeline.figures.style import GREY, TWO_COLUMNS, joint_lines, letter, panels

TABLES = {
    "principle_torques": "data/studies/principles",
    "principle_lasting": "data/studies/principles",
}
DECLARATIONS = Path(__file__).parents[1] / "tables.yaml"
NEEDS = "a synthetic laboratory"

GAP = 0.1  # s; between two stretches at full speed
FRAME = 1 / 30  # s, between two frames of a depth camera


def draw(principle_torques: pd.DataFrame, principle_lasting: pd.DataFrame) -> Figure:
    """Both tables, joint by joint."""
    figure, ((torque, memory),) = panels(TWO_COLUMNS, 2.6, columns=2)
    lines = joint_lines(list(principle_torques["joint"].unique()))
    for joint, style in lines.items():
        rows = principle_torques[principle_torques["joint"] == joint]
        stretches = (rows["t"].diff() > GAP).cumsum()
        for number, part in rows.groupby(stretches):
            mean, std = part["holding"] / part["greatest"], part["swaying"] / part["greatest"]
            label = {} if number else {"label": style["label"]}
            shown = {key: value for key, value in style.items() if key != "label"} | label
            torque.plot(part["t"], mean, **shown)
            torque.fill_between(
                part["t"], mean - std, mean + std, color=style["color"], alpha=0.2, linewidth=0
            )
        left = principle_lasting[principle_lasting["joint"] == joint]
        memory.plot(1e3 * left["lag"], left["correlation"], **style)
    for limit in (-1, 1):
        torque.axhline(limit, color=GREY, linewidth=0.7)
    memory.axhline(0, color=GREY, linewidth=0.7)
    memory.axvline(1e3 * FRAME, color=GREY, linewidth=0.7, linestyle=":")
    torque.set(xlabel="time (s)", ylabel="torque over the greatest", ylim=(-1.1, 1.1))
    memory.set(xlabel="later by (ms)", ylabel="correlation of the deviation")
    for axes, name in ((torque, "a"), (memory, "b")):
        letter(axes, name)
    memory.legend()
    return figure
