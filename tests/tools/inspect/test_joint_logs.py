"""Of joint logs it is said whether the command is one of the measured angles, and which option
settles it where it is not; in one archive, or in tables that are named alike.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from written_logs import write_joint_log

from pipeline.formats.joints.log import JointLog
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.layout import layout
from pipeline.tools.inspect.report import as_table
from pipeline.tools.new_dataset.command import dataset_texts
from pipeline.tools.new_dataset.suggestions import Suggestions

UNITS = ("time_unit", "angle_unit")  # no archive states them
TIME = np.arange(1000) * 0.008


def angles(t: np.ndarray) -> np.ndarray:
    """Of three joints that repeat a motion without rest, in rad."""
    return np.stack([np.sin(t), 0.7 * np.cos(1.4 * t), 0.4 * np.sin(0.8 * t + 1)], axis=1)


def asked(finding: Finding) -> set[str]:
    return {option.removeprefix("dataset.joint_log.") for _, option in finding.open}


def archive(file: Path, *, early: float = 0.0, factor: float = 1.0, jitter: float = 0.0) -> None:
    times = 1.5e9 + TIME + np.random.default_rng(1).normal(0, jitter, len(TIME))
    commanded = factor * angles(TIME + early)
    np.savez(file, times=times, positions=angles(TIME), target_positions=commanded)


def test_an_archive_says_what_would_settle_its_traps(tmp_path):
    for number, early in ((1, 0.8), (2, 0.96)):
        archive(tmp_path / f"run_{number}.npz", early=early, factor=np.pi / 180, jitter=3e-4)
    findings = inspect(tmp_path)
    assert [finding.format for finding in findings] == ["NumPy archive of joints"] * 2
    settings = {"clock": "rows", "target_factor": "57.29577951308232", "rest": "0"}
    settings |= {"time_unit": "s", "angle_unit": "rad"}
    assert [finding.facts["settings"] for finding in findings] == [
        settings | {"target_delay": "0.8"},
        settings | {"target_delay": "0.96"},
    ]
    assert asked(findings[0]) == {"clock", "target_factor", "target_delay", "rest", *UNITS}
    # recordings that are settled differently each have a line
    table = as_table(findings, tmp_path)
    assert "run_1.npz" in table and "run_2.npz" in table
    for delay in ("0.8", "0.96"):
        assert table.count(f"suggested is {delay}: dataset.joint_log.target_delay") == 1
    recorded = layout(findings, tmp_path)
    proposed = dataset_texts("lab", "lab", recorded, tmp_path)[0]
    assert "joints: ??? # 3 joints; names of the logged joints" in proposed
    assert "target_delay: ??? # the command differs from the measured angles by" in proposed
    suggestions = Suggestions(recorded, tmp_path)
    assert suggestions.of("joint_log.target_delay", {}) == "{run_1: 0.8, run_2: 0.96}"
    assert suggestions.of("joint_log.clock", {}) == "rows"


def test_an_archive_without_traps_says_that_its_angles_are_a_pair(tmp_path):
    archive(tmp_path / "run_1.npz")
    (finding,) = inspect(tmp_path / "run_1.npz")[:1]
    assert (
        asked(finding) == {"rest", *UNITS}
        and "missed by 0 of the motion" in finding.facts["command"]
    )


def test_tables_named_alike_are_held_against_each_other(tmp_path):
    moved = angles(TIME)
    logs = {"q_actual": moved, "q_target": moved[:, [0, 2, 1]], "qd_target": 0 * moved}
    for name, rows in logs.items():
        write_joint_log(tmp_path / f"{name}.csv", JointLog(TIME, {"actual": rows}, {}))
    findings = {finding.file.stem: finding for finding in inspect(tmp_path)}
    assert "signals" in findings["q_target"].facts["settings"]
    for name in ("q_actual", "qd_target"):
        assert "settings" not in findings[name].facts


@pytest.mark.parametrize(
    ("arrays", "option"),
    [({"q": angles(TIME)}, "signals"), ({"q": angles(TIME), "q_target": angles(TIME)}, "time")],
)
def test_an_archive_whose_names_do_not_say_what_they_are_asks_for_them(tmp_path, arrays, option):
    np.savez(tmp_path / "run_1.npz", **arrays)
    (finding,) = inspect(tmp_path / "run_1.npz")
    assert asked(finding) == {option} and not finding.stops
