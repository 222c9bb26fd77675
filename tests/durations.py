"""Durations of the tests, a row a module, in the file that ``--durations-file`` names."""

from __future__ import annotations

import csv
from collections import defaultdict
from pathlib import Path
from time import monotonic

import pytest

STARTED = monotonic()  # s


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option; without it nothing is written."""
    parser.addoption("--durations-file", type=Path, help="write seconds per test module here (CSV)")


def pytest_terminal_summary(terminalreporter, config: pytest.Config) -> None:
    """Write the table: setup, call and teardown of each module's tests, summed over workers; the
    longest first, after the total and the wall clock.
    """
    if (file := config.getoption("durations_file")) is None:
        return
    modules = defaultdict(lambda: {"tests": set(), "slow": 0.0, "other": 0.0})
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                module = modules[report.nodeid.partition("::")[0]]
                module["tests"].add(report.nodeid)
                module["slow" if "slow" in report.keywords else "other"] += report.duration
    rows = [
        (name, len(module["tests"]), module["slow"] + module["other"], module["other"])
        for name, module in modules.items()
    ]
    rows.sort(key=lambda row: (-row[2], row[0]))
    total = ("total", *(sum(column) for column in list(zip(*rows, strict=True))[1:]))
    with file.open("w", newline="", encoding="utf-8") as opened:
        table = csv.writer(opened, lineterminator="\n")
        table.writerow(("module", "tests", "seconds", "seconds without slow tests"))
        table.writerow(("wall clock", total[1], f"{monotonic() - STARTED:.1f}", ""))
        for name, tests, seconds, other in (total, *rows):
            table.writerow((name, tests, f"{seconds:.1f}", f"{other:.1f}"))
