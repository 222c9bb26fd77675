"""From a laboratory's files to its results: the commands of data/raw/README.md on exports of the
synthetic laboratory and on the logs of a real robot; forces without a robot; and a new take
assessed against a fit.
"""

from __future__ import annotations

import json
import os
import re
import shlex
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
    SMOKE,
    copy_project,
    copy_reproduced,
    edit_text,
    error_line,
    in_one_process,
    planned,
    run,
    set_parameters,
    succeeds,
)

from pipeline.core import config, contracts
from pipeline.verdicts.decision import NO_EVIDENCE
from pipeline.verdicts.run import read_run

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


def pipeline(folder: Path, *commands: str) -> str:
    """Run the ``commands`` in one process; return what they print."""
    return succeeds("python", "-c", EVERY_COMMAND, *commands, cwd=folder)


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
    stages, _ = in_one_process(project, "publish")
    succeeds("dvc", "commit", "--force", *stages, cwd=project)
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


def test_logs_of_a_real_robot_become_a_model_card(tmp_path):
    if not (RECORDINGS / "lwr4").is_dir():
        pytest.skip("the recordings of the real robots are not here")
    folder = tmp_path / "project"
    copy_project(folder)
    set_parameters(folder, **SMOKE | {"dataset": "lab", "models": "[additive]"})
    exports = os.path.relpath(RECORDINGS / "lwr4", folder)
    # what nobody but the researcher knows, and the number of the motion in the printed table
    given = "--set 'about.subject=an arm' --set 'about.source=its logs' --suggested"
    pipeline(folder, f"inspect {exports}", f"new-dataset lab --from {exports} {given}")
    pipeline(folder, "new-dataset lab --motion 1", "check")
    succeeds("dvc", "repro", "report", cwd=folder)
    dataset = OmegaConf.load(folder / "data/config.yaml").dataset
    assert dataset.name == "lab" and len(dataset.joint_log.start) == len(dataset.robot.joints)
    card = (folder / "reports/lab/model_card.md").read_text()
    assert "lab" in card and "additive" in card


def test_a_new_take_is_told_from_one_of_an_arm_that_sways_three_times_as_far(tmp_path):
    project = tmp_path / "project"
    copy_project(project)
    takes = project / "data/raw/youbot/recordings/optitrack"
    chosen = {"scale": "smoke", "compute": "serial", "models": "[additive]"}

    def recorded(factor: float, seed: int, *then: str) -> str:
        """Record an arm that sways by so much; no depth frames are read."""
        sway = [factor * each for each in (0.0003, 0.0017, 0.0332)]
        overrides = f"{{dataset: {{depth: null, laboratory: {{dynamics: {{sway_std: {sway}}}}}}}}}"
        set_parameters(project, **chosen, seed=seed, overrides=overrides)
        return pipeline(project, "choose", "configure", "record youbot", *then)

    # sessions of their own, whose sensors and arm are drawn anew
    for name, factor in (("usual", 1), ("other", 3)):
        recorded(factor, 5)
        (takes / "test_001.csv").rename(tmp_path / f"{name}.csv")
    stages = ("files", "ingest motion", "ingest depth", "track", "fit additive", "export additive")
    recorded(1, 2017, *stages)
    for name, verdict in (("usual", "behaves"), ("other", "does NOT behave")):
        said = pipeline(project, f"assess '{tmp_path / name}.csv'")
        assert f"{name} {verdict} as the 16 takes" in said
    assert (project / "data/assess/usual.png").stat().st_size > 10_000


FORCES_ALONE = ["record towing", *(f"ingest {part}" for part in ("motion", "depth", "force"))]
FORCES_ALONE += ["track", "articulate", "fit additive", "filter additive", "fit gaussian"]
FORCES_ALONE += ["filter gaussian", "predict", "wrench", "readings", "score", "figures", "publish"]
FORCES_ALONE += ["report"]
PARAMS = """dataset: towing
models: [additive, gaussian]
filter: systematic
articulation: least_squares
simulation: one_step
wrench: paper
scale: smoke
compute: serial
seed: 5
overrides: {}
"""


def test_forces_alone_go_through_every_stage_and_are_scored_on_all_rows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("pipeline", "dvc.yaml", "reports/claims.yaml"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).symlink_to(ROOT / name)
    raw = Path("data/raw/towing")
    raw.mkdir(parents=True)
    shutil.copy(ROOT / raw / "dvc.yaml", raw)
    Path("params.yaml").write_text(PARAMS)
    config.write_config(Path("params.yaml"))
    for stage in FORCES_ALONE:
        name, _, item = stage.partition(" ")
        import_module(f"pipeline.stages.{name}").run(*filter(None, [item]))
    recorded = [file.name for file in (raw / "recordings/force").iterdir()]
    assert sorted(recorded) == ["T3.csv", "T4.csv", "T6.csv"]
    forces = contracts.read("force", Path("data/ingest/force"))
    assert list(forces)[2:] == ["fx", "fy", "fz", "mx", "my", "mz"]
    run = read_run(Path("reports/datasets/towing.json"))
    assert run.synthetic and run.joints == [] == list(run.task)
    moments = run.tables["force_moments"].set_index(["configuration", "source"])
    for name in ("T3", "T4", "T6"):
        measured, modelled = (moments.loc[(name, s)] for s in ("measured", "modelled"))
        rows = ["fx", "fy", "fz", "mx", "my", "mz"]
        size = np.sqrt([measured[f"var_{row}"] for row in rows])
        # a record of some seconds has few independent samples
        assert np.all(np.abs(measured[rows] - modelled[rows]) < 2 * size), name
    sigma = run.tables["sigma_s"].set_index(["system_class", "form"])
    assert sigma.loc[("T6", "full")].notna().all()
    assert pd.isna(sigma.loc[("study", "full"), "s66"].iloc[0])
    drawn = json.loads(Path("reports/towing/captions.json").read_text())
    assert {"wrench_planes", "wrench_marginals"} < set(drawn) and "wrench_density" not in drawn
    decided = json.loads(Path("reports/towing/claims.json").read_text())["claims"]
    verdicts = [c["datasets"]["towing"] for c in decided if "towing" in c["datasets"]]
    of_joints = [verdict["verdict"] for verdict in verdicts if not verdict["cases"]]
    assert of_joints and {*of_joints} == {NO_EVIDENCE}
