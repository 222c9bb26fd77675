"""A command in another unit, order or clock than the measured angles never becomes a result, nor do
locked joints that moved; what the options settle gives what the right logs do.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_files import read_joint_log
from joint_logs import FILES, HOME, quality, write_movement
from written_logs import write_joint_log

from pipeline.core.errors import ConfigError, RecordingError
from pipeline.formats.joints.log import JointLog

ROWS = 30  # by which the command is early
ORDER = [1, 3, 2, 4, 5, 6]


@pytest.fixture
def logs(tmp_path) -> Path:
    """Two movements of a robot that repeats its motions, as it should be logged."""
    for number in (1, 2):
        folder = tmp_path / f"logs/move_{number}"
        write_movement(folder, 4, late=8e-4, noise=1e-5, seed=number)
    return tmp_path / "logs"


def spoil(folder: Path, *, factor: float = 1.0, order: bool = False, early: int = 0) -> None:
    """Log what is commanded in another unit, with columns exchanged, or ``early`` rows before."""
    for name in FILES[1:]:
        log = read_joint_log(folder / name, joints=6)
        rows = log.signals["actual"][:, [0, 2, 1, 3, 4, 5]] if order else log.signals["actual"]
        rows = np.vstack([rows[early:], np.repeat(rows[-1:], early, axis=0)])
        write_joint_log(folder / name, JointLog(log.time, {"actual": rows * factor}, {}))


@pytest.mark.parametrize(
    ("wrong", "words", "option"),
    [
        ({"factor": np.pi / 180}, "target_factor: 57.2957", {"target_factor": 180 / np.pi}),
        ({"order": True}, r"\[1, 3, 2, 4, 5, 6\]", {"signals": {"target": ORDER, "speed": ORDER}}),
        ({"early": ROWS}, "target_delay: 0.24", {"target_delay": {"move_1": 0.24, "move_2": 0.24}}),
    ],
)
def test_a_command_that_is_no_pair_is_refused_and_settled_by_its_option(
    read, logs, wrong, words, option
):
    names, q = read(logs)
    for number in (1, 2):
        spoil(logs / f"move_{number}", **wrong)
    with pytest.raises(RecordingError, match=f"are no pair.*{words}") as refused:
        read(logs)
    assert refused.value.evidence["file"].name == "move_1"
    outcome = read(logs, **option)
    assert outcome[0] == names
    np.testing.assert_allclose(outcome[1], q, rtol=0, atol=1e-9)
    # six decimals of a command in radians that was divided by 57.3 are 57 µrad, over 100 steps
    assert quality("lag_behind_command", names[0]) == pytest.approx(8e-4, abs=4e-5)
    if wrong.get("early"):
        assert quality("command_delay", "move_1") == 0.24


def test_a_delay_of_every_movement_is_needed_where_they_have_their_own(read, logs):
    with pytest.raises(ConfigError, match="no delay for the movement move_2; there are move_1"):
        read(logs, target_delay={"move_1": 0.0})


def test_joints_that_are_locked_elsewhere_than_logged_are_refused(read, tmp_path):
    # joint 1 turns by 0.2 rad in this motion, joint 6 by 0.1
    write_movement(tmp_path / "logs/move_1", 5)
    with pytest.raises(RecordingError, match=r"joint_1 is held at 1 rad.*0.8 to 1 rad") as refused:
        read(tmp_path / "logs", robot={"locked": {"joint_1": float(HOME[0])}})
    assert refused.value.evidence["key"] == "dataset.robot.locked.joint_1"
    assert refused.value.evidence["take"] == "move_1_1"
    assert not list(Path("data/ingest").iterdir())
    # the control: another joint's column is not its own
    names, robot = (
        [f"joint_{j}" for j in (6, 2, 3, 4, 5, 1)],
        {"locked": {"joint_1": float(HOME[5])}},
    )
    with pytest.raises(RecordingError, match=r"joint_1 is held at 0 rad.*0.1 rad"):
        read(tmp_path / "logs", robot=robot, joints=names)


def test_a_movement_at_rest_is_held_against_its_command_and_is_no_take(read, logs):
    write_movement(logs / "move_3", 0, noise=1e-5)
    assert len(read(logs)[0]) == 4 and quality("repetitions", "move_3") == 0
    spoil(logs / "move_3", factor=np.pi / 180)
    with pytest.raises(RecordingError, match="are no pair") as refused:
        read(logs)
    assert refused.value.evidence["file"].name == "move_3"


def test_a_step_that_the_joint_cannot_make_is_refused_with_joint_time_speed_and_limit(read, logs):
    log = read_joint_log(logs / "move_2" / FILES[0], joints=6)
    log.signals["actual"][200, 4] += 0.2
    write_joint_log(logs / "move_2" / FILES[0], log)
    words = r"joint_5 \(actual\) steps by 0\.\d+ rad at 1\.6 s .* rad/s, where .* 3\.142 rad/s"
    with pytest.raises(RecordingError, match=words) as refused:
        read(logs)
    assert refused.value.evidence["joint"] == "joint_5"
    assert not list(Path("data/ingest").iterdir())  # what is refused leaves nothing behind
