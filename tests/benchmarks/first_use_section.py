"""What the report says of the first use of compiled functions."""

from __future__ import annotations

import json
from pathlib import Path

from writing import table, verdict

TITLE = "First use"


def section(folder: Path) -> str:
    """Of compilation.json."""
    measured = json.loads((folder / "compilation.json").read_text())
    rows = [
        [stage, f"{seconds:.1f} s"] for stage, seconds in measured["stages"].items() if seconds > 0
    ]
    return (
        "With nothing compiled before, all stages, each a process of its own, compile for "
        f"{measured['seconds']:.1f} s of processor time (< {measured['limit']} s: "
        f"{verdict(measured['seconds'] < measured['limit'])}), by the medians of "
        f"{measured['rounds']} rounds:\n\n{table(['stage', 'compiling'], rows)}"
    )
