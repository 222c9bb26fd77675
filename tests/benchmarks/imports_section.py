"""What the report says of what every run of a stage takes to import."""

from __future__ import annotations

import json
from pathlib import Path

from writing import table, verdict

TITLE = "Imports"


def section(folder: Path) -> str:
    """Of imports.json."""
    measured = json.loads((folder / "imports.json").read_text())
    half, slowest = (
        f"{measured[name]:.2f} s (≤ {limit} s: {verdict(measured[name] <= limit)})"
        for name, limit in measured["limits"].items()
    )
    rows, libraries = (
        [[name, f"{seconds:.2f} s"] for name, seconds in measured[key].items()]
        for key in ("stages", "libraries")
    )
    return (
        "Where everything is compiled, a stage imports, what its functions import while they run "
        f"included: half of the stages in at most {half} of processor time, the slowest in "
        f"{slowest}, each by the least of {measured['rounds']} rounds:\n\n"
        f"{table(['stage', 'importing'], rows)}\n\n"
        "The libraries alone, each row in a process of its own, below which no stage that uses "
        "them can come:\n\n"
        f"{table(['libraries', 'importing'], libraries)}"
    )
