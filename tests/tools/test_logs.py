"""Joint logs of a folder, as characterize and assess find them: by names, shapes and what follows
what, or by what is stated; what is not used is named.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from joint_kinds import labels_of, motion, write
from scipy.io import savemat

from pipeline.recordings.runs import joint_runs
from pipeline.tools.characterize.logs import folder_logs

TIME, ACTUAL, TARGET = motion()
NOISE = np.random.default_rng(2).normal(0, 1, (len(TIME), 9))


def tables(folder: Path, *, clock: bool = True, **named: np.ndarray) -> None:
    """Write one table without labels for each array, behind the times if ``clock``."""
    folder.mkdir(exist_ok=True)
    for name, values in named.items():
        columns = (TIME, values) if clock else (values,)
        write(folder / f"{name}.csv", [], *columns)


def third_table(folder: Path, **beside: np.ndarray) -> None:
    """Write two movements, each with the tables ``beside`` the angles."""
    for run in ("run_1", "run_2"):
        tables(folder / run, q_actual=ACTUAL, q_target=TARGET, **beside)


def prefixes(folder: Path) -> None:
    for run in ("a", "b"):
        signals = {f"{run}_q_actual": ACTUAL, f"{run}_q_target": TARGET}
        tables(folder, **signals, **{f"{run}_i_actual": NOISE})


def numbers_behind(folder: Path) -> None:
    for run in (1, 2):
        tables(folder, **{f"measured_{run}": ACTUAL, f"commanded_{run}": TARGET})


def clock_beside(folder: Path, name: str = "time") -> None:
    tables(folder, clock=False, q_actual=ACTUAL, q_target=TARGET, **{name: TIME})


def requested(folder: Path) -> None:
    tables(folder, clock=False, act_pos=ACTUAL[:, :5], req_pos=TARGET[:, :5])


def table(*columns: np.ndarray, labels: tuple[str, ...] = ()) -> Callable:
    return lambda folder: write(folder / "log.csv", labels, *columns)


def alternating(folder: Path) -> None:
    pairs = np.stack([ACTUAL, TARGET], axis=2).reshape(len(TIME), -1)
    write(folder / "log.csv", [], TIME, pairs)


def episode(folder: Path) -> None:
    arrays = {"action": [*TARGET], "observation.state": [*ACTUAL]}
    pd.DataFrame({"timestamp": TIME, **arrays}).to_parquet(folder / "episode.parquet")


def struct(folder: Path, **names: np.ndarray) -> None:
    savemat(folder / "log.mat", {"data": {"t": TIME, **names}})


UNLABELLED = {"signals": "{actual: [1, 2], target: [3, 4]}", "time": "0"}
FOLDERS = {  # name: what writes the files, values that are stated, number of logs, of joints
    "accelerations beside": (lambda f: third_table(f, acc_data=NOISE), {}, 2, 6),
    "currents beside": (lambda f: third_table(f, i_actual=NOISE, i_target=NOISE), {}, 2, 6),
    "poses beside": (lambda f: third_table(f, tcp_pose=NOISE[:, :7]), {}, 2, 6),
    "tables in the folder": (
        lambda f: tables(f, q_actual=ACTUAL, q_target=TARGET), {}, 1, 6),
    "stated tables": (
        lambda f: tables(f, one=ACTUAL, two=TARGET),
        {"actual": "one.csv", "target": "two.csv"}, 1, 6),
    "movements as prefixes": (prefixes, {}, 2, 6),
    "movements as numbers": (numbers_behind, {}, 2, 6),
    "a table of times": (clock_beside, {}, 1, 6),
    "a table of stamps": (lambda f: clock_beside(f, "timestamps"), {}, 1, 6),
    "no clock": (requested, {"rate": "125"}, 1, 5),
    "no labels": (table(TIME, ACTUAL, TARGET), {}, 1, 6),
    "no labels, commands first": (table(TIME, TARGET, ACTUAL), {}, 1, 6),
    "no labels, one joint": (table(TARGET[:, 0], ACTUAL[:, 0], TIME), {}, 1, 1),
    "no labels, alternating": (alternating, {}, 1, 6),
    "no labels, stated": (
        table(TIME, ACTUAL[:, :2], TARGET[:, :2], NOISE), UNLABELLED, 1, 2),
    "an episode": (episode, {}, 1, 6),
    "PositionCmptd": (
        table(TIME, ACTUAL, TARGET, labels=("Time", *(f"PositionMsrd{j}" for j in range(6)),
            *(f"PositionCmptd{j}" for j in range(6)))), {}, 1, 6),
    "desired … actual": (lambda f: struct(f, actualJointPositions=ACTUAL,
        desiredJointPositions=TARGET, actualJointVelocities=NOISE[:, :6]), {}, 1, 6),
}  # fmt: skip


@pytest.mark.parametrize("name", FOLDERS)
def test_tables_of_angles_are_found_by_names_shapes_values_or_what_is_stated(
    tmp_path,
    name,
):
    make, stated, count, joints = FOLDERS[name]
    make(tmp_path)
    keys = {"rate": "motion.rate"}
    assigned = {keys.get(key, f"joint_log.{key}"): text for key, text in stated.items()}
    logs = folder_logs(tmp_path, assigned)
    assert len(logs.movements) == count, logs.unused
    assert logs.rate == 125.0
    for movement in logs.movements.values():
        assert movement.target.shape[1] == joints
        np.testing.assert_allclose(movement.target, TARGET[:, :joints], atol=1e-6)
        np.testing.assert_allclose(movement.actual, ACTUAL[:, :joints], atol=1e-6)


def test_tables_beside_the_angles_are_named(tmp_path):
    third_table(tmp_path, acc_data=NOISE)
    unused = folder_logs(tmp_path, {}).unused
    assert [*unused] == ["run_1/acc_data.csv", "run_2/acc_data.csv"]


ROWS = np.arange(len(TIME))
HALVES = "{actual: [1, 2], target: [3, 4]}"


@pytest.mark.parametrize(
    ("make", "stated", "missing"),
    [
        (
            table(ROWS, ACTUAL[:, :2], NOISE[:, :2]),
            {},
            {
                "joint_log.signals": HALVES,
                "joint_log.time": "null",
                "motion.rate": "HZ",
            },
        ),
        (
            table(ROWS, ACTUAL[:, :2], NOISE[:, :2]),
            {"motion.rate": "100"},
            {"joint_log.signals": HALVES, "joint_log.time": "null"},
        ),
        (
            table(ROWS, ACTUAL, TARGET, labels=("", *labels_of("q_#,q_cmd_#"))),
            {},
            {"motion.rate": "HZ"},
        ),
    ],
)
def test_all_that_is_missing_is_proposed_together(tmp_path, make, stated, missing):
    make(tmp_path)
    logs = folder_logs(tmp_path, stated)
    assert not logs.movements
    assert logs.missing == missing


def follows_not(folder: Path, joints: slice) -> None:
    """Three logs, and one in which the ``joints`` stand still."""
    labels = ["time", *labels_of("q_actual_#,q_target_#")]
    for run in range(3):
        write(
            folder / f"run_{run}.csv",
            labels,
            TIME,
            ACTUAL + 1e-5 * NOISE[:, :6],
            TARGET,
        )
    still = ACTUAL.copy()
    still[:, joints] = ACTUAL[0, joints]
    write(folder / "run_9.csv", labels, TIME, still, TARGET)


@pytest.mark.parametrize("joints", [slice(0, 6), slice(2, 3)])
def test_a_recording_in_which_joints_stand_still_removes_no_joint(tmp_path, joints):
    follows_not(tmp_path, joints)
    logs = folder_logs(tmp_path, {})
    runs, unused = joint_runs(logs.movements, logs.rate)
    reasons = logs.unused | unused
    assert "does not follow" in reasons["run_9"]
    for run in runs:
        assert len(run.joints) == 6
        assert not run.name.startswith("run_9")
