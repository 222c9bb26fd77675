"""Logs of one movement and of encoders: paired, unwrapped, or refused; what is known of one motion
twice agrees, or is refused.
"""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from joint_files import log, read_movement, table
from joint_kinds import motion
from numpy.random import default_rng
from numpy.testing import assert_allclose
from planar_poses import load_arm
from sample_options import made
from written_logs import write_joint_log

from pipeline.arm.interface import trajectory_table
from pipeline.core.angles import TURN, TURN_NOISE, unwrap
from pipeline.core.columns import columns, spread
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.core.options.dataset import Dataset, Encoders, Robot
from pipeline.core.options.dataset import JointLogSection as Log
from pipeline.formats.joints.log import JointLog, LogOptions
from pipeline.formats.joints.table import joint_labels, write_joint_table
from pipeline.recordings import commands, movement
from pipeline.recordings.joint_logs import encoder_rows
from pipeline.recordings.movement import read_logged_movement

cases = cases_beside(__file__)
DAMAGE = ("cut_rows", "blank_rows", "doubled_rows")


def test_logs_of_one_movement_are_paired_row_by_row_as_far_as_the_shortest_goes(
    tmp_path,
):
    first = log(100, seed=1)
    second = log(93, seed=2)
    write_joint_log(tmp_path / "a.csv", first)
    write_joint_log(tmp_path / "b.csv", second)

    (actual, target), counts = read_movement(tmp_path, ["a.csv", "b.csv"])

    assert counts == dict.fromkeys(DAMAGE, 0) | {"rows_without_partner": 7}
    assert_allclose(actual, first.signals["actual"][:93], rtol=0, atol=1e-6)
    assert_allclose(target, second.signals["actual"], rtol=0, atol=1e-6)


def test_the_damage_of_one_table_of_several_signals_is_counted_once(tmp_path):
    rows = "0.000,0.5,1", "0.008,0.6,2", "0.008,0.6,2", "", "0.016,0.7"
    file = table(tmp_path, "t,q,qd", *rows)
    options = LogOptions(joints=1, signals={"actual": ["q"], "target": ["qd"]})

    signals, counts = movement.read_movement({file: options}, 125.0)

    assert signals["actual"].tolist() == [[0.5], [0.6]]
    assert signals["target"].tolist() == [[1], [2]]
    assert counts == dict.fromkeys(DAMAGE, 1) | {"rows_without_partner": 0}


EVEN = 0.008 * np.arange(50)  # s
SKIPPING = np.delete(0.008 * np.arange(51), 20)
CROWDED = np.sort([*EVEN[:49], 0.1624])
CLOCKS = [  # times of a file, and words of the refusal
    (SKIPPING, "a.csv", "is 0.016 s at 0.152 s .*are missing"),
    (CROWDED, "a.csv", "at 0.16 s .*too close"),
    (EVEN / 4, "a.csv", "is 0.002 s on average.* the rate to 500"),
    (EVEN * 1.05, "a.csv", "is 0.0084 s on average.* the rate to 119.048"),
    (EVEN + 0.004, "b.csv", "differ from the times of a.csv"),
]


@pytest.mark.parametrize(("time", "file", "words"), CLOCKS)
def test_clocks_that_skip_or_disagree_are_refused(tmp_path, time, file, words):
    for name in ("a.csv", "b.csv"):
        write_joint_log(tmp_path / name, log(50))
    signals = {"actual": log(50).signals["actual"]}
    write_joint_log(tmp_path / file, JointLog(time, signals, {}))

    with pytest.raises(RecordingError, match=words) as caught:
        read_movement(tmp_path, ["a.csv", "b.csv"])
    assert caught.value.evidence["file"] == tmp_path / file


PAIRED = {"actual": ["actual"], "target": ["target"]}
# rad; the first joint passes π
TURNING = np.linspace(2.9, 3.5, 60)[:, None] * [1.0, 0.1]
WRAP = {
    "to ±π": lambda q: (q + np.pi) % (2 * np.pi) - np.pi,
    "one turn lower": lambda q: q - 2 * np.pi * np.array([1.0, 0.0]),
    "not at all": lambda q: q,
}


