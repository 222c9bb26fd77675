"""From a laboratory's files to its results: the commands of data/raw/README.md on exports of the
synthetic laboratory and on the logs of a real robot; forces without a robot.
"""

import json
import os
import shutil
from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf
from project_copy import (
    EVERY_COMMAND,
    ROOT,
    contents,
    copy_reproduced,
    edit_text,
    error_line,
    in_one_process,
    make_writable,
    planned,
    run,
    set_parameters,
    shell_commands,
    succeeds,
)

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.verdicts.run import read_run

pytestmark = pytest.mark.slow

# facts that the files do not state, here from the two files of the synthetic dataset
SYNTHETIC = ("data/raw/youbot/dataset.yaml", "pipeline/conf/dataset/youbot.yaml")
WRITTEN = ("data/raw/lab/dataset.yaml", "pipeline/conf/dataset/lab.yaml")
INFERRED = {*"mocap.training mocap.test mocap.unit motion.rate motion.steps".split()}
INFERRED |= {*"depth.takes depth.index depth.intrinsics depth.width depth.rate".split()}
INFERRED |= {"trajectory", "force.configurations.C1.file"}
RECORDINGS = ROOT.parent / "shared/recordings"


OF_DEPTH = {"articulation", "filter_errors"}


def drawn_figures(project: Path) -> set[str]:
    """The names of the figures of the dataset lab."""
    return {file.stem for file in (project / "reports/lab/figures").glob("*.svg")}


def fill_in(project: Path) -> set[str]:
    """Replace every ??? by the synthetic dataset's value; return the keys."""
    filled = set()
    for synthetic, written in zip(SYNTHETIC, WRITTEN, strict=True):
        values = OmegaConf.load(project / written)
        facts = OmegaConf.load(project / synthetic)

        for key in OmegaConf.missing_keys(values):
            OmegaConf.update(values, key, OmegaConf.select(facts, key), merge=False)
            filled.add(key)
        OmegaConf.save(values, project / written)
    return filled


def test_exports_become_figures_and_a_changed_export_is_noticed(reproduced, tmp_path):
    project = copy_reproduced(reproduced, tmp_path / "project")
    exports = (project / "data/raw/youbot/recordings").rename(tmp_path / "exports")
    make_writable(exports)
    inspect, new_dataset, check, reproduce, inspect_json = shell_commands(
        "data/raw/README.md",
    )
    findings = json.loads(succeeds(*inspect_json, cwd=project))
    formats = {finding["format"] for finding in findings}
    assert "unknown" not in formats
    assert not any(finding["stops"] for finding in findings)
    assert "optitrack/train_*.csv (12)" in succeeds(*inspect, cwd=project)
    succeeds(*new_dataset, cwd=project)
    set_parameters(project, dataset="lab", models="[additive]")

    checked = run(*check, cwd=project)
    assert checked.returncode == 1
    assert "about.subject: ??? must be replaced" in checked.stdout
    message = error_line(run(*reproduce, cwd=project))
    assert "configure: fill in about.subject, " in message
    assert "mocap.base.position, " in message and WRITTEN[0][5:] in message
    assert not INFERRED & fill_in(project)
    succeeds(*check, cwd=project)
    stages, _ = in_one_process(project, "publish")
    succeeds("dvc", "commit", "--force", *stages, cwd=project)
    assert {"joint_std", "wrench_error_histograms"} | OF_DEPTH <= drawn_figures(project)
    assert OmegaConf.load(project / "data/config.yaml").dataset.name == "lab"

    # a take that the model was not fitted to
    commands = "export additive", f"assess '{exports / 'optitrack/test_001.csv'}'"
    assessed = succeeds("python", "-c", EVERY_COMMAND, *commands, cwd=project)
    assert "test_001 behaves as the 15 takes" in assessed

    # a file that changed is noticed where the recordings are read in place
    edit_text(next((exports / "optitrack").glob("train_*.csv")), "cut short")
    succeeds("dvc", "repro", "files", cwd=project)
    # the inventory always runs, score reads the folder for the truth, predict reads all motions of
    # the files, and the report was not made before; of the parts the motion alone has changed
    plan = planned(succeeds("dvc", "repro", "--dry", "report", cwd=project))
    inventory = "data/raw/lab/dvc.yaml:inventory"
    assert {*plan} == {inventory, "ingest@motion", "predict", "score", "report"}


