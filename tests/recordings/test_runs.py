"""Runs in the logs of an arm: all rows, each run without its own lag, runs with equal commands as
one motion, with the step of the recorded angles; joints that stand still and other files are named.
"""

from pathlib import Path

import numpy as np
import pytest
from case_tables import cases_beside
from joint_logs import write_movement
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat
from source_code import ROOT

from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Robot
from pipeline.recordings.lags import joint_lags
from pipeline.recordings.motions import find_motions
from pipeline.recordings.movement import LoggedMovement
from pipeline.recordings.repetitions import excursions
from pipeline.recordings.runs import find_quantum, joint_runs
from pipeline.tools.characterize.logs import folder_logs

cases = cases_beside(__file__)
RATE = 200.0
N = 1600
SHARED = ROOT.parent / "shared/recordings"
SINES = np.array([0.3, 0.5, 0.7])  # Hz


def wave(t: np.ndarray, phase: float = 0.0) -> np.ndarray:
    """Command (N, 3) in rad that never rests, with a period of 10 s."""
    sines = np.sin(2 * np.pi * np.outer(t + phase, SINES))
    cosine = np.cos(2 * np.pi * t)
    return sines + 0.2 * cosine[:, None]


def movement(target: np.ndarray, actual: np.ndarray) -> LoggedMovement:
    joints = [f"joint_{j}" for j in range(1, target.shape[1] + 1)]
    motions = excursions(target, RATE)
    turning = np.ones(len(joints), bool)
    return LoggedMovement(joints, actual, target, motions, {}, turning)


def stops(ways: int, seed: int, late: float = 0.0) -> LoggedMovement:
    """Out and back ``ways`` times with rests of 0.4 s, measured ``late`` s later with noise."""
    rng = default_rng(seed)
    t = np.arange(280 * ways + 80) / RATE

    def command(at: np.ndarray) -> np.ndarray:
        rows = np.clip(at * RATE - 80, 0, None)
        way, since = np.divmod(rows, 280)
        phase = np.pi * np.clip(since / 200, 0, 1)
        share = (1 - np.cos(phase)) / 2
        progress = np.where(way % 2 == 0, share, 1 - share)
        return progress[:, None] * [0.8, -0.5, 0.3]

    noise = rng.normal(0, 2e-5, (len(t), 3))
    return movement(command(t), command(t - late) + noise)


def several(names: str, ways: int) -> dict[str, LoggedMovement]:
    """Logs of :func:`stops` by their ``names`` of a letter, each with noise of its own."""
    return {name: stops(ways, seed) for seed, name in enumerate(names)}


@pytest.mark.parametrize("late", [0.0017, -0.0081])
def test_each_run_loses_its_own_lag_also_a_joints_own_and_below_one_sample(late):
    t = np.arange(N) / RATE
    rng = default_rng(1)
    lags = [late, late, late + 0.006]
    actual = rng.normal(0, 1e-4, (N, 3))
    for joint, lag in enumerate(lags):
        actual[:, joint] += wave(t - lag)[:, joint]
    assert_allclose(joint_lags(wave(t), actual, RATE), lags, atol=5e-5)

    (run,), unused = joint_runs({"log": movement(wave(t), actual)}, RATE)

    assert run.name == "log" and not unused
    assert len(run.command) > N - 6
    error = run.measured - run.command
    assert_allclose(error.std(axis=0), 1e-4, rtol=0.1)


def test_equal_commands_are_one_motion_and_no_row_is_lost_between_them():
    logs = {"a": stops(4, 1), "b": stops(3, 2, late=0.002), "c": stops(2, 3)}

    runs, unused = joint_runs(logs, RATE)

    assert not unused and "".join(run.motion for run in runs) == "121212112"
    rows = sum(len(run.command) for run in runs)
    logged = sum(len(log.target) for log in logs.values())
    assert rows > logged - 10
    lags = {run.name[0]: run.lag[0] for run in runs}
    assert lags["a"] == pytest.approx(0, abs=5e-5)
    assert lags["b"] == pytest.approx(0.002, abs=5e-5)
    # rows at rest show the noise
    assert runs[0].pose_noise == pytest.approx(2e-5, rel=0.1)


def test_a_stretch_of_a_long_run_is_of_its_motion_and_another_command_is_not():
    t = np.arange(N) / RATE
    logs = {}
    for name, q in (("a", wave(t)), ("b", wave(t[300:1300])), ("c", wave(t, 1.2))):
        logs[name] = movement(q, q + 1e-6)

    runs, _ = joint_runs(logs, RATE)

    assert [run.motion for run in runs] == ["1", "1", "2"]


