"""Fixtures that several packages share, and the order and the durations of the tests."""

import faulthandler
import fcntl
import os
import shutil
import sys
from pathlib import Path
from time import monotonic

import pipeline.core.environment  # noqa: F401 - before numpy: it fixes the arithmetic

import pandas as pd  # isort: skip
import pytest
from planar_poses import chain, poses, step  # noqa: F401 - fixtures
from project_copy import GIT, SMOKE, copy_project, set_parameters, succeeds

# a forked child that a damaged file crashes reports by its exit code, without a dump of its stack
os.register_at_fork(after_in_child=faulthandler.disable)
# a user without a home, with private files and the locale of a bare container
BARE = {"home": False, "umask": 0o077, "LANG": "C"}
STARTED = monotonic()  # s
BESIDE = ("shared", "recordings", "beside")  # words of the reason of a skip


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option of the table of durations."""
    parser.addoption("--durations-file", type=Path, help="CSV file of seconds a module")


def pytest_terminal_summary(terminalreporter, config: pytest.Config) -> None:
    """Say in one line how many tests had no recordings beside the project. Write the wall clock,
    the total, and setup, call and teardown of the tests of each module, over all workers, longest
    first.
    """
    stats = terminalreporter.stats
    reasons = [str(report.longrepr) for report in stats.get("skipped", [])]
    absent = [reason for reason in reasons if any(word in reason for word in BESIDE)]
    if absent:
        folder = Path(__file__).parents[2] / "shared"
        terminalreporter.write_line(
            f"{len(absent)} tests need the recordings in {folder}: skipped",
        )
    file = config.getoption("durations_file")
    if file is not None:
        reports = [report for kind in stats.values() for report in kind]
        table = durations([r for r in reports if isinstance(r, pytest.TestReport)])
        table.to_csv(file, index_label="module")


def durations(reports: list[pytest.TestReport]) -> pd.DataFrame:
    """Return tests and seconds of each module, below the wall clock and the total."""
    rows = []
    for report in reports:
        module = report.nodeid.partition("::")[0]
        quick = 0.0 if "slow" in report.keywords else report.duration
        rows.append((module, report.nodeid, report.duration, quick))
    columns = ["module", "tests", "seconds", "seconds without slow tests"]
    modules = pd.DataFrame(rows, columns=columns).groupby("module")
    table = modules.sum(numeric_only=True)
    table.insert(0, "tests", modules["tests"].nunique())
    table = table.sort_values(["seconds", "tests"], ascending=False)

    wall_clock = {"tests": table["tests"].sum(), "seconds": monotonic() - STARTED}
    totals = pd.DataFrame([wall_clock, table.sum()], index=["wall clock", "total"])
    return pd.concat([totals, table]).astype({"tests": int}).round(1)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest tests run first, so that no worker is left with one at the end."""
    items.sort(
        key=lambda item: (
            "reproduced" not in getattr(item, "fixturenames", ()),
            item.get_closest_marker("slow") is None,
        ),
    )


@pytest.fixture(scope="session")
def reproduced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone-like copy of the project under git, in a path with a blank and an umlaut, in which
    ``make repro`` has run on the smoke scale; one for all workers.
    """
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = base / "Prüfstand 1" / "reproduced"
    whole = base / "reproduced.whole"
    # the first worker makes it, others wait
    with (base / "reproduced.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            reproduce(folder)
            whole.touch()
    return folder


def reproduce(folder: Path) -> None:
    """Copy the project, run it and commit what it wrote."""
    shutil.rmtree(folder, ignore_errors=True)
    copy_project(folder)
    (folder / ".dvc/config.local").unlink()
    set_parameters(folder, **SMOKE)
    succeeds(*GIT, "init", "-q", cwd=folder)
    commit(folder, "start")
    # the environment of the tests in place of a new one by make
    (folder / ".venv").mkdir()
    for name in ("bin", "lib", "pyvenv.cfg"):
        (folder / ".venv" / name).symlink_to(Path(sys.prefix) / name)
    printed = succeeds("make", "-o", ".venv/.ready", "repro", cwd=folder, **BARE)
    assert "Results: report reports/youbot/report.md" in printed.splitlines()[-1]
    commit(folder, "reproduced")


def commit(folder: Path, message: str) -> None:
    """Commit every file."""
    succeeds(*GIT, "add", "-A", cwd=folder)
    succeeds(*GIT, "commit", "-qm", message, "--allow-empty", cwd=folder)
