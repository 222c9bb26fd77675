"""From a laboratory's exports to its figures: nothing but the commands of data/raw/README.md, and the values that no file states."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from conftest import run
from omegaconf import OmegaConf
from smoke import SMOKE, copy_project, set_parameters

pytestmark = pytest.mark.slow

# what a laboratory knows and its files do not say, here from the datasheet and the option file of the synthetic one
KNOWN = ("data/raw/youbot/dataset.yaml", "pipeline/conf/dataset/youbot.yaml")
WRITTEN = ("data/raw/lab/dataset.yaml", "pipeline/conf/dataset/lab.yaml")


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A project beside which the exports of a laboratory lie."""
    folder = tmp_path_factory.mktemp("laboratory") / "project"
    copy_project(folder)
    set_parameters(folder, **SMOKE)
    recorded = run("dvc", "repro", "data/raw/youbot/dvc.yaml", cwd=folder)
    assert recorded.returncode == 0, recorded.stdout + recorded.stderr
    (folder / "data/raw/youbot/recordings").rename(folder.parent / "exports")
    return folder


def documented(project: Path) -> list[list[str]]:
    """The commands of the page, in their order."""
    blocks = re.findall(r"```sh\n(.*?)```", (project / "data/raw/README.md").read_text(), re.DOTALL)
    return [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]


def fill_in(project: Path) -> list[str]:
    """Replace every ??? by what the synthetic laboratory knows; the keys that were filled in."""
    filled = []
    for known, written in zip(KNOWN, WRITTEN, strict=True):
        values, given = OmegaConf.load(project / written), OmegaConf.load(project / known)
        for key in sorted(OmegaConf.missing_keys(values)):
            OmegaConf.update(values, key, OmegaConf.select(given, key), merge=False)
            filled.append(key)
        OmegaConf.save(values, project / written)
    return filled


def test_exports_become_figures_and_a_changed_export_is_noticed(project):
    inspect, new_dataset, reproduce, inspect_json = documented(project)
    findings = json.loads(run(*inspect_json, cwd=project).stdout)
    assert not [finding for finding in findings if finding["stops"] or finding["format"] == "unknown"]

    assert "optitrack/train_*.csv (12)" in run(*inspect, cwd=project).stdout
    written = run(*new_dataset, cwd=project)
    assert written.returncode == 0, written.stderr
    set_parameters(project, dataset="lab", models="[additive]")

    unfilled = run(*reproduce, cwd=project)
    message = [line for line in unfilled.stderr.splitlines() if line.startswith("error:")]
    assert unfilled.returncode != 0 and len(message) == 1
    assert (
        "configure: fill in about.subject, " in message[0]
        and "mocap.base.position, " in message[0]
        and "raw/lab/dataset.yaml" in message[0]
    )

    filled = fill_in(project)
    # what files tell was found: nobody had to say it
    found = {
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
    assert not ({*found, "motion.rate", "motion.steps", "force.configurations.C1.file"} & set(filled))
    done = run(*reproduce, "figures", cwd=project)
    assert done.returncode == 0, done.stdout + done.stderr
    drawn = {file.stem for file in (project / "reports/figures").glob("*.svg")}
    assert {"joint_std", "articulation", "filter_errors", "wrench_error_histograms", "cable_robot"} <= drawn
    assert OmegaConf.load(project / "data/config.yaml").dataset.name == "lab"

    # a file that changed is noticed where the recordings are read in place
    file = next((project.parent / "exports/optitrack").glob("train_*.csv"))
    file.write_text("cut short")
    assert "modified" in run("dvc", "status", "data/raw/lab/dvc.yaml", cwd=project).stdout