def test_disturbed_runs_and_logs_at_rest_are_named():
    logs = several("abcd", ways=3)
    logs["c"].actual[150:200, 1] += 0.01
    logs["still"] = movement(np.zeros((N, 3)), np.zeros((N, 3)))

    runs, unused = joint_runs(logs, RATE)

    assert "disturbed" in unused["c_1"] and "never moves" in unused["still"]
    assert len(unused) == 2 and len(runs) == 4 * 3 - 1
    with pytest.raises(RecordingError, match=r"still: the command never moves"):
        joint_runs({"still": logs["still"]}, RATE)


def test_a_joint_that_stands_still_is_named():
    logs = several("ab", ways=3)
    for log in logs.values():
        log.actual[:, 2] = 0.0

    runs, unused = joint_runs(logs, RATE)

    assert "it moves by 0 rad" in unused["joint_3"]
    assert runs[0].joints == ("joint_1", "joint_2")


def test_a_file_that_was_copied_is_no_second_recording():
    logs = {"a": stops(2, 1), "b": stops(2, 1), "c": stops(2, 2)}
    runs, unused = joint_runs(logs, RATE)

    assert len(runs) == 4 and [*unused] == ["b"]
    assert unused["b"].startswith("a copy:")


def test_an_export_with_fewer_digits_and_a_copy_with_noise_are_named_as_copies():
    """Each log sways in its own way; one is rounded to fewer digits, one has noise of its own."""
    rng = default_rng(1)
    logs = several("abcde", ways=2)
    for log in logs.values():
        t = np.arange(len(log.actual))[:, None] / RATE
        frequency = rng.uniform(9, 20, 3)
        phase = rng.uniform(0, 6, 3)
        log.actual[:] += 1e-3 * np.sin(frequency * t + phase)
    _, unused = joint_runs(logs, RATE)
    assert unused == {}

    a = logs["a"].actual
    b = logs["b"].actual
    noise = rng.normal(0, 2e-5, a.shape)
    logs["noisy"] = logs["a"]._replace(actual=a + noise)
    logs["rounded"] = logs["b"]._replace(actual=b.round(4))
    _, unused = joint_runs(logs, RATE)

    assert unused.pop("rounded").startswith("a copy: its measured angles are equal")
    assert {*unused} == {"a_1", "a_2", "noisy_1", "noisy_2"}
    for reason in unused.values():
        assert "a copy: 2 runs are equal within the noise" in reason


@cases("wrong commands")
def test_a_wrong_command_leaves_out_its_own_run_alone(size, follows, left_out):
    logs = several("abcd", ways=3)
    logs["c"].target[180, 1] += size
    if follows:
        logs["c"].actual[180, 1] += size
    _, unused = joint_runs(logs, RATE)
    wrong = [name for name, reason in unused.items() if "and back in row 180" in reason]

    assert wrong == left_out
    assert {*unused} <= {"c_1"}


def test_a_second_way_that_runs_repeat_is_no_disturbance():
    logs = several("abcdefg", ways=3)
    rows = np.arange(len(logs["a"].actual))
    another_way = 3e-4 * np.sin(rows / 40)
    for name in "abc":
        logs[name].actual[:, 1] += another_way
    _, unused = joint_runs(logs, RATE)
    assert not unused

    logs["d"].actual[150:200, 1] += 0.01
    _, unused = joint_runs(logs, RATE)
    assert [*unused] == ["d_1"]


@pytest.mark.parametrize("pushed", [None, 3])
def test_motions_to_analyse_have_ends_steps_pauses_and_repetitions(pushed):
    home = np.array([-1.2, 1.4, -1.0])
    away = np.array([-0.4, 0.9, -0.7])
    names = ["joint_2", "joint_3", "joint_4"]
    log = stops(10, 1)
    target = log.target + home
    actual = log.actual + home
    log = log._replace(joints=names, target=target, actual=actual)
    if pushed is not None:
        first = 80 + 560 * pushed + 60
        log.actual[first : first + 40, 1] += 0.02
    robot = Robot("pipeline/arm/ur5.urdf", names, "wrist_centre", plane=True)

    there, back = find_motions({"log": log}, robot, RATE)

    assert_allclose(there.start, home, atol=1e-3)
    assert_allclose(back.start, away, atol=1e-3)
    for motion in (there, back):
        assert 195 < motion.steps <= 200 and 79 <= motion.pause < 85
        assert len(motion.places) == 5
        assert motion.deviation < 1e-9 and motion.least_singular > 0.01
        # less than half of the pause, so that no row at rest is in two takes
        assert 0 < motion.rest(RATE) < 40
    # the fourth one there, and no other, was disturbed
    assert there.disturbed == ([] if pushed is None else [there.places[pushed]])
    assert back.disturbed == []


