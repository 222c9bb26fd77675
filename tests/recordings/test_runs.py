"""Runs in the logs of an arm: all rows, each run without its own lag, runs with equal commands as
one motion, with the step of the recorded angles; joints that stand still and other files are named.
"""

from pathlib import Path

import numpy as np
import pytest
from joint_logs import write_movement
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

RATE, N = 200.0, 1600
SHARED = ROOT.parent / "shared/recordings"
SINES = np.array([0.3, 0.5, 0.7])  # Hz


def wave(t: np.ndarray, phase: float = 0.0) -> np.ndarray:
    """Command (N, 3) in rad that never rests, with a period of 10 s."""
    sines = np.sin(2 * np.pi * np.outer(t + phase, SINES))
    return sines + 0.2 * np.cos(2 * np.pi * t)[:, None]


def movement(target: np.ndarray, actual: np.ndarray) -> LoggedMovement:
    joints = [f"joint_{j}" for j in range(1, target.shape[1] + 1)]
    motions, turning = excursions(target, RATE), np.ones(len(joints), bool)
    return LoggedMovement(joints, actual, target, motions, {}, turning)


def stops(ways: int, seed: int, late: float = 0.0) -> LoggedMovement:
    """Out and back ``ways`` times with rests of 0.4 s, measured ``late`` s later with noise."""
    rng, t = np.random.default_rng(seed), np.arange(280 * ways + 80) / RATE

    def command(at: np.ndarray) -> np.ndarray:
        way, since = np.divmod(np.clip(at * RATE - 80, 0, None), 280)
        share = (1 - np.cos(np.pi * np.clip(since / 200, 0, 1))) / 2
        return np.where(way % 2 == 0, share, 1 - share)[:, None] * [0.8, -0.5, 0.3]

    actual = command(t - late) + rng.normal(0, 2e-5, (len(t), 3))
    return movement(command(t), actual)


@pytest.mark.parametrize("late", [0.0017, -0.0081])
def test_each_run_loses_its_own_lag_also_a_joints_own_and_below_one_sample(late):
    t, rng = np.arange(N) / RATE, np.random.default_rng(1)
    lags = late + np.array([0.0, 0.0, 0.006])
    shifted = [wave(t - lag)[:, j] for j, lag in enumerate(lags)]
    actual = np.stack(shifted, axis=1) + rng.normal(0, 1e-4, (N, 3))
    np.testing.assert_allclose(joint_lags(wave(t), actual, RATE), lags, atol=5e-5)

    (run,), unused = joint_runs({"log": movement(wave(t), actual)}, RATE)
    assert run.name == "log" and not unused and len(run.command) > N - 6
    np.testing.assert_allclose((run.measured - run.command).std(axis=0), 1e-4, rtol=0.1)


def test_equal_commands_are_one_motion_and_no_row_is_lost_between_them():
    logs = {"a": stops(4, 1), "b": stops(3, 2, late=0.002), "c": stops(2, 3)}
    runs, unused = joint_runs(logs, RATE)
    assert not unused and "".join(run.motion for run in runs) == "121212112"
    rows = sum(len(run.command) for run in runs)
    assert rows > sum(len(log.target) for log in logs.values()) - 10
    lags = {run.name[0]: run.lag[0] for run in runs}
    assert lags["b"] == pytest.approx(0.002, abs=5e-5) and abs(lags["a"]) < 5e-5
    # rows at rest show the noise
    assert runs[0].pose_noise == pytest.approx(2e-5, rel=0.1)
    # a stretch of a long run is of the long run's motion; another command is not
    t = np.arange(N) / RATE
    longer = {"long": wave(t), "part": wave(t[300:1300]), "other": wave(t, phase=1.2)}
    logs = {name: movement(q, q + 1e-6) for name, q in longer.items()}
    runs, _ = joint_runs(logs, RATE)
    assert [run.motion for run in runs] == ["1", "1", "2"]


