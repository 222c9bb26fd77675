"""From a folder of logs to the model card and the exported model in one command, without an edit
and in less than two minutes; the user's own experiment stays as it was.
"""

import json
import time
from pathlib import Path

import numpy as np
import pytest
from joint_logs import write_movement
from project_copy import ROOT, copy_project, run

from pipeline.__main__ import tool_call
from pipeline.core.errors import ConfigError
from pipeline.models import load

RECORDINGS = ROOT.parent / "shared/recordings"
SECONDS = 240  # twice the two minutes that a user waits, as other tests run beside


@pytest.fixture
def project(tmp_path) -> Path:
    folder = tmp_path / "project"
    copy_project(folder)
    return folder


def pipeline(project: Path, command: str, *words: object):
    return run("python", "-m", "pipeline", command, *map(str, words), cwd=project)


@pytest.mark.slow
def test_logs_of_a_bench_become_a_card_and_a_model_that_a_new_recording_is_assessed_by(
    project, tmp_path
):
    logs = tmp_path / "bench"
    write_movement(logs / "move_1", 16, noise=5e-5)
    write_movement(logs / "move_2", 5, noise=5e-5, seed=2, offset=0.2)
    (tmp_path / "arm.urdf").write_text((ROOT / "pipeline/arm/ur5.urdf").read_text())
    words = ["--scale", "smoke", "--model", "scaled_all"]
    refused = pipeline(project, "characterize", logs, *words)
    assert refused.returncode == 1 and "robot.urdf, robot.joints" in refused.stderr
    assert "run again with --ask, or with --set KEY=VALUE" in refused.stderr
    # what is open in the files of the first run is filled in by the second
    done = pipeline(project, "characterize", logs, "--urdf", tmp_path / "arm.urdf", *words)
    assert done.returncode == 0, done.stderr
    assert "about.licence is set to not stated" in refused.stdout
    card = (project / "reports/bench/model_card.md").read_text()
    assert card.index("odel for another motion") < card.index("## Why")
    assert (project / "reports/bench/noise_quantiles.png").is_file()
    file = project / "data/export/bench_scaled_all.json"
    record = json.loads(file.read_text())
    assert record["motions"] == 4 and record["dataset"] == "bench"
    std = np.sqrt(np.diag(load(file).covariance_of_joint_step(np.zeros(6))))
    np.testing.assert_allclose(std, np.sqrt(2) * 5e-5, rtol=0.2)
    # nothing of the stages stands beside the user's own experiment
    assert not [*(project / "data").glob("*/*/parameters.json")]
    # its run is what a new recording is compared with
    write_movement(tmp_path / "new", 3, noise=5e-5, seed=5)
    words = ["--model", "data/export/bench_scaled_all.json"]
    done = pipeline(project, "assess", tmp_path / "new", *words)
    assert done.returncode == 0, done.stderr
    assert "new_1 behaves as the " in done.stdout
    assert (project / "data/assess/new_1.png").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["ur5", "lwr4"])
def test_the_logs_of_a_real_arm_take_one_command(robot, project):
    if not (RECORDINGS / robot).is_dir():
        pytest.skip("the recordings of the real robots are not here")
    begun = time.monotonic()
    words = ("--urdf", f"pipeline/arm/{robot}.urdf", "--name", "lab")
    done = pipeline(project, "characterize", RECORDINGS / robot, *words)
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - begun < SECONDS
    assert "**Model for another motion: " in done.stdout and "about.subject is set" in done.stdout
    (file,) = (project / "data/export").glob("lab_*.json")
    model = load(file)
    if robot == "ur5":
        # joint 1 alone at full speed, where 94 to 108 µrad were recorded and a fit to a motion in
        # which it stood still said 14 867
        std = np.sqrt(model.covariance_of_joint_step(np.array([8e-3, 0, 0, 0, 0, 0]))[0, 0])
        assert 5e-5 < std < 3e-4


def test_what_is_not_there_is_refused_before_anything_is_written(root, logs):
    with pytest.raises(ConfigError, match="no such folder of recordings"):
        tool_call("characterize", ["absent"])()
    with pytest.raises(ConfigError, match="no model 'laplace'; there are additive_all"):
        tool_call("characterize", [str(logs), "--model", "laplace"])()
    with pytest.raises(ConfigError, match="no scale 'tiny'; there are "):
        tool_call("characterize", [str(logs), "--scale", "tiny"])()
    assert [file for file in root.rglob("*") if file.is_file()] == [root / "params.yaml"]
