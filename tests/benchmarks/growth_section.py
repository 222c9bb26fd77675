"""What the report says of how cost grows."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from writing import table, verdict

TITLE = "How cost grows"


def section(folder: Path) -> str:
    """Of cost_growth.csv: the slopes of cost over size, and the figure."""
    slopes = pd.read_csv(folder / "cost_growth.csv").drop_duplicates("over")
    rows = [
        [
            row.over,
            f"{row.time_slope:.2f}" + limited(row.time_slope, row.time_limit),
            "–" if pd.isna(row.memory_slope) else f"{row.memory_slope:z.2f}",
        ]
        for row in slopes.itertuples()
    ]
    return (
        "Slopes of the logarithm of processor time and of peak memory beyond what was there "
        "before, over the logarithm of the size, "
        "by least squares over the larger half of the sizes; – where memory stays below what can "
        "be told.\n\n"
        f"{table(['over', 'slope of time', 'slope of memory'], rows)}\n\n![Time and memory over "
        "size](benchmarks/cost_growth.png)"
    )


def limited(slope: float, limit: float) -> str:
    """Whether a slope is within its limit, where it has one."""
    if pd.isna(limit):
        return ""
    return f" (≤ {limit:g}: {verdict(slope <= limit)})"
