"""From a laboratory's exports to its figures: nothing but the commands of data/raw/README.md, and
the values that no file states.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from project_copy import edit_text, planned, run, set_parameters

pytestmark = pytest.mark.slow

# what a laboratory knows and its files do not say, here from the datasheet and the option file of
# the synthetic one
KNOWN = ("data/raw/youbot/dataset.yaml", "pipeline/conf/dataset/youbot.yaml")
WRITTEN = ("data/raw/lab/dataset.yaml", "pipeline/conf/dataset/lab.yaml")


@pytest.fixture
def project(reproduced: Path, tmp_path: Path) -> Path:
    """A project beside which the exports of a laboratory lie."""
    folder = tmp_path / "project"
    shutil.copytree(reproduced, folder, symlinks=True)
    (folder / "data/raw/youbot/recordings").rename(tmp_path / "exports")
    for file in (tmp_path / "exports").rglob("*"):  # what DVC linked from its cache is read-only
        if file.is_file():
            file.chmod(0o644)
    return folder


def documented(project: Path) -> list[list[str]]:
    """The commands of the page, in their order."""
    blocks = re.findall(r"```sh\n(.*?)```", (project / "data/raw/README.md").read_text(), re.DOTALL)
    return [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]


def fill_in(project: Path) -> list[str]:
    """Replace every ??? by what the synthetic laboratory knows; the keys that were filled in."""
    filled = []
    for known, written in zip(KNOWN, WRITTEN, strict=True):
        values, known_values = OmegaConf.load(project / written), OmegaConf.load(project / known)
        for key in sorted(OmegaConf.missing_keys(values)):
            OmegaConf.update(values, key, OmegaConf.select(known_values, key), merge=False)
            filled.append(key)
        OmegaConf.save(values, project / written)
    return filled


def test_exports_become_figures_and_a_changed_export_is_noticed(project):
    inspect, new_dataset, check, reproduce, inspect_json = documented(project)
    findings = json.loads(run(*inspect_json, cwd=project).stdout)
    assert not [
        finding for finding in findings if finding["stops"] or finding["format"] == "unknown"
    ]

    assert "optitrack/train_*.csv (12)" in run(*inspect, cwd=project).stdout
    written = run(*new_dataset, cwd=project)
    assert written.returncode == 0, written.stderr
    set_parameters(project, dataset="lab", models="[additive]")

    checked = run(*check, cwd=project)
    assert checked.returncode == 1 and "about.subject: ??? must be replaced" in checked.stdout
    unfilled = run(*reproduce, cwd=project)
    message = [line for line in unfilled.stderr.splitlines() if line.startswith("error:")]
    assert unfilled.returncode != 0 and len(message) == 1
    assert (
        "configure: fill in about.subject, " in message[0]
        and "mocap.base.position, " in message[0]
        and "raw/lab/dataset.yaml" in message[0]
    )

    filled = fill_in(project)
    assert (done := run(*check, cwd=project)).returncode == 0, done.stdout
    # what files tell was found: nobody had to say it
    inferred = {
        "mocap.training",
        "mocap.test",
        "mocap.unit",
        "trajectory",
        "depth.takes",
        "depth.index",
        "depth.intrinsics",
        "depth.width",
        "depth.rate",
    }
    assert not (
        {*inferred, "motion.rate", "motion.steps", "force.configurations.C1.file"} & set(filled)
    )
    done = run(*reproduce, "figures", cwd=project)
    assert done.returncode == 0, done.stdout + done.stderr
    drawn = {file.stem for file in (project / "reports/lab/figures").glob("*.svg")}
    assert {
        "joint_std",
        "articulation",
        "filter_closed_loop",
        "filter_errors",
        "wrench_error_histograms",
        "cable_robot",
    } <= drawn
    assert OmegaConf.load(project / "data/config.yaml").dataset.name == "lab"

    # a file that changed is noticed where the recordings are read in place
    file = next((project.parent / "exports/optitrack").glob("train_*.csv"))
    edit_text(file, "cut short")
    noticed = run("dvc", "repro", "files", cwd=project)
    assert noticed.returncode == 0, noticed.stderr
    # the inventory is looked at in every run, score looks for a truth in its folder, and the report
    # was not asked for above; of the parts the motion alone
    plan = run("dvc", "repro", "--dry", cwd=project).stdout
    inventory = "data/raw/lab/dvc.yaml:inventory"
    assert set(planned(plan)) == {inventory, "ingest@motion", "score", "report", "page"}
