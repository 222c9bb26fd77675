"""Signals, joints and commands by the names of columns, and by their values."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.joints.names import match_joints, signals_of


def n(form: str, joints: int = 2, first: int = 0) -> list[str]:
    return [form.format(j) for j in range(first, first + joints)]


LABELS = read_yaml(Path(__file__).with_name("labels.yaml"))


@pytest.mark.parametrize("name", LABELS)
def test_labels_say_which_columns_are_a_signal(name):
    signals = dict(LABELS[name])
    labels = signals.pop("labels")
    assert signals_of(labels) == (signals, {})


UR_JOINTS = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"]
UR_JOINTS += [f"wrist_{j}_joint" for j in (1, 2, 3)]
ORDERED = [  # names in a file, joints of a URDF, the joints that the names mean
    (["actual_elbow", "actual_shoulder_pan", "actual_wrist_2"], UR_JOINTS,
     ["elbow_joint", "shoulder_pan_joint", "wrist_2_joint"]),
    (["Wrist3Pos", "Wrist1Pos"], UR_JOINTS, ["wrist_3_joint", "wrist_1_joint"]),
    (n("q_{}", 3, 1), n("arm_joint_{}", 3, 1), n("arm_joint_{}", 3, 1)),
    (n("A{}", 3, 1), n("joint_a{}", 3, 1), n("joint_a{}", 3, 1)),
    (["elbow", "finger"], UR_JOINTS, ["elbow_joint", "finger"]),
    (["base", "shoulder"], UR_JOINTS, ["base", "shoulder"]),
    (["elbow", "elbow_joint"], UR_JOINTS, []),
]  # fmt: skip


@pytest.mark.parametrize(("names", "joints", "meant"), ORDERED)
def test_names_in_a_file_mean_joints_of_the_urdf_whatever_their_order(
    names,
    joints,
    meant,
):
    assert match_joints(names, joints) == meant


TIME = np.arange(400) / 125
Q = np.stack([np.sin(TIME), 0.4 * np.cos(2 * TIME)], axis=1)
SPEED = np.stack([np.cos(TIME), -0.8 * np.sin(2 * TIME)], axis=1)
NOISE = np.random.default_rng(1).normal(0, 1e-4, Q.shape)


def held(**groups: np.ndarray):
    columns = {
        f"{n}_{j}": rows[:, j]
        for n, rows in groups.items()
        for j in range(rows.shape[1])
    }
    return signals_of([*columns], TIME, columns.__getitem__)


@pytest.mark.parametrize("unit", [1.0, 180 / np.pi, 1e-3])
def test_qd_is_a_speed_where_it_is_the_derivative_of_q_in_whatever_unit(unit):
    signals, guessed = held(q=Q + NOISE, qd=unit * SPEED + NOISE)
    assert [*signals] == ["actual"] and not guessed
    # beside it the commanded angles are found by their name, or by their values as a guess
    for name, sure in (("tq", True), ("other", False)):
        signals, guessed = held(q=Q + NOISE, qd=unit * SPEED, **{name: Q})
        assert (
            signals["target"] == [f"{name}_0", f"{name}_1"]
            and ("target" in guessed) != sure
        )


def test_qd_is_the_command_where_it_follows_q_and_a_guess_where_it_is_only_no_speed():
    assert held(q=Q + NOISE, qd=Q) == (
        {"actual": ["q_0", "q_1"], "target": ["qd_0", "qd_1"]},
        {},
    )
    signals, guessed = held(q=Q + NOISE, qd=57.3 * Q)
    assert signals["target"] == ["qd_0", "qd_1"] and "no speed" in guessed["target"]
    # nothing moves: the name decides
    assert "target" not in held(q=0 * Q, qd=0 * Q)[0]


def test_four_columns_of_length_one_are_a_quaternion():
    turned = np.stack([np.cos(TIME), np.sin(TIME), 0 * TIME, 0 * TIME], axis=1)
    assert held(q=turned) == ({}, {})
    assert [*held(q=1.1 * turned)[0]] == ["actual"]