def test_disturbed_runs_standing_joints_and_logs_at_rest_are_named():
    logs = {name: stops(3, seed) for seed, name in enumerate("abcd")}
    logs["c"].actual[150:200, 1] += 0.01
    logs["still"] = movement(np.zeros((N, 3)), np.zeros((N, 3)))
    runs, unused = joint_runs(logs, RATE)
    assert "disturbed" in unused["c_1"] and "never moves" in unused["still"]
    assert len(unused) == 2 and len(runs) == 4 * 3 - 1
    for log in logs.values():
        log.actual[:, 2] = 0.0
    runs, unused = joint_runs(logs, RATE)
    assert "it moves by 0 rad" in unused["joint_3"]
    assert runs[0].joints == ("joint_1", "joint_2")
    with pytest.raises(RecordingError, match=r"still: the command never moves"):
        joint_runs({"still": logs["still"]}, RATE)
    # a file that was copied is no second recording
    logs = {"a": stops(2, 1), "b": stops(2, 1), "c": stops(2, 2)}
    runs, unused = joint_runs(logs, RATE)
    assert len(runs) == 4 and [*unused] == ["b"] and unused["b"].startswith("a copy:")


def test_an_export_with_fewer_digits_and_a_copy_with_noise_are_named_as_copies():
    """Each log sways in its own way; one is rounded to fewer digits, one has noise of its own."""
    rng = np.random.default_rng(1)
    logs = {name: stops(2, seed) for seed, name in enumerate("abcde")}
    for log in logs.values():
        t = np.arange(len(log.actual))[:, None] / RATE
        frequency, phase = rng.uniform(9, 20, 3), rng.uniform(0, 6, 3)
        log.actual[:] += 1e-3 * np.sin(frequency * t + phase)
    assert joint_runs(logs, RATE)[1] == {}
    noise = rng.normal(0, 2e-5, logs["a"].actual.shape)
    logs["noisy"] = logs["a"]._replace(actual=logs["a"].actual + noise)
    logs["rounded"] = logs["b"]._replace(actual=logs["b"].actual.round(4))
    _, unused = joint_runs(logs, RATE)
    assert unused.pop("rounded").startswith("a copy: its measured angles are equal")
    assert {*unused} == {"a_1", "a_2", "noisy_1", "noisy_2"}
    for reason in unused.values():
        assert "a copy: 2 runs are equal within the noise" in reason


@pytest.mark.parametrize(("size", "follows", "left_out"), [
    (0.05, False, ["c_1"]),
    (-0.03, False, ["c_1"]),
    (0.05, True, []),
    (2e-4, False, []),
])  # fmt: skip
def test_a_wrong_command_leaves_out_its_own_run_alone(size, follows, left_out):
    logs = {name: stops(3, seed) for seed, name in enumerate("abcd")}
    logs["c"].target[180, 1] += size
    if follows:
        logs["c"].actual[180, 1] += size
    _, unused = joint_runs(logs, RATE)
    wrong = [name for name, reason in unused.items() if "and back in row 180" in reason]
    assert wrong == left_out
    assert {*unused} <= {"c_1"}


def test_a_second_way_that_runs_repeat_is_no_disturbance():
    logs = {name: stops(3, seed) for seed, name in enumerate("abcdefg")}
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
    home, names = np.array([-1.2, 1.4, -1.0]), ["joint_2", "joint_3", "joint_4"]
    log = stops(10, 1)
    target, actual = log.target + home, log.actual + home
    log = log._replace(joints=names, target=target, actual=actual)
    if pushed is not None:
        first = 80 + 560 * pushed + 60
        log.actual[first : first + 40, 1] += 0.02
    robot = Robot("pipeline/arm/ur5.urdf", names, "wrist_centre", plane=True)
    there, back = find_motions({"log": log}, robot, RATE)
    for motion, start in ((there, home), (back, home + np.array([0.8, -0.5, 0.3]))):
        assert 195 < motion.steps <= 200 and 79 <= motion.pause < 85
        assert len(motion.places) == 5
        np.testing.assert_allclose(motion.start, start, atol=1e-3)
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
    rng, t = np.random.default_rng(2), np.arange(4000) / RATE
    angles = np.sin(0.1 * t) + rng.normal(0, 1e-5, len(t))
    recorded = quantum * np.rint(angles / quantum) if quantum else angles
    assert find_quantum(np.round(recorded, printed)) == pytest.approx(quantum, rel=0.03)


