"""From the raw logs of a made-up robot that repeats its motions to the tables and the process
noise; of it everything is known.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from joint_files import read_joint_log
from joint_logs import AWAY, FILES, HOME, MADE_UP, ingested, quality, write_movement
from written_logs import write_joint_log

from pipeline.arm.model import load_arm
from pipeline.core import contracts
from pipeline.core.columns import values
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.recordings.quality import account, beside_limits
from pipeline.stages import files, ingest
from pipeline.tools.inventory import command


def test_repetitions_are_gathered_over_movements_and_their_mean_command_is_the_trajectory(
    log_project, tmp_path
):
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, offset=1e-4, noise=1e-5)
    write_movement(tmp_path / "logs/move_2", 1, late=8e-4, offset=-1e-4, noise=1e-5, seed=1)
    log_project("ur5_planar", tmp_path / "logs", joint_log=MADE_UP, motion={"steps": 140})
    ingest.run("motion")
    names, q = ingested()
    assert names == ["move_1_1", "move_1_2", "move_1_3", "move_2_1"] and q.shape == (4, 141, 3)
    # three takes 0.1 mrad above and one as much below: 0.05 and 0.15 mrad off their mean
    np.testing.assert_allclose(
        [quality("command_deviation", name) for name in names],
        [5e-5, 5e-5, 5e-5, 1.5e-4],
        atol=1e-6,
    )
    np.testing.assert_allclose(
        np.mean([quality("lag_behind_command", name) for name in names]), 8e-4, atol=2e-5
    )
    trajectory = contracts.read("trajectory", Path("data/ingest/motion"))
    chain = load_arm(
        "pipeline/arm/ur5.urdf", ["joint_2", "joint_3", "joint_4"], "wrist_centre", {}
    ).chain
    ends = chain.pose(np.array([HOME, AWAY])[:, 1:4] + 5e-5)
    np.testing.assert_allclose(values(trajectory.loc[[0, 140]], "x"), ends, atol=2e-6)


@pytest.mark.parametrize(
    ("choice", "steps", "words"),
    [
        ({"movements": "run_*"}, 140, "no folder"),
        (
            {"end": [0.0, 0.0, 0.0]},
            140,
            r"0 repetition.*-2.1, -1.9, -0.4\] to \[-3.0, -0.3, -1.5\] in 100 steps",
        ),
        ({}, 200, "0 repetition.*in 100 steps"),
        ({"rest": 58}, 216, "0 repetition"),
        ({"movements": "move_2"}, 140, "1 repetition"),
        ({"movements": "move_3"}, 140, "a motion from row 60, cut off by the end of the log"),
        ({"tolerance": 1e-4}, 140, "another motion"),
    ],
)
def test_too_few_or_unequal_repetitions_are_refused_with_what_there_is(
    log_project, tmp_path, choice, steps, words
):
    write_movement(tmp_path / "logs/move_1", 5, offset=1e-4)
    write_movement(tmp_path / "logs/move_2", 1, offset=-1e-4)
    if "move_3" in choice.values():  # ends in the middle of the motion
        write_movement(tmp_path / "logs/move_3", 1)
        for name in FILES:
            file = tmp_path / "logs/move_3" / name
            file.write_text("".join(file.read_text().splitlines(keepends=True)[:110]))
    log_project(
        "ur5_planar", tmp_path / "logs", joint_log=MADE_UP | choice, motion={"steps": steps}
    )
    with pytest.raises(RecordingError, match=words):
        ingest.run("motion")
    assert not list(Path("data/ingest").iterdir())


def test_recordings_that_are_not_there_are_refused_by_their_folder(log_project, tmp_path):
    log_project("ur5_planar", tmp_path / "nowhere")
    for run in (
        files.run,
        lambda: command.run(tmp_path / "nowhere", tmp_path / "inventory.csv"),
    ):
        with pytest.raises(RecordingError, match="exist") as caught:
            run()
        assert caught.value.evidence["file"] == tmp_path / "nowhere"
    # control: an inventory that is there stays
    (tmp_path / "inventory.csv").write_text("file\n")
    command.run(tmp_path / "nowhere", tmp_path / "inventory.csv")
    assert (tmp_path / "inventory.csv").read_text() == "file\n"


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({"joints": [f"joint_{j}" for j in (1, 2, 3, 5, 6)]}, "joint_4 of robot.joints is not"),
        (
            {"joints": ["joint_2", "joint_2", "joint_3", "joint_4"]},
            "each logged joint once",
        ),
        ({"rest": -1}, "rest: input should be greater than or equal to 0"),
        ({"start": [0.0]}, "values as start"),
        (
            {"start": [0.0] * 6, "end": [0.0] * 6},
            "one for each of robot.joints, got 6",
        ),
    ],
)
def test_options_that_name_no_chain_are_refused(log_project, tmp_path, choice, words):
    with pytest.raises(ConfigError, match=words):
        log_project("ur5_planar", tmp_path, joint_log=choice)


def test_files_in_a_folder_below_each_movement_give_every_take_and_a_disturbed_one_by_name(
    log_project, tmp_path
):
    for number, ways in ((1, 5), (2, 3), (3, 1)):
        write_movement(tmp_path / f"logs/move_{number}/csv", ways, noise=1e-5, seed=number)
    write_movement(tmp_path / "logs/move_4/csv", 0)
    # in the second way out of the second movement
    log = read_joint_log(tmp_path / "logs/move_2/csv" / FILES[0], joints=6)
    log.signals["actual"][410:450, 2] += 5e-3
    write_joint_log(tmp_path / "logs/move_2/csv" / FILES[0], log)
    choice = MADE_UP | {"movements": "move_*/csv"}
    log_project("ur5_planar", tmp_path / "logs", joint_log=choice, motion={"steps": 140})
    files.run()
    ingest.run("motion")
    names, _ = ingested()
    assert names == ["move_1_1", "move_1_2", "move_1_3", "move_2_1", "move_3_1"]
    table = contracts.read("quality", Path("data/ingest/motion"))
    takes = beside_limits(table, {"disturbance": 6.0})
    parts = [pd.read_csv(file) for file in Path("data/files").glob("*.csv")]
    assert account(parts, table, takes)[["recording", "found", "kept"]].to_numpy().tolist() == [
        ["all", 12, 12],
        ["move_1", 5, 3],
        ["move_2", 3, 2],
        ["move_3", 1, 1],
        ["move_4", 0, 0],
        ["training", 6, 5],
    ]
