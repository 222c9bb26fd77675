"""From the raw logs of a made-up robot that repeats its motions, in several forms and with
disturbed repetitions, to the tables; everything is known of it. A command in another unit, order or
clock than the measured angles never becomes a result, nor do locked joints that moved.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from joint_files import read_joint_log, read_movement
from joint_logs import AWAY, FILES, HOME, quality, write_movement
from numpy.testing import assert_allclose, assert_array_equal
from planar_poses import load_arm
from written_logs import write_joint_log

from pipeline.core import contracts
from pipeline.core.columns import values
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.joints.log import JointLog
from pipeline.stages import files
from pipeline.tools.inventory import command

cases = cases_beside(__file__)
CHAIN = ["joint_2", "joint_3", "joint_4"]


def test_repetitions_are_gathered_over_movements_and_their_mean_command_is_the_trajectory(
    read,
    tmp_path,
):
    late = {"late": 8e-4, "noise": 1e-5}
    write_movement(tmp_path / "logs/move_1", 5, offset=1e-4, **late)
    write_movement(tmp_path / "logs/move_2", 1, offset=-1e-4, seed=1, **late)

    names, q = read(tmp_path / "logs")

    assert names == ["move_1_1", "move_1_2", "move_1_3", "move_2_1"]
    assert q.shape == (4, 141, 3)
    # three takes 0.1 mrad above and one as much below: 0.05 and 0.15 mrad off their mean
    deviations = [quality("command_deviation", name) for name in names]
    assert_allclose(deviations, [5e-5, 5e-5, 5e-5, 1.5e-4], atol=1e-6)
    lags = [quality("lag_behind_command", name) for name in names]
    assert_allclose(np.mean(lags), 8e-4, atol=2e-5)

    trajectory = contracts.read("trajectory", Path("data/ingest/motion"))
    chain = load_arm("pipeline/arm/ur5.urdf", CHAIN, "wrist_centre", {}).chain
    ends = chain.coordinates(np.array([HOME, AWAY])[:, 1:4] + 5e-5)
    assert_allclose(values(trajectory.loc[[0, 140]], "x"), ends, atol=2e-6)


@cases("too few repetitions")
def test_too_few_or_unequal_repetitions_are_refused_with_what_there_is(
    read,
    tmp_path,
    choice,
    words,
):
    write_movement(tmp_path / "logs/move_1", 5, offset=1e-4)
    write_movement(tmp_path / "logs/move_2", 1, offset=-1e-4)
    if "move_3" in choice.values():  # ends in the middle of the motion
        write_movement(tmp_path / "logs/move_3", 1)
        for file in (tmp_path / "logs/move_3" / name for name in FILES):
            file.write_text("".join(file.read_text().splitlines(keepends=True)[:110]))

    with pytest.raises(RecordingError, match=words):
        read(tmp_path / "logs", **choice)
    assert not list(Path("data/ingest").iterdir())


def test_recordings_that_are_not_there_are_refused_by_their_folder(
    log_project,
    tmp_path,
):
    nowhere = tmp_path / "nowhere"
    inventory = tmp_path / "inventory.csv"
    log_project("ur5_planar", nowhere)
    for run in (files.run, lambda: command.run(nowhere, inventory)):
        with pytest.raises(RecordingError, match="exist") as caught:
            run()
        assert caught.value.evidence["file"] == nowhere

    # control: an inventory that is there stays
    inventory.write_text("file\n")
    command.run(nowhere, inventory)
    assert inventory.read_text() == "file\n"


@cases("contradictions")
def test_options_that_contradict_each_other_are_refused(
    log_project,
    tmp_path,
    choice,
    words,
):
    with pytest.raises(ConfigError, match=words):
        log_project("ur5_planar", tmp_path, joint_log=choice)


def write_table(folder: Path, source: Path) -> None:
    """The logs of a movement as one table in degrees under labels."""
    signals = np.hstack(read_movement(source, FILES)[0])
    table = pd.DataFrame(np.rad2deg(signals), columns=np.ravel([*SIGNALS.values()]))
    folder.mkdir(parents=True, exist_ok=True)
    table.round(8).to_csv(folder / f"{source.name}.txt", index_label="Zeit")


TABLES = {"movements": "*.txt", "time": None, "angle_unit": "deg"}
TABLES |= dict.fromkeys(("actual", "target", "speed"))
LABELS = {"actual": "ist", "target": "soll", "speed": "v"}
SIGNALS = {
    signal: [f"{label}_{j}" for j in range(1, 7)] for signal, label in LABELS.items()
}
ANGLES = {signal: SIGNALS[signal] for signal in ("actual", "target")}


def test_one_table_a_movement_gives_what_one_file_a_signal_does(read, tmp_path):
    """Without a speed the steps of the commanded angles are it."""
    write_movement(tmp_path / "logs/move_1", 5, late=8e-4, noise=1e-5)
    names, q = read(tmp_path / "logs")
    write_table(tmp_path / "tables", tmp_path / "logs/move_1")
    cases = [(SIGNALS, 1e-4, 1e-9), (ANGLES, 1e-3, 1e-4)]
    for signals, rest_speed, error in cases:
        table = TABLES | {"signals": signals, "rest_speed": rest_speed}
        read_names, read_q = read(tmp_path / "tables", **table)
        assert read_names == names
        assert_allclose(read_q, q, rtol=0, atol=error)
        assert quality("speed_from_angles", "move") == (signals is ANGLES)

    with pytest.raises(ConfigError, match="target angles"):
        read(tmp_path / "tables", **TABLES, signals={"actual": SIGNALS["actual"]})


def test_a_disturbed_repetition_is_left_out_by_name_and_the_others_stay_as_they_were(
    read,
    tmp_path,
    capsys,
):
    write_movement(tmp_path / "logs/move_1", 9, noise=5e-5)
    names, q = read(tmp_path / "logs")
    assert len(names) == 5
    assert quality("disturbed_from_row", "move_1") == 0

    # joint 3 is pushed aside by 2 mrad in the middle of the third way out
    log = read_joint_log(tmp_path / "logs/move_1" / FILES[0], joints=6)
    push = 2e-3 * np.sin(np.linspace(0, np.pi, 40))
    log.signals["actual"][730:770, 2] += push
    write_joint_log(tmp_path / "logs/move_1" / FILES[0], log)
    undisturbed, q_of_undisturbed = read(tmp_path / "logs")

    assert undisturbed == [name for name in names if name != "move_1_3"]
    assert_array_equal(q_of_undisturbed, np.delete(q, 2, axis=0))

    left_out = contracts.read("disturbed_log", Path("data/ingest/motion"))
    assert {*left_out["take"]} == {"move_1_3"}
    assert len(left_out) == q.shape[1]
    assert quality("disturbed_from_row", "move_1") == 60 + 2 * 320
    assert quality("disturbance", "move_1_3") > 6 > quality("disturbance", "move_1_4")
    assert "disturbed from row 700" in capsys.readouterr().out


@pytest.fixture
def logs(tmp_path) -> Path:
    """Two movements of a robot that repeats its motions, as it should be logged."""
    for number in (1, 2):
        folder = tmp_path / f"logs/move_{number}"
        write_movement(folder, 4, late=8e-4, noise=1e-5, seed=number)
    return tmp_path / "logs"


def spoil(
    folder: Path,
    *,
    factor: float = 1.0,
    order: bool = False,
    early: int = 0,
) -> None:
    """Log what is commanded in another unit, with columns exchanged, or ``early`` rows before."""
    for name in FILES[1:]:
        log = read_joint_log(folder / name, joints=6)
        rows = factor * log.signals["actual"]
        if order:
            rows = rows[:, [0, 2, 1, 3, 4, 5]]
        last = np.repeat(rows[-1:], early, axis=0)
        signals = {"actual": np.vstack([rows[early:], last])}
        write_joint_log(folder / name, JointLog(log.time, signals, {}))


@cases("no pairs")
def test_a_command_that_is_no_pair_is_refused_and_settled_by_its_option(
    read,
    logs,
    wrong,
    words,
    option,
):
    names, q = read(logs)
    for number in (1, 2):
        spoil(logs / f"move_{number}", **wrong)
    with pytest.raises(RecordingError, match=f"do not agree.*{words}") as refused:
        read(logs)
    assert refused.value.evidence["file"].name == "move_1"

    outcome = read(logs, **option)
    assert outcome[0] == names
    assert_allclose(outcome[1], q, rtol=0, atol=1e-9)
    # six decimals of a command in radians that was divided by 57.3 are 57 µrad, over 100 steps
    assert quality("lag_behind_command", names[0]) == pytest.approx(8e-4, abs=4e-5)
    if wrong.get("early"):
        assert quality("command_delay", "move_1") == 0.24


def test_joints_that_are_locked_elsewhere_than_logged_are_refused(read, tmp_path):
    # joint 1 turns by 0.2 rad in this motion, joint 6 by 0.1
    write_movement(tmp_path / "logs/move_1", 5)
    with pytest.raises(
        RecordingError,
        match=r"joint_1 is locked at 1 rad.*0.8 to 1",
    ) as refused:
        read(tmp_path / "logs", robot={"locked": {"joint_1": float(HOME[0])}})
    assert refused.value.evidence["key"] == "dataset.robot.locked.joint_1"
    assert refused.value.evidence["take"] == "move_1_1"

    # the control: another joint's column is not its own
    names = [f"joint_{j}" for j in (6, 2, 3, 4, 5, 1)]
    robot = {"locked": {"joint_1": float(HOME[5])}}
    with pytest.raises(RecordingError, match=r"joint_1 is locked at 0 rad.*0.1 rad"):
        read(tmp_path / "logs", robot=robot, joints=names)


def test_a_step_that_the_joint_cannot_make_is_refused_with_joint_time_speed_and_limit(
    read,
    logs,
):
    log = read_joint_log(logs / "move_2" / FILES[0], joints=6)
    log.signals["actual"][200, 4] += 0.2
    write_joint_log(logs / "move_2" / FILES[0], log)
    words = r"joint_5 \(actual\) steps by 0\.\d+ rad at 1\.6 s .* rad/s, where .* 3\.142 rad/s"

    with pytest.raises(RecordingError, match=words):
        read(logs)
    # what is refused leaves nothing behind
    assert not list(Path("data/ingest").iterdir())