def test_rows_at_the_end_where_the_arm_has_stopped_are_left_out():
    t = np.arange(N) / RATE
    actual = wave(t - 0.001)
    actual[-20:] = actual[-20]

    (run,), _ = joint_runs({"log": movement(wave(t), actual)}, RATE)

    assert np.abs(run.measured - run.command).max() < 1e-3
    assert N - 40 < len(run.command) < N - 10
    assert run.lag[0] == pytest.approx(0.001, abs=5e-5)


@pytest.mark.parametrize(
    ("quantum", "printed"),
    [(9.5e-6, 6), (1.6e-5, 8), (1e-3, 6), (0.0, 12)],
)
def test_the_step_of_recorded_angles_is_found_where_there_is_one(quantum, printed):
    t = np.arange(4000) / RATE
    angles = np.sin(0.1 * t) + default_rng(2).normal(0, 1e-5, len(t))
    if quantum:
        angles = quantum * np.rint(angles / quantum)

    estimated = find_quantum(np.round(angles, printed))

    assert estimated == pytest.approx(quantum, rel=0.03)


@pytest.mark.parametrize(("quantum", "expected"), [(9.4e-6, 9.4e-6), (1e-9, 0.0)])
def test_a_constant_speed_is_no_step_of_the_angles(quantum, expected):
    # rad a row
    starting = np.linspace(40e-6, 399e-6, 25)
    speed = 399e-6 + 1e-6 * np.sin(np.arange(1200) / 50)
    angles = np.cumsum(np.concatenate([starting, speed]))
    recorded = quantum * np.rint(angles / quantum)

    estimated = find_quantum(recorded)

    assert estimated == pytest.approx(expected, rel=1e-3)


@pytest.fixture
def structs(tmp_path) -> Path:
    """A folder of two runs as structs of arrays of joints by samples, in degrees."""
    t = np.arange(N) / RATE
    measured = np.degrees(wave(t - 0.002)).T
    rec = {"time_cont": t, "time_disc": np.arange(1.0, N + 1)}
    rec |= {"act_pos_se_deg": measured, "act_pos_mot_deg": 0.9 * measured}
    rec["ref_pos_deg"] = np.degrees(wave(t)).T

    for run in "AB":
        savemat(tmp_path / f"run_{run}.mat", {"rec": rec})
    return tmp_path


def test_arrays_of_joints_by_samples_are_read(structs):
    logs = folder_logs(structs, {})
    assert logs.rate == RATE and [*logs.movements] == ["run_A", "run_B"]
    target = logs.movements["run_A"].target
    assert_allclose(target, wave(np.arange(N) / RATE))

    # a value that is set replaces a stated one
    slower = folder_logs(structs, {"motion.rate": "100", "joint_log.time": "null"})
    assert slower.rate == 100.0


def test_other_files_beside_the_logs_change_nothing(structs):
    alone = folder_logs(structs, {}).movements["run_A"]
    t = np.arange(N) / RATE
    two_joints = wave(t)[:, :2]
    rec = {"time": t, "q_actual": two_joints, "q_target": two_joints}
    np.savez(structs / "gripper.npz", **rec)
    (structs / "notes.txt").write_text("recorded on a Monday\n")
    forces = "".join(f"{k},{k}\n" for k in range(30))
    (structs / "forces.csv").write_text(f"time,fx\n{forces}")

    logs = folder_logs(structs, {})

    assert [*logs.movements] == ["run_A", "run_B"]
    assert "another arm" in logs.unused["gripper"]
    assert_array_equal(logs.movements["run_A"].actual, alone.actual)


def test_tables_of_a_movement_take_their_rate_from_the_times(tmp_path):
    write_movement(tmp_path / "move_1", 3, noise=5e-5, late=0.001)
    logs = folder_logs(tmp_path, {})
    assert logs.rate == 125.0
    assert any("angle_unit: rad" in words for words in logs.suggested)

    runs, unused = joint_runs(logs.movements, logs.rate)
    assert [run.motion for run in runs] == ["1", "2", "1"] and not unused
    assert runs[0].lag == pytest.approx(np.full(6, 0.001), abs=1e-4)


@pytest.mark.slow
@cases("real arms")
def test_the_runs_of_real_arms_use_their_rows(robot, rows, motions, joints, error):
    if not (SHARED / robot).is_dir():
        pytest.skip("the recordings of the real robots are not here")

    logs = folder_logs(Path(SHARED / robot), {})
    runs, _ = joint_runs(logs.movements, logs.rate)

    assert sum(len(run.command) for run in runs) > 0.98 * rows
    assert len({run.motion for run in runs}) == motions
    assert len(runs[0].joints) == joints
    for run in runs:
        deviation = run.measured - run.command
        assert deviation.std(axis=0).max() < error
    if robot == "ur5":
        quanta = np.mean([run.quantum for run in runs], axis=0)
        assert_allclose(quanta[:3], 9.45e-6, rtol=0.02)
        assert_allclose(quanta[3:], 1.62e-5, rtol=0.02)
