"""Joint logs of a folder, as characterize and assess find them: by names, shapes and what follows
what, or by what is stated; what is not used is named.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from joint_kinds import labels_of, motion, write
from numpy.testing import assert_allclose
from scipy.io import savemat

from pipeline.recordings.runs import joint_runs
from pipeline.tools.characterize.logs import folder_logs

cases = cases_beside(__file__)
TIME, ACTUAL, TARGET = motion()
NOISE = np.random.default_rng(2).normal(0, 1, (len(TIME), 9))


PAIRS = np.stack([ACTUAL, TARGET], axis=2).reshape(len(TIME), -1)
QUANTITIES = {"time": TIME[:, None], "actual": ACTUAL, "target": TARGET, "noise": NOISE}
QUANTITIES |= {"alternating": PAIRS, "rows": np.arange(len(TIME))[:, None]}


def write_files(folder: Path, files: dict[str, list[str]]) -> None:
    """Write tables without labels of columns of QUANTITIES; of "actual.2" the first two."""
    for name, columns in files.items():
        values = []
        for column in columns:
            quantity, _, joints = column.partition(".")
            values.append(QUANTITIES[quantity][:, : int(joints or 12)])
        (folder / name).parent.mkdir(exist_ok=True)
        write(folder / name, [], *values)


def require_angles(folder: Path, stated: dict, count: int, joints: int) -> None:
    """Logs of a folder have these numbers, and measured and commanded angles at 125 Hz."""
    logs = folder_logs(folder, stated)
    assert len(logs.movements) == count, logs.unused
    assert logs.rate == 125.0
    for movement in logs.movements.values():
        assert movement.target.shape[1] == joints
        assert_allclose(movement.target, TARGET[:, :joints], atol=1e-6)
        assert_allclose(movement.actual, ACTUAL[:, :joints], atol=1e-6)


@cases("folders")
def test_tables_of_angles_are_found_by_names_shapes_values_or_what_is_stated(
    tmp_path,
    files,
    stated,
    count,
    joints,
):
    write_files(tmp_path, files)
    require_angles(tmp_path, stated, count, joints)


def test_columns_of_words_that_mean_measured_and_commanded_angles_are_found(tmp_path):
    labels = ["Time", *labels_of("PositionMsrd#,PositionCmptd#")]
    write(tmp_path / "log.csv", labels, TIME, ACTUAL, TARGET)
    require_angles(tmp_path, {}, 1, 6)


def test_an_episode_of_lists_is_found(tmp_path):
    columns = {"action": [*TARGET], "observation.state": [*ACTUAL]}
    episode = pd.DataFrame({"timestamp": TIME, **columns})
    episode.to_parquet(tmp_path / "episode.parquet")

    require_angles(tmp_path, {}, 1, 6)


def test_arrays_of_a_struct_are_found_by_words_that_mean_commanded_angles(tmp_path):
    data = {"t": TIME, "actualJointPositions": ACTUAL, "desiredJointPositions": TARGET}
    data["actualJointVelocities"] = NOISE[:, :6]
    savemat(tmp_path / "log.mat", {"data": data})

    require_angles(tmp_path, {}, 1, 6)


def test_tables_beside_the_angles_are_named(tmp_path):
    files = {"q_actual.csv": ["time", "actual"], "q_target.csv": ["time", "target"]}
    write_files(tmp_path, files | {"acc_data.csv": ["time", "noise"]})
    assert [*folder_logs(tmp_path, {}).unused] == ["acc_data.csv"]


@cases("missing")
def test_all_that_is_missing_is_proposed_together(tmp_path, files, stated, missing):
    write_files(tmp_path, files)
    logs = folder_logs(tmp_path, stated)

    assert not logs.movements
    assert logs.missing == missing


def test_only_the_rate_is_missing_where_labels_name_the_angles(tmp_path):
    labels = ["", *labels_of("q_#,q_cmd_#")]
    write(tmp_path / "log.csv", labels, QUANTITIES["rows"], ACTUAL, TARGET)
    assert folder_logs(tmp_path, {}).missing == {"motion.rate": "HZ"}


@pytest.mark.parametrize("joints", [slice(0, 6), slice(2, 3)])
def test_a_recording_in_which_joints_stand_still_removes_no_joint(tmp_path, joints):
    labels = ["time", *labels_of("q_actual_#,q_target_#")]
    measured = ACTUAL + 1e-5 * NOISE[:, :6]
    still = ACTUAL.copy()
    still[:, joints] = ACTUAL[0, joints]
    for run in range(3):
        write(tmp_path / f"run_{run}.csv", labels, TIME, measured, TARGET)
    write(tmp_path / "run_9.csv", labels, TIME, still, TARGET)

    logs = folder_logs(tmp_path, {})
    runs, unused = joint_runs(logs.movements, logs.rate)

    reasons = logs.unused | unused
    assert "does not follow" in reasons["run_9"]
    for run in runs:
        assert len(run.joints) == 6
        assert not run.name.startswith("run_9")
