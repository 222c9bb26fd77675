"""A new take of the laboratory's arm behaves as those it was fitted to; one of an arm that sways
three times as far does not.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from project_copy import copy_project, run, set_parameters

pytestmark = pytest.mark.slow

# no depth frames are read
OVERRIDES = "{{dataset: {{depth: null, laboratory: {{dynamics: {{sway_std: {}}}}}}}}}"
SWAY, MORE = "[0.0003, 0.0017, 0.0332]", "[0.0009, 0.0051, 0.0996]"


def recorded(folder: Path, sway: str, seed: int) -> Path:
    """A copy of the project whose laboratory has recorded an arm that sways by ``sway``."""
    copy_project(folder)
    chosen = {"scale": "smoke", "compute": "serial", "models": "[additive]", "seed": seed}
    set_parameters(folder, **chosen, overrides=OVERRIDES.format(sway))
    call(folder, "choose")
    call(folder, "configure")
    call(folder, "record", "youbot")
    return folder


def call(folder: Path, *words: object) -> str:
    done = run("python", "-m", "pipeline", *map(str, words), cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def take_of(folder: Path) -> Path:
    return folder / "data/raw/youbot/recordings/optitrack/test_001.csv"


def test_a_new_take_is_told_from_one_of_another_arm(tmp_path):
    project = recorded(tmp_path / "project", SWAY, 2017)
    for stage in ("files", "ingest motion", "ingest depth", "track", "fit additive"):
        call(project, *stage.split())
    call(project, "export", "additive")
    # a session of its own, whose sensors and arm are drawn anew
    usual = take_of(recorded(tmp_path / "usual", SWAY, 5)).rename(tmp_path / "usual.csv")
    other = take_of(recorded(tmp_path / "other", MORE, 5)).rename(tmp_path / "other.csv")
    said = call(project, "assess", usual)
    assert "usual behaves as the 16 takes it is compared with, 12 of them" in said
    assert (project / "data/assess/usual.png").stat().st_size > 10_000
    assert "other does NOT behave as the 16 takes" in call(project, "assess", other)