def test_logs_of_a_real_robot_become_a_report_beside_that_of_another_dataset(
    reproduced,
    tmp_path,
):
    if not (RECORDINGS / "lwr4").is_dir():
        pytest.skip("the recordings of the real robots are not beside the project")
    folder = copy_reproduced(reproduced, tmp_path / "project")
    youbot = contents(folder / "reports/youbot")
    exports = os.path.relpath(RECORDINGS / "lwr4", folder)
    # two facts that no file states, and the number of the motion in the printed table
    facts = "--set 'about.subject=an arm' --set 'about.source=its logs' --suggested"
    commands = [
        f"inspect {exports}",
        f"new-dataset lab --from {exports} {facts}",
        "new-dataset lab --motion 1",
        "check lab",
    ]
    succeeds("python", "-c", EVERY_COMMAND, *commands, cwd=folder)
    set_parameters(folder, dataset="lab", models="[additive]")
    stages, printed = in_one_process(folder)
    assert "data/raw/lab/dvc.yaml:inventory" in stages
    for words in (
        "no motion capture",
        "the dataset has no depth camera",
        "nothing to filter",
        "ingest: the dataset has no depth;",
        "ingest: the dataset has no force;",
    ):
        assert words in printed

    dataset = OmegaConf.load(folder / "data/config.yaml").dataset
    assert dataset.name == "lab"
    assert len(dataset.joint_log.start) == len(dataset.robot.joints)
    assert "joint_std" in drawn_figures(folder)
    assert not drawn_figures(folder) & {*OF_DEPTH, "kinect_noise", "wrench_density"}
    for page in ("report", "model_card"):
        assert "lab" in (folder / f"reports/lab/{page}.md").read_text()
    assert contents(folder / "reports/youbot") == youbot


FORCES_ALONE = """record towing, ingest motion, ingest depth, ingest force, track, articulate,
fit additive, filter additive, predict, wrench, readings, score, figures, publish, report"""
PARAMS = """{dataset: towing, models: [additive], filter: systematic, articulation: least_squares,
simulation: one_step, wrench: paper, scale: smoke, compute: serial, seed: 5, overrides: {}}
"""


def test_forces_alone_go_through_every_stage_and_are_scored_on_all_rows(
    tmp_path,
    monkeypatch,
):
    monkeypatch.chdir(tmp_path)
    for name in ("pipeline", "dvc.yaml", "pyproject.toml"):
        Path(name).symlink_to(ROOT / name)
    raw = Path("data/raw/towing")
    raw.mkdir(parents=True)
    shutil.copy(ROOT / raw / "dvc.yaml", raw)
    Path("params.yaml").write_text(PARAMS)
    config.write_config(Path("params.yaml"))
    for stage in FORCES_ALONE.split(","):
        name, *item = stage.split()
        import_module(f"pipeline.stages.{name}").run(*item)
    files = {file.stem for file in (raw / "recordings/force").iterdir()}
    assert files == {"T3", "T4", "T6"}

    forces = contracts.read("force", Path("data/ingest/force"))
    rows = ["fx", "fy", "fz", "mx", "my", "mz"]
    assert list(forces)[2:] == rows
    results = read_run(Path("reports/datasets/towing.json"))
    assert results.synthetic and results.joints == [] == list(results.task)
    moments = results.tables["force_moments"].set_index(["configuration", "source"])
    for name in files:
        measured = moments.loc[name, "measured"]
        modelled = moments.loc[name, "modelled"]
        size = np.sqrt([measured[f"var_{row}"] for row in rows])
        # a record of some seconds has few independent samples
        assert np.all(np.abs(measured[rows] - modelled[rows]) < 2 * size), name

    forms = results.tables["sigma_s"].groupby(["system_class", "agents", "form"])
    entries = forms["entry"].size()
    assert entries.loc["T6"].tolist() == [21, 21]  # of six rows
    assert {*entries.loc["study"]} == {3}  # of two rows
    drawn = json.loads(Path("reports/towing/captions.json").read_text())
    assert "wrench_marginals" in drawn and "wrench_density" not in drawn
    # the numbers of a trial are not decided
    decided = pd.read_csv("reports/towing/claims.csv")
    assert "towing" not in {*decided["dataset"]}
