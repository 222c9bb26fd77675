"""Joint logs of robots and programs of many makers, as characterize reads them: uneven rows, single
joints, counts of servos, several recordings in a file.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from joint_kinds import labels_of, motion, write
from numpy.testing import assert_allclose
from scipy.io import savemat

from pipeline.tools.characterize.logs import folder_logs

TIME, ACTUAL, TARGET = motion()
SPEED = np.gradient(TARGET, TIME, axis=0)
NOISE = np.random.default_rng(2).normal(0, 1, (len(TIME), 4))
LEFT = "{actual: [left_q_0, left_q_1], target: [left_q_cmd_0, left_q_cmd_1]}"
FEEDBACK = labels_of("feedBack.joints[#],planned.joints[#]")


def write_table(folder: Path, labels: list[str], *columns: np.ndarray) -> None:
    write(folder / "log.csv", labels, *columns)


def write_speeds_beside(folder: Path) -> None:
    write_table(folder, [], TIME, ACTUAL, SPEED, TARGET, SPEED)


def write_joint(folder: Path) -> None:
    labels = ["time_s", "q_target", "q_actual"]
    write_table(folder, labels, TIME, TARGET[:, 0], ACTUAL[:, 0])


def write_joint_in_words(folder: Path) -> None:
    labels = ["t", "commanded", "velocity", "measured"]
    write_table(folder, labels, TIME, TARGET[:, 0], SPEED[:, 0], ACTUAL[:, 0])


def write_vectors_of_joint(folder: Path) -> None:
    vectors = {"q_meas": ACTUAL[:, 0], "q_ref": TARGET[:, 0]}
    np.savez(folder / "log.npz", t=TIME, **vectors)


def write_array_of_both(folder: Path) -> None:
    values = np.hstack([TARGET, ACTUAL])
    savemat(folder / "log.mat", {"data": {"t": TIME, "values": values}})


def write_feedback(folder: Path) -> None:
    write_table(folder, ["tm", *FEEDBACK], TIME, ACTUAL, TARGET)


def write_episodes(folder: Path) -> None:
    """Write two episodes into one file, the times of each from 0."""
    columns = {
        "timestamp": [*TIME, *TIME],
        "episode_index": np.repeat([0, 1], len(TIME)),
        "action": [*TARGET, *TARGET],
        "observation.state": [*ACTUAL, *ACTUAL],
    }
    pd.DataFrame(columns).to_parquet(folder / "file.parquet")


@pytest.mark.parametrize(
    ("make", "count", "joints"),
    [
        (write_speeds_beside, 1, 6),
        (write_joint, 1, 1),
        (write_joint_in_words, 1, 1),
        (write_vectors_of_joint, 1, 1),
        (write_array_of_both, 1, 6),
        (write_feedback, 1, 6),
        (write_episodes, 2, 6),
    ],
)
def test_signals_are_found_without_an_answer(tmp_path, make, count, joints):
    make(tmp_path)
    logs = folder_logs(tmp_path, {})
    assert len(logs.movements) == count, logs.unused
    for movement in logs.movements.values():
        assert_allclose(movement.target, TARGET[:, :joints], atol=1e-6)
        assert_allclose(movement.actual, ACTUAL[:, :joints], atol=1e-6)


def write_uneven(folder: Path, most: float) -> None:
    """Write one joint at times that differ by 0.2 to 1.8 steps, and once by ``most`` steps."""
    steps = np.random.default_rng(4).uniform(0.2, 1.8, 900)
    steps[450] = most
    time = np.cumsum(steps) / 125
    labels = ["time", "q_actual", "q_target"]
    write_table(folder, labels, time, np.sin(time - 0.02), np.sin(time))


def test_uneven_rows_are_resampled_at_their_times_and_counted(tmp_path):
    write_uneven(tmp_path, most=4.0)
    logs = folder_logs(tmp_path, {})
    movement = logs.movements["log"]
    rows = len(movement.actual)
    assert movement.counts["resampled_rows"] == rows
    assert f"ms; {rows} rows" in logs.resampled["log"]
    # before the quarter period, the phase of the sine grows by one period of the rate a row
    phases = np.arcsin(movement.target[:150, 0])
    assert_allclose(np.diff(phases), 1 / logs.rate, atol=5e-4)


def test_missing_rows_are_not_resampled(tmp_path):
    write_uneven(tmp_path, most=12.0)
    logs = folder_logs(tmp_path, {})
    assert not logs.movements
    assert "rows are missing" in logs.unused["log"]


def test_counts_of_servos_are_asked_for_and_read_in_counts_per_turn(tmp_path):
    labels = ["time", *labels_of("present_position_#,goal_position_#")]
    per_radian = 4096 / (2 * np.pi)
    counts = [np.rint(2048 + per_radian * angles) for angles in (ACTUAL, TARGET)]
    write_table(tmp_path, labels, TIME, *counts)
    logs = folder_logs(tmp_path, {})
    assert logs.missing == {"joint_log.angle_unit": "turn/4096"}
    logs = folder_logs(tmp_path, logs.missing)
    moved = np.ptp(logs.movements["log"].actual, axis=0)
    assert_allclose(moved, np.ptp(ACTUAL, axis=0), atol=2e-3)


def test_of_two_arms_in_a_table_one_is_proposed(tmp_path):
    labels = ["time"]
    for arm in ("left", "right"):
        labels += [f"{arm}_q_0", f"{arm}_q_1", f"{arm}_q_cmd_0", f"{arm}_q_cmd_1"]
    columns = NOISE, ACTUAL[:, :2], TARGET[:, :2]
    write_table(tmp_path, labels, TIME, *columns)
    logs = folder_logs(tmp_path, {})
    assert logs.missing == {
        "joint_log.signals": LEFT,
        "joint_log.time": "0",
    }


def test_files_of_no_known_format_are_named_with_what_to_do(tmp_path):
    (tmp_path / "log.npy").write_bytes(b"\x93NUMPY\x01\x00" + bytes(99))
    unused = folder_logs(tmp_path, {}).unused
    assert "save arrays" in unused["log.npy"]
