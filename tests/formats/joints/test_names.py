"""Signals, joints and commands by the names of columns, and by their values."""

import numpy as np
import pytest

from pipeline.formats.joints.names import match_joints, signals_of


def n(form: str, joints: int = 2, first: int = 0) -> list[str]:
    return [form.format(j) for j in range(first, first + joints)]


UR = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
RTDE = [
    "timestamp",
    "actual_main_voltage",
    "actual_robot_current",
    "target_speed_fraction",
]
RTDE += ["actual_momentum", "actual_execution_time", "robot_mode"]
RTDE_SIX = "target_q target_qd target_qdd target_current target_moment actual_q actual_qd".split()
RTDE_SIX += [
    "actual_current",
    "actual_TCP_pose",
    "actual_TCP_force",
    "joint_temperatures",
]
RTDE += [label for name in RTDE_SIX for label in n(name + "_{}", 6)]
FRANKA = [
    "time",
    *(f"{s}[{j}]" for s in ("q", "dq", "q_d", "dq_d", "tau_J") for j in range(7)),
]
PLOTJUGGLER = [
    f"/joint_states/{j}_joint/{q}" for j in UR for q in ("position", "velocity")
]
CONTROLLER = [
    f"/arm_controller/state/{s}/positions[{j}]"
    for s in ("actual", "desired", "error")
    for j in (0, 1)
]


def both(actual: list[str], target: list[str]) -> dict[str, list[str]]:
    return {"actual": actual, "target": target}


LABELS = [
    (RTDE, both(n("actual_q_{}", 6), n("target_q_{}", 6))),
    (FRANKA, both(n("q[{}]", 7), n("q_d[{}]", 7))),
    (["t", "q_1", "q_0", "q_target_0", "q_target_1"], both(n("q_{}"), n("q_target_{}"))),
    ([*(f"actual_{j}" for j in UR), *(f"target_{j}" for j in UR), "actual_main_voltage"],
     both([f"actual_{j}" for j in UR], [f"target_{j}" for j in UR])),
    (PLOTJUGGLER, {"actual": PLOTJUGGLER[::2]}),
    (CONTROLLER, both(CONTROLLER[:2], CONTROLLER[2:4])),
    (n("field.position{}") + n("field.velocity{}"), {"actual": n("field.position{}")}),
    (n("AIPos_A{}", 6, 1) + n("ASPos_A{}", 6, 1), both(n("AIPos_A{}", 6, 1), n("ASPos_A{}", 6, 1))),
    (["q1_cmd", "q2_cmd", "q1_act", "q2_act"], both(["q1_act", "q2_act"], ["q1_cmd", "q2_cmd"])),
    (["t", "J1", "J2", "J1 Cmd", "J2 Cmd"], both(["J1", "J2"], ["J1 Cmd", "J2 Cmd"])),
    (["A1 [°]", "A2 [°]", "A1_soll [°]", "A2_soll [°]"],
     both(["A1 [°]", "A2 [°]"], ["A1_soll [°]", "A2_soll [°]"])),
    (["f_0", "f_1", "q_cmd_0", "q_cmd_1"], {"target": n("q_cmd_{}")}),
    (["temps (s)", "q1_mesuré", "q2_mesuré", "q1_consigne", "q2_consigne"],
     both(["q1_mesuré", "q2_mesuré"], ["q1_consigne", "q2_consigne"])),
    (["q(1) (deg)", "q(2) (deg)"], {"actual": ["q(1) (deg)", "q(2) (deg)"]}),
    (n("q_{}") + n("measured_{}") + n("target_{}"), {"target": n("target_{}")}),
    (["t", "q_0", "q_1", "qd_0", "qd_1"], {"actual": n("q_{}")}),
    (["actual_x", "actual_y", "actual_z", "actual_qw", "actual_qx"], {}),
    (n("actual_q_{}") + n("target_q_{}") + n("measured_tq_{}"),
     both(n("actual_q_{}"), n("target_q_{}"))),
    (n("joint_positions.{}") + n("joint_targets.{}"),
     both(n("joint_positions.{}"), n("joint_targets.{}"))),
    (n("samples.q_{}") + n("samples.q_target_{}"),
     both(n("samples.q_{}"), n("samples.q_target_{}"))),
    (["p_RS_R_x [m]", "q_RS_w []", "q_RS_x []", "q_RS_y []", "q_RS_z []"], {}),
    (["time", "cmd_num", "targetIndex", "fx", "fy", "fz"], {}),
    ([*(f"actual_{j}" for j in UR), *(f"target_{j}" for j in reversed(UR))],
     both([f"actual_{j}" for j in UR], [f"target_{j}" for j in UR])),
]  # fmt: skip


@pytest.mark.parametrize(("labels", "signals"), LABELS)
def test_labels_say_which_columns_are_a_signal(labels, signals):
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
    names, joints, meant
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
