"""What the report says of the whole experiment: processor time of the stages against that of the
work itself, and their memory.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

from writing import table, verdict

TITLE = "The whole experiment"


def section(folder: Path) -> str:
    """Of experiment.json."""
    file = folder / "experiment.json"
    if not file.exists():
        return "Not measured yet: `make bench-experiment`."
    measured = json.loads(file.read_text())
    stages, work = measured["stages"], measured["work"]
    rooms: Counter[str] = Counter()
    for of_stage in work.values():
        rooms.update(of_stage)
    total, alone = sum(stage["cpu"] for stage in stages), sum(rooms.values())
    serial, peak = sum(measured["serial"].values()), max(stage["memory"] for stage in stages)
    rows = [
        [
            stage["stage"],
            f"{stage['elapsed']:.1f} s",
            f"{stage['cpu']:.1f} s",
            f"{measured['serial'][stage['stage']]:.1f} s",
            f"{sum(work[stage['stage']].values()):.1f} s",
            f"{stage['memory'] / 1e9:.2f} GB",
        ]
        for stage in stages
    ]
    limit = measured["ratio_limit"]
    ratio, of_serial = (
        f"{seconds / alone:.2f} times the processor time of the work itself "
        f"(≤ {limit}: {verdict(seconds / alone <= limit)}), {seconds:.0f} s against {alone:.0f} s"
        for seconds in (total, serial)
    )
    spare = verdict(peak < measured["memory_limit"])
    parts = ", ".join(f"{room} {seconds:.1f} s" for room, seconds in rooms.items())
    columns = ["stage", "by the clock", "processor time", "in one process", "of it work", "memory"]
    return (
        f"Scale `{measured['scale']}`, {measured['machine']}. The stages take {ratio} ({parts}), "
        f"and {measured['elapsed']:.0f} s by the clock. With `compute: serial`, where none of them "
        f"starts workers, they take {of_serial}. The largest process has {peak / 1e9:.2f} GB "
        f"(< {measured['memory_limit'] / 1e9} GB: {spare}). The work is what passes in the rooms "
        "of `pipeline` when the stages call them, in one process in which everything is imported "
        f"and compiled.\n\n{table(columns, rows)}"
    )
