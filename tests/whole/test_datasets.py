"""From a laboratory's files to its results: the commands of data/raw/README.md on exports of the
synthetic laboratory and on the logs of real robots; and a new take assessed against a fit.
"""

from __future__ import annotations

import json
import os
import re
import shlex
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from project_copy import (
    ROOT,
    SMOKE,
    copy_project,
    copy_reproduced,
    edit_text,
    error_line,
    planned,
    run,
    set_parameters,
    succeeds,
)

pytestmark = pytest.mark.slow

# what a laboratory knows and its files do not say, here from the datasheet and the option file of
# the synthetic one
SYNTHETIC = ("data/raw/youbot/dataset.yaml", "pipeline/conf/dataset/youbot.yaml")
WRITTEN = ("data/raw/lab/dataset.yaml", "pipeline/conf/dataset/lab.yaml")
INFERRED = {
    *("mocap.training", "mocap.test", "mocap.unit", "trajectory", "motion.rate", "motion.steps"),
    *(f"depth.{key}" for key in ("takes", "index", "intrinsics", "width", "rate")),
    "force.configurations.C1.file",
}
RECORDINGS = ROOT.parent / "shared/recordings"
# what nobody but the researcher knows, the number of the motion, and the models of a run
REAL = {
    "ur5": (
        {"robot.urdf": "pipeline/arm/ur5.urdf", "robot.tool": "flange"},
        "[additive, wishart]",
    ),
    "lwr4": ({}, "[additive]"),
}


def pipeline(folder: Path, *words: object) -> str:
    return succeeds("python", "-m", "pipeline", *map(str, words), cwd=folder)


def documented(project: Path) -> list[list[str]]:
    """The commands of the page, in their order."""
    text = (project / "data/raw/README.md").read_text()
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    return [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]


def fill_in(project: Path) -> set[str]:
    """Replace every ??? by what the synthetic laboratory knows; the keys that were filled in."""
    filled = set()
    for known, written in zip(SYNTHETIC, WRITTEN, strict=True):
        values, known_values = OmegaConf.load(project / written), OmegaConf.load(project / known)
        for key in OmegaConf.missing_keys(values):
            OmegaConf.update(values, key, OmegaConf.select(known_values, key), merge=False)
            filled.add(key)
        OmegaConf.save(values, project / written)
    return filled


def test_exports_become_figures_and_a_changed_export_is_noticed(reproduced, tmp_path):
    project = copy_reproduced(reproduced, tmp_path / "project")
    exports = (project / "data/raw/youbot/recordings").rename(tmp_path / "exports")
    for file in exports.rglob("*"):  # what DVC linked from its cache is read-only
        if file.is_file():
            file.chmod(0o644)
    inspect, new_dataset, check, reproduce, inspect_json = documented(project)
    findings = json.loads(succeeds(*inspect_json, cwd=project))
    assert not any(one["stops"] or one["format"] == "unknown" for one in findings)
    assert "optitrack/train_*.csv (12)" in succeeds(*inspect, cwd=project)
    succeeds(*new_dataset, cwd=project)
    set_parameters(project, dataset="lab", models="[additive]")

    checked = run(*check, cwd=project)
    assert checked.returncode == 1 and "about.subject: ??? must be replaced" in checked.stdout
    message = error_line(run(*reproduce, cwd=project))
    for words in ("configure: fill in about.subject, ", "mocap.base.position, ", WRITTEN[0][5:]):
        assert words in message
    # what files tell was found: nobody had to say it
    assert not INFERRED & fill_in(project)
    succeeds(*check, cwd=project)
    succeeds(*reproduce, "publish", cwd=project)
    drawn = {file.stem for file in (project / "reports/lab/figures").glob("*.svg")}
    assert {"joint_std", "articulation", "filter_errors", "wrench_error_histograms"} <= drawn
    assert OmegaConf.load(project / "data/config.yaml").dataset.name == "lab"

    # a file that changed is noticed where the recordings are read in place
    edit_text(next((exports / "optitrack").glob("train_*.csv")), "cut short")
    succeeds("dvc", "repro", "files", cwd=project)
    # the inventory is looked at in every run, score looks for a truth in its folder, predict reads
    # all motions of the files, and the report was not asked for; of the parts the motion alone
    plan = planned(succeeds("dvc", "repro", "--dry", "report", cwd=project))
    inventory = "data/raw/lab/dvc.yaml:inventory"
    assert {*plan} == {inventory, "ingest@motion", "predict", "score", "report"}


@pytest.mark.parametrize("robot", REAL)
def test_logs_of_a_real_robot_become_a_model_card(robot, tmp_path):
    if not (RECORDINGS / robot).is_dir():
        pytest.skip("the recordings of the real robots are not here")
    folder, (known, models) = tmp_path / "project", REAL[robot]
    copy_project(folder)
    set_parameters(folder, **SMOKE | {"dataset": "lab", "models": models})
    exports = os.path.relpath(RECORDINGS / robot, folder)
    known = known | {"about.subject": "an arm", "about.source": "its logs"}
    given = [word for key, value in known.items() for word in ("--set", f"{key}={value}")]
    pipeline(folder, "inspect", exports)
    # the table of motions, by which the number is chosen
    pipeline(folder, "new-dataset", "lab", "--from", exports, *given, "--suggested")
    pipeline(folder, "new-dataset", "lab", "--motion", "1")
    pipeline(folder, "check")
    succeeds("dvc", "repro", "report", cwd=folder)
    dataset = OmegaConf.load(folder / "data/config.yaml").dataset
    assert dataset.name == "lab" and len(dataset.joint_log.start) == len(dataset.robot.joints)
    card = (folder / "reports/lab/model_card.md").read_text()
    assert "lab" in card and "additive" in card


def recorded(folder: Path, sway: list[float], seed: int) -> Path:
    """A copy of the project whose laboratory has recorded an arm that sways by ``sway``."""
    copy_project(folder)
    # no depth frames are read
    overrides = f"{{dataset: {{depth: null, laboratory: {{dynamics: {{sway_std: {sway}}}}}}}}}"
    chosen = {"scale": "smoke", "compute": "serial", "models": "[additive]"}
    set_parameters(folder, **chosen, seed=seed, overrides=overrides)
    for words in ("choose", "configure", "record youbot"):
        pipeline(folder, *words.split())
    return folder


def test_a_new_take_is_told_from_one_of_an_arm_that_sways_three_times_as_far(tmp_path):
    sway = [0.0003, 0.0017, 0.0332]
    project = recorded(tmp_path / "project", sway, 2017)
    for stage in ("files", "ingest motion", "ingest depth", "track", "fit additive"):
        pipeline(project, *stage.split())
    pipeline(project, "export", "additive")
    # sessions of their own, whose sensors and arm are drawn anew
    for name, factor in (("usual", 1), ("other", 3)):
        session = recorded(tmp_path / name, [factor * each for each in sway], 5)
        take = session / "data/raw/youbot/recordings/optitrack/test_001.csv"
        said = pipeline(project, "assess", take.rename(tmp_path / f"{name}.csv"))
        verdict = "behaves" if name == "usual" else "does NOT behave"
        assert f"{name} {verdict} as the 16 takes" in said
    assert (project / "data/assess/usual.png").stat().st_size > 10_000
