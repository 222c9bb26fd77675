"""Signals, joints and commands by the names of columns, and by their values."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import cases_beside

from pipeline.core.typed_yaml import read_yaml
from pipeline.formats.joints.names import match_joints, signals_of

cases = cases_beside(__file__)
LABELS = read_yaml(Path(__file__).with_name("labels.yaml"))


@pytest.mark.parametrize("name", LABELS)
def test_labels_say_which_columns_are_a_signal(name):
    signals = dict(LABELS[name])
    labels = signals.pop("labels")
    assert signals_of(labels) == (signals, {})


@cases("ordered")
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


def signals_in(**groups: np.ndarray):
    """Signals, and those that are guessed, of columns named after groups (N, n) of values."""
    columns = {}
    for name, values in groups.items():
        columns |= {f"{name}_{j}": column for j, column in enumerate(values.T)}
    return signals_of([*columns], TIME, columns.__getitem__)


@pytest.mark.parametrize("unit", [1.0, 180 / np.pi, 1e-3])
def test_qd_is_a_speed_where_it_is_the_derivative_of_q_in_whatever_unit(unit):
    speed = unit * SPEED
    signals, guessed = signals_in(q=Q + NOISE, qd=speed + NOISE)
    assert [*signals] == ["actual"] and not guessed

    # beside it the commanded angles are found by their name, or by their values as a guess
    signals, guessed = signals_in(q=Q + NOISE, qd=speed, tq=Q)
    assert signals["target"] == ["tq_0", "tq_1"] and "target" not in guessed

    signals, guessed = signals_in(q=Q + NOISE, qd=speed, other=Q)
    assert signals["target"] == ["other_0", "other_1"] and "target" in guessed


def test_qd_is_the_command_where_it_follows_q_and_a_guess_where_it_is_only_no_speed():
    signals, guessed = signals_in(q=Q + NOISE, qd=Q)
    assert signals == {"actual": ["q_0", "q_1"], "target": ["qd_0", "qd_1"]}
    assert not guessed

    signals, guessed = signals_in(q=Q + NOISE, qd=57.3 * Q)
    assert signals["target"] == ["qd_0", "qd_1"] and "no speed" in guessed["target"]

    # nothing moves: the name decides
    signals, _ = signals_in(q=0 * Q, qd=0 * Q)
    assert "target" not in signals


def test_four_columns_of_length_one_are_a_quaternion():
    still = 0 * TIME
    turned = np.stack([np.cos(TIME), np.sin(TIME), still, still], axis=1)
    assert signals_in(q=turned) == ({}, {})

    # the control: another length
    signals, _ = signals_in(q=1.1 * turned)
    assert [*signals] == ["actual"]
