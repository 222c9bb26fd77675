"""The report's table of what the filter's time for a particle and step is made of."""

from __future__ import annotations

import json
from pathlib import Path
from statistics import median

from contests import an_item
from writing import duration, table

TITLE = "Where the filter's time goes"
PARTS = ["numbers", "arithmetic", "weights and moments", "resampling"]


def section(folder: Path) -> str:
    """Of contests.json, as repeats.py wrote it: medians over the runs of the least times."""
    return parts(json.loads((folder / "contests.json").read_text())["benchmarks"])


def parts(benchmarks: list[dict]) -> str:
    """Arm by arm."""
    rows, seconds = [], {}
    for one in benchmarks:
        if one["extra_info"]["role"] == "part":
            part = seconds.setdefault(one["extra_info"]["arm"], {})
            part[one["extra_info"]["part"]] = median(an_item(one))
    for arm, part in seconds.items():
        part["arithmetic"] = part["moves"] - part["numbers"]
        part["sum"] = sum(part[name] for name in PARTS)
        times = [duration(part[name]) for name in (*PARTS, "sum", "filter", "circular functions")]
        rows.append([arm, *times, f"{part['filter'] / part['numbers']:.1f}"])
    header = [
        "arm",
        *PARTS,
        "sum",
        "filter",
        "sines, cosines and roots alone",
        "filter over numbers",
    ]
    return (
        "Of a particle and step, each part done alone; the numbers are those that the law draws, "
        f"block by block:\n\n{table(header, rows)}"
    )
