"""From the raw logs of a made-up robot that repeats its motions to the tables and the process noise; of it everything is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from joint_logs import FILES, ingested, quality

from pipeline import contracts
from pipeline.arm.model import load_arm
from pipeline.errors import ConfigError, RecordingError
from pipeline.instruments.joint_log import JointLog, read_joint_log, read_movement, write_joint_log
from pipeline.stages import ingest, inventory

HOME, AWAY = np.array([1.0, -2.1, -1.9, -0.4, 0.5, 0.0]), np.array([0.8, -3.0, -0.3, -1.5, 0.4, 0.1])


def write_movement(folder: Path, ways: int, *, late: float = 0.0, offset: float = 0.0, noise: float = 0.0, seed: int = 0) -> None:
    """Logs of ``ways`` out and back of 100 steps with 60 rows at rest between; measured angles ``late`` s behind the commanded ones."""
    rng = np.random.default_rng(seed)
    rows = np.arange(60 + 160 * ways)

    def progress(t: np.ndarray) -> np.ndarray:
        way, since = np.divmod(np.clip(t - 60 + 1, 0, None), 160)
        share = (1 - np.cos(np.pi * np.clip(since / 101, 0, 1))) / 2
        return np.where(way % 2 == 0, share, 1 - share)

    target = HOME + offset + progress(rows)[:, None] * (AWAY - HOME)
    speed = np.gradient(target, axis=0) * 125
    since = (rows - 60) % 160
    speed[(rows < 60) | (since >= 100)] = 0.0
    actual = HOME + offset + progress(rows - late * 125)[:, None] * (AWAY - HOME) + rng.normal(0, noise, target.shape)
    folder.mkdir(parents=True)
    for name, values in zip(FILES, (actual, target, speed), strict=True):
        write_joint_log(folder / name, JointLog(rows / 125, values, {}))


MADE_UP = {"movements": "move_*", "start": HOME[1:4].tolist(), "end": AWAY[1:4].tolist(), "rest": 20}


def test_repetitions_are_gathered_over_movements_and_their_mean_command_is_the_trajectory(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, offset=1e-4, noise=1e-5)
    write_movement(tmp_path / "logs/move_2", 1, late=8e-4, offset=-1e-4, noise=1e-5, seed=1)
    log_project("ur5", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run()
    names, q = contracts.stacked(contracts.read("joint_log", Path("data/ingest")), ["q1", "q2", "q3"])
    assert names == ["move_1_1", "move_1_2", "move_1_3", "move_2_1"] and q.shape == (4, 141, 3)
    # three takes 0.1 mrad above and one as much below: 0.05 and 0.15 mrad off their mean
    np.testing.assert_allclose([quality("command_deviation", name) for name in names], [5e-5, 5e-5, 5e-5, 1.5e-4], atol=1e-6)
    np.testing.assert_allclose(np.mean([quality("lag_behind_command", name) for name in names]), 8e-4, atol=2e-5)
    trajectory = contracts.read("trajectory", Path("data/ingest"))
    chain = load_arm("pipeline/arm/ur5.urdf", ["joint_2", "joint_3", "joint_4"], "wrist_centre", {}).chain
    ends = chain.pose(np.array([HOME, AWAY])[:, 1:4] + 5e-5)
    np.testing.assert_allclose(trajectory.loc[[0, 140], ["x", "z", "phi"]].to_numpy(), ends, atol=2e-6)


@pytest.mark.parametrize(
    ("choice", "steps", "words"),
    [
        ({"movements": "run_*"}, 140, "no folder"),
        ({"end": [0.0, 0.0, 0.0]}, 140, r"0 repetition.*-2.1, -1.9, -0.4\] to \[-3.0, -0.3, -1.5\] in 100 steps"),
        ({}, 200, "0 repetition.*in 100 steps"),
        ({"rest": 58}, 216, "0 repetition"),
        ({"movements": "move_2"}, 140, "1 repetition"),
        ({"tolerance": 1e-4}, 140, "another motion"),
    ],
)
def test_too_few_or_unequal_repetitions_are_refused_with_what_there_is(log_project, tmp_path, choice, steps, words):
    write_movement(tmp_path / "logs/move_1", 5, offset=1e-4)
    write_movement(tmp_path / "logs/move_2", 1, offset=-1e-4)
    log_project("ur5", tmp_path / "logs", joint_log=MADE_UP | choice, motion={"steps": steps})
    with pytest.raises(RecordingError, match=words):
        ingest.run()
    assert not Path("data/ingest").exists()


def test_recordings_that_are_not_there_are_refused_by_their_folder(log_project, tmp_path):
    log_project("ur5", tmp_path / "nowhere")
    for run in (ingest.run, lambda: inventory.run(str(tmp_path / "nowhere"))):
        with pytest.raises(RecordingError, match="exist") as caught:
            run()
        assert caught.value.evidence["file"] == tmp_path / "nowhere"


@pytest.mark.parametrize("choice", [{"columns": [2, 3]}, {"columns": [2, 3, 7]}, {"rest": 0}, {"start": [0.0]}])
def test_options_that_name_no_chain_are_refused(log_project, tmp_path, choice):
    with pytest.raises(ConfigError, match="columns"):
        log_project("ur5", tmp_path, joint_log=choice)


def test_the_inventory_tells_changed_recordings_apart(tmp_path, capsys):
    write_movement(tmp_path / "logs/move_1", 1)
    tables = []
    for byte in (b"", b" "):
        with (tmp_path / "logs/move_1" / FILES[0]).open("ab") as file:
            file.write(byte)
        inventory.run(str(tmp_path / "logs"))
        (tmp_path / "inventory.csv").write_text(capsys.readouterr().out)
        tables.append(pd.read_csv(tmp_path / "inventory.csv", index_col="file"))
    before, after = tables
    assert list(before.index) == [f"move_1/{name}" for name in FILES]
    assert list(before.index[(before != after).any(axis=1)]) == [f"move_1/{FILES[0]}"]
    assert (after["bytes"] - before["bytes"]).tolist() == [1, 0, 0]


# the same robot with logs of another form, and with repetitions that were disturbed


def write_table(folder: Path, source: Path, *, speed: bool) -> None:
    """The logs of a movement as one table: degrees, milliseconds, semicolons and decimal commas under labels."""
    values = read_movement(source, FILES, joints=6, rate=125.0)[0]
    names = [f"{what}_{j}" for what in ("ist", "soll", "v") for j in range(1, 7)]
    lines = [";".join(["Zeit", *names[: 18 if speed else 12]])]
    for row, cells in enumerate(np.rad2deg(np.hstack(values[: 3 if speed else 2])).tolist()):
        lines.append(";".join([str(8 * row), *(f"{cell:.8f}" for cell in cells)]).replace(".", ","))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{source.name}.txt").write_text("\n".join([*lines, ""]))


def signals(*names: str) -> dict[str, list[str]]:
    return {{"ist": "actual", "soll": "target", "v": "speed"}[name]: [f"{name}_{j}" for j in range(1, 7)] for name in names}


TABLES = {
    "movements": "*.txt", "actual": None, "target": None, "speed": None, "time": "Zeit", "angle_unit": "deg", "time_unit": "ms",
}  # fmt: skip


def test_one_table_a_movement_gives_what_one_file_a_signal_does(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, noise=1e-5)
    log_project("ur5", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run()
    names, q = ingested()
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=True)
    log_project("ur5", tmp_path / "tables", joint_log=MADE_UP | TABLES | {"signals": signals("ist", "soll", "v")}, motion={"steps": 140})
    ingest.run()
    found = ingested()
    assert found[0] == names
    np.testing.assert_allclose(found[1], q, rtol=0, atol=1e-9)
    assert quality("speed_from_angles", "move") == 0


def test_without_a_speed_the_steps_of_the_commanded_angles_are_it(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, noise=1e-5)
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=False)
    choice = MADE_UP | TABLES | {"signals": signals("ist", "soll"), "rest_speed": 1e-3}
    log_project("ur5", tmp_path / "tables", joint_log=choice, motion={"steps": 140})
    ingest.run()
    names, q = ingested()
    assert names == ["move_1_1", "move_1_2", "move_1_3"] and q.shape == (3, 141, 3)
    assert quality("speed_from_angles", "move") == 1
    np.testing.assert_allclose(q[:, [0, -1]], np.array([[HOME, AWAY]])[:, :, 1:4].repeat(3, axis=0), atol=1e-4)


def push(folder: Path, way: int, size: float) -> None:
    """Push joint 3 aside by ``size`` (rad) in the middle of the given way out (from 0)."""
    log = read_joint_log(folder / FILES[0], joints=6)
    first = 60 + 320 * way + 30
    log.values[first : first + 40, 2] += size * np.sin(np.linspace(0, np.pi, 40))
    write_joint_log(folder / FILES[0], log)


def test_a_disturbed_repetition_is_left_out_and_named_and_the_others_stay_as_they_were(log_project, tmp_path, capsys):
    write_movement(tmp_path / "logs/move_1", 9, noise=5e-5)
    log_project("ur5", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run()
    names, q = ingested()
    assert len(names) == 5 and quality("disturbed_from_row", "move_1") == 0
    push(tmp_path / "logs/move_1", 2, 2e-3)
    ingest.run()
    found = ingested()
    assert found[0] == [name for name in names if name != "move_1_3"]
    np.testing.assert_array_equal(found[1], np.delete(q, 2, axis=0))
    assert quality("disturbed_from_row", "move_1") == 60 + 2 * 320
    assert quality("disturbance", "move_1_3") > 6 > quality("disturbance", "move_1_4")
    assert "disturbed from row 700" in capsys.readouterr().out


def test_a_disturbed_repetition_is_refused_where_the_option_says_so(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 9, noise=5e-5)
    log_project("ur5", tmp_path / "logs", joint_log=MADE_UP | {"disturbed": "refuse"}, motion={"steps": 140})
    ingest.run()
    push(tmp_path / "logs/move_1", 2, 2e-3)
    with pytest.raises(RecordingError, match="from row 700 was disturbed") as caught:
        ingest.run()
    assert caught.value.evidence["take"] == "move_1_3"


def test_a_limit_on_the_residual_finds_what_two_repetitions_cannot_show(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5, noise=5e-5)
    push(tmp_path / "logs/move_1", 1, 2e-3)
    log_project("ur5", tmp_path / "logs", joint_log=MADE_UP | {"residual_limit": 1e-3, "disturbed_beyond": 1e9}, motion={"steps": 140})
    ingest.run()
    assert ingested()[0] == ["move_1_1", "move_1_3"]


@pytest.mark.parametrize(
    "choice",
    [
        {"signals": {"actual": ["a"]}}, {"signals": {"force": list(range(6))}}, {"angle_unit": "grad"}, {"time_unit": "min"},
        {"disturbed": "keep"},
    ],
)  # fmt: skip
def test_options_of_logs_that_mean_nothing_are_refused(log_project, tmp_path, choice):
    with pytest.raises(ConfigError, match=r"dataset\.joint_log"):
        log_project("ur5", tmp_path, joint_log=choice)


def test_a_table_without_the_places_of_its_angles_is_refused(log_project, tmp_path):
    write_movement(tmp_path / "logs/move_1", 5)
    write_table(tmp_path / "tables", tmp_path / "logs/move_1", speed=True)
    log_project("ur5", tmp_path / "tables", joint_log=MADE_UP | TABLES | {"signals": signals("ist")}, motion={"steps": 140})
    with pytest.raises(ConfigError, match="target angles"):
        ingest.run()