@pytest.mark.parametrize("target", WRAP)
@pytest.mark.parametrize("actual", WRAP)
def test_wrapped_angles_are_unwrapped_counted_and_taken_beside_their_command(
    tmp_path,
    actual,
    target,
):
    file = tmp_path / "run.npz"
    joints = ["a", "b"]
    measured = WRAP[actual](TURNING + 1e-5)
    commanded = WRAP[target](TURNING)
    time = np.arange(60) / 100
    np.savez(file, time=time, actual=measured, target=commanded)
    options = made(Log, joints=joints, signals=PAIRED, time="time")

    read = read_logged_movement("run", file, options, 100.0)

    assert_allclose(read.actual - read.target, 1e-5, atol=1e-6)
    # on the circle they are where they were
    assert_allclose(np.cos(read.target), np.cos(TURNING), atol=1e-6)
    assert np.abs(np.diff(read.target, axis=0)).max() < 0.02
    first_joint = np.stack([measured[:, 0], commanded[:, 0]])
    jumps = np.count_nonzero(np.abs(np.diff(first_joint)) > np.pi)
    assert read.counts.get(movement.UNWRAPPED, 0) == jumps
    apart = commanded[0, 0] - measured[0, 0]
    turns = abs(round(apart / TURN))
    assert read.counts.get("joints_moved_by_whole_turns", 0) == turns


@pytest.mark.parametrize(
    ("size", "words"),
    [(4.4, "jumps by 4.4.* 2π"), (1, "jumps by 1.* lost sign")],
)
def test_a_jump_that_is_neither_a_motion_nor_whole_turns_is_refused(
    tmp_path,
    size,
    words,
):
    angles = TURNING + np.where(np.arange(60) < 20, 0.0, size)[:, None] * [0, 1]
    np.savez(tmp_path / "run.npz", time=np.arange(60) / 100, q=angles)

    options = LogOptions(joints=2, names=("a", "b"), signals={"actual": None})

    with pytest.raises(RecordingError, match=rf"b \(actual\) {words}"):
        movement.read_log(tmp_path / "run.npz", options)


RAIL = """<robot name="rail"><link name="base"/><link name="cart"/><link name="arm"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/>
<limit velocity="900" effort="1" lower="0" upper="20"/></joint>
<joint name="turn" type="continuous"><parent link="cart"/><child link="arm"/></joint></robot>
"""


def test_a_spike_of_any_size_is_no_turn():
    time, angles, _ = motion()
    rng = default_rng(1)
    errors = []
    small = rng.uniform(0.78, 1.78, 300)
    great = rng.uniform(1.78, 14, 100)
    for size in 10 ** np.concatenate([small, great]):
        spiked = angles.copy()
        row = rng.integers(400)
        joint = rng.integers(6)
        spiked[row, joint] += rng.choice([-1, 1]) * size
        with suppress(RecordingError):
            unwrapped, _ = unwrap(spiked, time)
            errors.append(np.abs(unwrapped - angles).max())
    # at most 1 % accepted
    assert len(errors) <= 4 and max(errors, default=0) < TURN_NOISE


def test_a_wrap_beside_noise_is_a_turn_and_a_step_of_the_command_is_none():
    time, _, _ = motion()
    step = np.tile(np.where(time > 1, 1.0, 0.0)[:, None], 6)
    _, jumps = unwrap(step, time, signal="target")
    assert jumps == 0

    # control: an angle that crosses half a turn to and fro with noise of 10 mrad wraps at each row
    noisy = np.pi + default_rng(2).normal(0, 0.01, (400, 6))
    wrapped, jumps = unwrap((noisy + np.pi) % TURN - np.pi, time)
    assert jumps > 900 and np.ptp(wrapped - noisy, axis=0).max() < 1e-12


# m; rad
SLIDE = np.linspace(0, 12, 60)
TURN_ANGLES = TURNING[:, 0]
SLIDE[30:] += 3.5
WRAPPED = WRAP["to ±π"](TURN_ANGLES)


@pytest.fixture
def rail(tmp_path) -> str:
    """The URDF of a rail with a turning joint."""
    file = tmp_path / "rail.urdf"
    file.write_text(RAIL)
    return str(file)


def test_a_prismatic_joint_is_not_circular(rail):
    circular = commands.circular_joints(rail, ["slide", "turn"])
    assert circular.tolist() == [False, True]


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_positions_of_a_prismatic_joint_are_metres_and_never_unwrapped(tmp_path, unit):
    file = tmp_path / "run.npz"
    angles = np.degrees(WRAPPED) if unit == "deg" else WRAPPED
    np.savez(file, time=np.arange(60) / 100, q=np.stack([SLIDE, angles], axis=1))
    signals = {"actual": ["q"]}
    options = LogOptions("time", joints=2, angle_unit=unit, signals=signals)

    log = movement.read_log(file, replace(options, circular=np.array([False, True])))

    measured = log.signals["actual"]
    assert_allclose(measured[:, 0], SLIDE, atol=1e-12)
    assert_allclose(measured[:, 1], TURN_ANGLES, atol=1e-12)
    assert log.counts[movement.UNWRAPPED] == 1
    # the control: as angles they jump
    if unit == "rad":
        with pytest.raises(RecordingError, match=r"joint 1 .* jumps by"):
            movement.read_log(file, options)


