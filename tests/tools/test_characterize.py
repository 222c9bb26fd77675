"""From a folder of logs to the model card and the exported model in one command without an edit."""

import re
from pathlib import Path

import numpy as np
import pytest
from joint_logs import write_movement
from numpy.testing import assert_allclose
from source_code import ROOT

from pipeline.__main__ import tool_call
from pipeline.core.errors import ConfigError
from pipeline.models import load
from pipeline.tools.characterize import command

RECORDINGS = ROOT.parent / "shared/recordings"


def test_a_folder_of_logs_alone_becomes_a_card_and_a_model(
    tmp_path,
    monkeypatch,
    capsys,
):
    logs = tmp_path / "bench"
    write_movement(logs / "move_1", 3, noise=5e-5, late=2e-3)
    write_movement(logs / "move_2", 2, noise=5e-5, seed=2, offset=0.2)
    (logs / "notes.txt").write_text("recorded on a Monday\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "FAMILY", ("joint_step", "joint_step_t"))
    tool_call("characterize", [str(logs), "--model", "joint_step"])()
    said = capsys.readouterr().out
    assert "! move_1, move_2: joint_log.angle_unit: rad (" in said
    assert "run move_1_1: " in said
    assert re.search(r"lag (1.9|2.0)\d to (1.9|2.0)\d ms taken out", said)
    assert "run move_2_2: " in said and "of motion 4" in said
    noise = re.search(r"noise of a measured angle: ([\d.]+) µrad", said)
    assert float(noise[1]) == pytest.approx(50, rel=0.1)

    card = Path("reports/bench/model_card.md").read_text()
    # white noise does not add up: steps of it are no law half a second ahead
    assert "**No model for another motion**" in card and "5 runs of 4 motion(s)" in card
    assert Path("reports/bench/figures/held_out_error.png").is_file()

    model = load("data/export/bench_joint_step.json", period=0.008)
    std = np.sqrt(np.diag(model.law.covariance_of_joint_step(np.full(6, 5e-3))))
    assert_allclose(std, np.sqrt(2) * 5e-5, rtol=0.2)
    with pytest.raises(
        ConfigError,
        match="pose_noise must be a number > 0 in rad, got 'some'",
    ):
        tool_call("characterize", [str(logs), "--set", "motion.pose_noise=some"])()
    with pytest.raises(
        ConfigError,
        match="model wishart needs a Jacobian: give --urdf",
    ):
        tool_call("characterize", [str(logs), "--model", "wishart"])()


@pytest.mark.parametrize("name", ["../outside", "/outside", "a/b", ""])
def test_a_name_that_is_a_path_is_refused(name, tmp_path):
    with pytest.raises(ConfigError, match="cannot name a dataset"):
        tool_call("characterize", [str(tmp_path), "--name", name])()


def test_a_folder_without_a_usable_log_names_the_reason(tmp_path):
    table = np.arange(400).reshape(100, 4) / 100
    np.savetxt(
        tmp_path / "a.csv",
        table,
        delimiter=",",
        header="t,q_1,q_2,q_3",
        comments="",
    )
    with pytest.raises(
        ConfigError,
        match=r"can be used: a\.csv: no commanded angles.* --urdf FILE",
    ):
        tool_call("characterize", [str(tmp_path)])()

    t = np.linspace(0, 6, 601)
    first = 0.5 * np.sin(t)
    second = 0.8 * np.sin(1.7 * t) ** 2
    labels = "time (s),target_1 (rad),target_2 (rad),actual_1 (rad),actual_2 (rad)"
    exchanged = [second + 1e-4 * np.sin(9 * t), first]
    table = np.stack([t, first, second, *exchanged], axis=1)
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=labels, comments="")
    with pytest.raises(ConfigError, match=r"by its order: .* in the order \[2, 1\]"):
        tool_call("characterize", [str(tmp_path)])()


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["ur5", "lwr4", "kr300"])
def test_the_logs_of_a_real_arm_take_one_command(robot, tmp_path, monkeypatch, capsys):
    if not (RECORDINGS / robot).is_dir():
        pytest.skip("the recordings of the real robots are not here")
    monkeypatch.chdir(tmp_path)
    tool_call("characterize", [str(RECORDINGS / robot), "--name", "lab"])()
    said = capsys.readouterr().out
    assert "**Model for another motion: " in said and "Traceback" not in said

    (file,) = Path("data/export").glob("lab_*.json")
    assert load(file).law.traits.memory
    if robot == "kr300":
        assert all(
            f"not used: joint_{j}: its command moves by" in said for j in (4, 5, 6)
        )


def test_what_is_not_there_is_refused_before_anything_is_written(root, logs):

    with pytest.raises(ConfigError, match="no such folder of recordings"):
        tool_call("characterize", ["absent"])()
    with pytest.raises(ConfigError, match="no model 'laplace'; there are"):
        tool_call("characterize", [str(logs), "--model", "laplace"])()
    with pytest.raises(ConfigError, match="no scale 'tiny'; there are "):
        tool_call("characterize", [str(logs), "--scale", "tiny"])()
    assert [file for file in root.rglob("*") if file.is_file()] == [
        root / "params.yaml",
    ]
