"""Writes reports/benchmarks.md from what the benchmarks left in reports/benchmarks: ``python
tests/benchmarks/summary.py``.
"""

from __future__ import annotations

import json
from pathlib import Path

import contests_section
import equal_bytes_section
import first_use_section
import growth_section
import imports_section
import parts_section
import scale_section
import whole_section

REPORTS = Path(__file__).parents[2] / "reports"
# in the order of the report; each has a TITLE, and says with section(FOLDER) what stands below it
SECTIONS = (
    contests_section,
    parts_section,
    first_use_section,
    imports_section,
    growth_section,
    scale_section,
    equal_bytes_section,
    whole_section,
)


def report(folder: Path) -> str:
    """The text of reports/benchmarks.md from the files in ``folder``."""
    machine = json.loads((folder / "contests.json").read_text())["machine_info"]["machine"]
    sections = "\n".join(f"\n## {one.TITLE}\n\n{one.section(folder)}" for one in SECTIONS)
    return f"""# Benchmarks

Written by `make bench`, measured side by side on one machine: {machine}. On another the times
differ, the ratios less. A peer runs in its own process and environment, free of the settings that
hold our own arithmetic to equal bits.
{sections}
"""


if __name__ == "__main__":
    (REPORTS / "benchmarks.md").write_text(report(REPORTS / "benchmarks"))
    print(f"bench: {REPORTS / 'benchmarks.md'}")