def test_turns_beside_the_command_of_a_prismatic_joint_are_no_whole_turns(
    tmp_path,
    rail,
):
    file = tmp_path / "run.npz"
    time = np.arange(60) / 100
    target = np.stack([SLIDE, WRAPPED], axis=1)
    apart = np.array([TURN, 0.0])
    np.savez(file, time=time, actual=target + apart, target=target)
    options = made(Log, joints=["slide", "turn"], signals=PAIRED, time="time")
    with pytest.raises(RecordingError, match="slide misses its command"):
        read_logged_movement("run", file, options, 100.0, rail)


NAMES = ["shoulder", "elbow"]


def encoder_dataset(**options) -> Dataset:
    stated = {"training": "logs/train_*.csv", "test": "logs/test_*.csv", "time": "time"}
    stated |= {"actual": joint_labels("actual", NAMES)}
    robot = Robot("arm.urdf", NAMES, task=["x"])
    return made(Dataset, robot=robot, encoders=Encoders(**stated | options))


ELBOW = """<robot name="arm"><link name="base"/><link name="upper"/><link name="lower"/>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
<limit velocity="2" effort="1" lower="-9" upper="9"/></joint></robot>
"""
CLOCK = 7 + np.arange(40) / 250  # s


@pytest.fixture
def raw(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(ELBOW)
    (tmp_path / "logs").mkdir()

    q = default_rng(1).normal(0, 1e-3, (40, 2)).round(4)
    for take in ("test_b", "test_a", "train_a"):
        signals = {"target": np.zeros((40, 2)), "actual": q}
        write_joint_table(tmp_path / f"logs/{take}.csv", CLOCK, signals, NAMES)
    return tmp_path, q


def test_every_log_of_a_take_is_read_at_its_own_rate(raw):
    folder, q = raw

    logs = encoder_rows(folder, encoder_dataset(start=6.9))

    first_rows = [rows.iloc[0] for rows, _ in logs]
    takes = [(row["take"], row["part"]) for row in first_rows]
    assert takes == [("train_a", "training"), ("test_a", "test"), ("test_b", "test")]
    rows, quality = logs[1]
    assert_allclose(rows["t"], 0.1 + np.arange(40) / 250, atol=1e-9)
    assert_allclose(rows[["q:shoulder", "q:elbow"]], q, atol=1e-9)
    counts = {row["quantity"]: row["value"] for row in quality}
    assert counts["rows"] == 40


def write_step(folder: Path, q: np.ndarray, size: float) -> np.ndarray:
    """Write a log in which the elbow steps by a ``size``; return its angles (40, 2)."""
    stepping = q.copy()
    stepping[21:, 1] += size
    signals = {"target": 0 * q, "actual": stepping}
    write_joint_table(folder / "logs/test_a.csv", CLOCK, signals, NAMES)
    return stepping


def test_a_step_that_the_joint_cannot_make_is_refused(raw):
    write_step(*raw, 0.1)
    words = r"elbow \(actual\) steps by .* allows 2 rad/s"
    with pytest.raises(RecordingError, match=words):
        encoder_rows(raw[0], encoder_dataset())


def test_metres_are_no_angles(raw):
    folder, q = raw
    sliding = ELBOW.replace("revolute", "prismatic")
    sliding = sliding.replace('velocity="2"', 'velocity="900"')
    (folder / "arm.urdf").write_text(sliding)
    positions = write_step(folder, q, 3.5)
    rows, _ = encoder_rows(folder, encoder_dataset())[1]
    assert_allclose(rows["q:elbow"], positions[:, 1], atol=1e-6)


@cases("other joints")
def test_logs_of_other_joints_are_refused(raw, options, words):
    with pytest.raises(PipelineError, match=words):
        encoder_rows(raw[0], encoder_dataset(**options))


RATE = 100.0
JOINTS = ["joint_2", "joint_3", "joint_4"]
TIME = np.arange(301) / RATE
POSITIONS, VELOCITIES = (columns(family, ("x", "z", "phi")) for family in "xv")


CHAIN = load_arm("pipeline/arm/ur5.urdf", JOINTS, "wrist_centre", {}).chain
# (301, 3) rad: there and back, from rest to rest
SHARE = (1 - np.cos(2 * np.pi * TIME / TIME[-1])) / 2
Q = np.array([-0.2, 1.0, -2.6]) + SHARE[:, None] * [-1.4, 0.5, 1.4]


def exchanged(table: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    first, second, *_ = names
    return table.assign(**{first: table[second], second: table[first]})


def scaled(table: pd.DataFrame, names: list[str], factor: float) -> pd.DataFrame:
    return table.assign(**{name: factor * table[name] for name in names})


def late(columns_in_time: pd.DataFrame) -> pd.DataFrame:
    """The columns a second later."""
    return columns_in_time.shift(100).bfill()


WRONG = {
    "millimetres": lambda table, names: scaled(table, names[:2], 1000),
    "degrees": lambda table, names: scaled(table, names[2:], 180 / np.pi),
    "exchanged": exchanged,
    "a second late": lambda table, names: table.assign(**late(table[names])),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_path_or_velocities_in_another_unit_order_or_clock_are_refused(wrong):
    tracked = Q + default_rng(1).normal(0, 5e-3, Q.shape)
    trajectory = trajectory_table(CHAIN, Q, RATE)
    spoil = WRONG[wrong]
    commands.require_commanded(tracked, trajectory, CHAIN, "a")

    words = r"not on the commanded path.*suspected"
    with pytest.raises(RecordingError, match=words) as refused:
        commands.require_commanded(tracked, spoil(trajectory, POSITIONS), CHAIN, "a")
    assert refused.value.evidence["take"] == "a"
    commands.require_velocities(trajectory, RATE, Path("t.csv"))
    with pytest.raises(RecordingError, match="do not lead along") as refused:
        commands.require_velocities(spoil(trajectory, VELOCITIES), RATE, Path("t.csv"))
    assert refused.value.evidence["file"] == Path("t.csv")


TRACKED = pd.DataFrame({"t": TIME} | spread("q", JOINTS, Q))
TIMES = np.arange(250) / 83.3
READINGS = pd.DataFrame({"t": TIMES})
for name, joint in zip(columns("q", JOINTS), Q.T, strict=True):
    READINGS[name] = np.interp(TIMES, TIME, joint) + 2e-3
OTHER_READINGS = {  # words of the refusal: readings
    "angle_unit": scaled(READINGS, columns("q", JOINTS), 180 / np.pi),
    "order of the columns": exchanged(READINGS, columns("q", JOINTS)),
    "start of the log": READINGS.add([1, 0, 0, 0]),
    "0 of 250 readings": READINGS.add([10, 0, 0, 0]),
    "joint_2 .*6.28.*turns": READINGS.add([0, 2 * np.pi, 0, 0]),
}


def test_encoders_that_agree_with_what_was_tracked_are_accepted():
    commands.require_encoders(TRACKED, READINGS, JOINTS, "a")


@pytest.mark.parametrize("words", OTHER_READINGS)
def test_encoders_in_another_unit_order_or_clock_than_what_was_tracked_are_refused(
    words,
):
    with pytest.raises(RecordingError, match=words):
        commands.require_encoders(TRACKED, OTHER_READINGS[words], JOINTS, "a")


def test_speeds_of_true_steps_count_steps_beyond_a_limit_and_against_the_command():
    nominal = np.array([[0.01, 0.0], [0.01, 0.0], [0.01, 0.002], [0.0, 0.0]])
    steps = np.stack([nominal, nominal])
    command = steps, np.array([1.0, 1.0]), 100.0, ["a", "b"]
    obeyed = commands.speed_scores(steps, *command)

    assert obeyed["true_moving_steps_beyond_a_speed_limit_share"] == 0
    assert obeyed["true_a_fast_steps_backwards_share"] == 0
    assert obeyed["true_a_greatest_speed_rad_per_s"] == pytest.approx(1.0)

    disturbed = steps.copy()
    disturbed[0, 0, 0] = -0.05
    disturbed[1, 2, 1] = -0.0021
    disturbed[1, 3, 1] = 0.04  # at rest
    scores = commands.speed_scores(disturbed, *command)
    beyond = scores["true_moving_steps_beyond_a_speed_limit_share"]

    assert beyond == pytest.approx(1 / 6)
    assert scores["true_a_greatest_speed_rad_per_s"] == pytest.approx(5.0)
    assert scores["true_b_greatest_speed_rad_per_s"] == pytest.approx(4.0)
    assert scores["true_a_fast_steps_backwards_share"] == pytest.approx(1 / 6)
    assert scores["true_b_fast_steps_backwards_share"] == 0.5