@pytest.mark.parametrize(("quantum", "expected"), [(9.4e-6, 9.4e-6), (1e-9, 0.0)])
def test_a_constant_speed_is_no_step_of_the_angles(quantum, expected):
    speed = 399e-6 + 1e-6 * np.sin(np.arange(1200) / 50)  # rad a row
    starting = np.linspace(0.1, 1.0, 25) * 399e-6
    angles = np.cumsum(np.concatenate([starting, speed]))
    recorded = quantum * np.rint(angles / quantum)
    assert find_quantum(recorded) == pytest.approx(expected, rel=1e-3)


def test_arrays_of_joints_by_samples_are_read_and_other_files_change_nothing(tmp_path):
    t = np.arange(N) / RATE
    q, degrees = wave(t), np.degrees(wave(t - 0.002)).T
    signals = {"act_pos_se_deg": degrees, "ref_pos_deg": np.degrees(q).T}
    signals["act_pos_mot_deg"] = 0.9 * degrees
    for run in "AB":
        rec = {"time_cont": t, "time_disc": np.arange(1.0, N + 1), **signals}
        savemat(tmp_path / f"run_{run}.mat", {"rec": rec})
    alone = folder_logs(tmp_path, {})
    assert alone.rate == RATE and [*alone.movements] == ["run_A", "run_B"]
    np.testing.assert_allclose(alone.movements["run_A"].target, q)
    rec = {"time": t, "q_actual": q[:, :2], "q_target": q[:, :2]}
    np.savez(tmp_path / "gripper.npz", **rec)
    (tmp_path / "notes.txt").write_text("recorded on a Monday\n")
    forces = "".join(f"{k},{k}\n" for k in range(30))
    (tmp_path / "forces.csv").write_text(f"time,fx\n{forces}")
    both = folder_logs(tmp_path, {})
    assert [*both.movements] == ["run_A", "run_B"]
    assert "another arm" in both.unused["gripper"]
    read_beside, read_alone = (logs.movements["run_A"] for logs in (both, alone))
    np.testing.assert_array_equal(read_beside.actual, read_alone.actual)
    # a value that is set replaces a stated one
    slower = folder_logs(tmp_path, {"motion.rate": "100", "joint_log.time": "null"})
    assert slower.rate == 100.0


def test_tables_of_a_movement_take_their_rate_from_the_times(tmp_path):
    write_movement(tmp_path / "move_1", 3, noise=5e-5, late=0.001)
    logs = folder_logs(tmp_path, {})
    assert logs.rate == 125.0
    assert any("angle_unit: rad" in words for words in logs.suggested)
    runs, unused = joint_runs(logs.movements, logs.rate)
    assert [run.motion for run in runs] == ["1", "2", "1"] and not unused
    assert runs[0].lag == pytest.approx(np.full(6, 0.001), abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "rows", "motions", "joints", "error"),
    [
        ("ur5", 17_005, 8, 6, 2e-3),
        ("lwr4", 9_440, 1, 7, 3.5e-4),
        ("kr300", 5_002, 2, 3, 2.6e-3),
    ],
)
def test_the_runs_of_real_arms_use_their_rows(robot, rows, motions, joints, error):
    if not (SHARED / robot).is_dir():
        pytest.skip("the recordings of the real robots are not here")
    logs = folder_logs(Path(SHARED / robot), {})
    runs, _ = joint_runs(logs.movements, logs.rate)
    assert sum(len(run.command) for run in runs) > 0.98 * rows
    assert len({run.motion for run in runs}) == motions
    assert len(runs[0].joints) == joints
    for run in runs:
        assert (run.measured - run.command).std(axis=0).max() < error
    if robot == "ur5":
        quanta = np.mean([run.quantum for run in runs], axis=0)
        np.testing.assert_allclose(quanta, [9.45e-6] * 3 + [1.62e-5] * 3, rtol=0.02)
