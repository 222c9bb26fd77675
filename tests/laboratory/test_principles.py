"""The table of pipeline/laboratory/README.md states what the laboratory does, within limits."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from pipeline.core.config import CONF
from pipeline.core.typed_yaml import read_yaml
from pipeline.laboratory.dynamics import expose, simulate_take
from pipeline.laboratory.swing import desired_joints, desired_trajectory
from pipeline.models.model import frobenius
from pipeline.models.noise import mean_covariance, process_noise
from pipeline.recordings.commands import commanded_steps
from pipeline.studies.which_decomposition.evidence import published
from pipeline.verdicts.claims import parse_claims

ROOT = CONF.parents[1]
TAKES = 60
ROBOT = read_yaml(CONF / "dataset/youbot.yaml")["robot"]
TEXT = (ROOT / "pipeline/laboratory/README.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in TEXT.splitlines()
    if re.match(r"\| (?!quantity|-)", line)
]
STATED = {row[0]: row for row in ROWS}


def moved(arm, motion, dynamics) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses (TAKES, M + 1, n) at the motion's steps; times (N,) and poses (TAKES, N, n) of the
    servo's.
    """
    rng = np.random.default_rng(5)
    grid = np.arange(round(motion.duration * motion.rate) + 1) / motion.rate
    poses, paths = [], []
    for _ in range(TAKES):
        t, q, _ = simulate_take(arm.chain, np.zeros(3), motion, dynamics, rng)
        poses.append(expose(t, q, grid, dynamics, rng))
        paths.append(q)
    return np.array(poses), t, np.array(paths)


def noise_numbers(arm, motion, dynamics, wanted: np.ndarray) -> dict[str, float]:
    """Correlations and sizes of ω, the share of joint 3 that the others leave, and what is left of
    a deviation a frame of a depth camera later.
    """
    q, _, _ = moved(arm, motion, dynamics)
    v = commanded_steps(desired_trajectory(arm.chain, motion), motion.rate)
    covariance = mean_covariance(process_noise(arm.chain, q, v))
    std = np.sqrt(np.diag(covariance))
    numbers = {f"standard deviation {j + 1} of ω": std[j] for j in range(3)}
    for i, j in ((0, 1), (0, 2), (1, 2)):
        numbers[f"correlation {i + 1}{j + 1} of ω"] = covariance[i, j] / std[i] / std[j]
    last = covariance[:-1, -1]
    left = covariance[-1, -1] - last @ np.linalg.solve(covariance[:-1, :-1], last)
    numbers["variance of joint 3 that the others leave, over the published one"] = (
        left / wanted[-1, -1]
    )
    deviation = q - q.mean(axis=0)
    later = np.mean(deviation[:, 3:] * deviation[:, :-3], axis=(0, 1))
    for j, value in enumerate(later / np.mean(deviation**2, axis=(0, 1)), start=1):
        numbers[f"correlation of the deviation of joint {j} after 30 ms"] = value
    return numbers


def torque_numbers(arm, motion, dynamics) -> dict[str, float]:
    """Mean torque and one standard deviation at full speed, in N·m; the clearance apart, in which
    no motor moves the link.
    """
    _, t, q = moved(arm, motion, replace(dynamics, clearance=0.0))
    speed = np.gradient(q, t[1] - t[0], axis=1)
    acceleration = np.gradient(speed, t[1] - t[0], axis=1)
    pace = np.linalg.norm(desired_joints(np.clip(t, 0.0, motion.duration), motion)[1], axis=1)
    full = np.flatnonzero(pace > 0.99 * pace.max())[::20]
    whole = pin.buildModelFromUrdf(str(ROOT / ROBOT["urdf"]))
    held, step = [], np.zeros(whole.nv)
    for name in whole.names[1:]:
        number = whole.getJointId(name)
        if name not in ROBOT["joints"]:
            held.append(number)
            step[whole.joints[number].idx_v] = ROBOT["locked"].get(name, 0.0)
    model = pin.buildReducedModel(whole, held, pin.integrate(whole, pin.neutral(whole), step))
    data = model.createData()
    states = np.stack([q, speed, acceleration])[:, :, full].reshape(3, -1, 3)
    torques = np.array([pin.rnea(model, data, *state) for state in states.swapaxes(0, 1)])
    torques = torques.reshape(TAKES, -1, 3)
    needed = (np.abs(torques.mean(axis=0)) + torques.std(axis=0)).mean(axis=0)
    return {f"torque of joint {j} at full speed": value for j, value in enumerate(needed, start=1)}


def path_numbers(arm, motion) -> dict[str, float]:
    """Peak speed in rad/s, greatest ‖J⁻¹‖_F and share of the steps at rest."""
    start, end = np.array(motion.folded), np.array(motion.extended)
    moving = motion.duration / 2 - 2 * motion.rest - motion.ramp
    q = start + np.linspace(0, 1, 101)[:, None] * (end - start)
    return {
        "peak speed of the joints": np.abs(end - start).max() / moving,
        "greatest norm of the inverse Jacobian": frobenius(arm.chain.inverse_jacobian(q)).max(),
        "share of the steps at rest": 4 * motion.rest / motion.duration,
    }


@pytest.fixture(scope="module")
def numbers(arm, trajectory, dynamics) -> dict[str, float]:
    """Every number of the table, computed."""
    claims = read_yaml(ROOT / "reports/claims.yaml")["claims"]
    stated = published(parse_claims(claims))
    return (
        path_numbers(arm, trajectory)
        | noise_numbers(arm, trajectory, dynamics, stated.covariance)
        | torque_numbers(arm, trajectory, dynamics)
    )


def test_the_table_states_the_numbers_of_the_laboratory(numbers):
    assert set(numbers) == set(STATED)
    for name, value in numbers.items():
        # standard error of a variance over 60 correlated takes: about 5 %
        assert value == pytest.approx(float(STATED[name][2]), rel=0.08, abs=0.01), name


def test_every_number_is_within_its_limit(numbers):
    for name, (_, _, _, limit, rule) in STATED.items():
        if rule == "at most":
            assert numbers[name] <= 1.02 * float(limit), name
        elif rule == "within 0.1":
            assert abs(numbers[name] - float(limit)) <= 0.1, name
        elif rule == "factor 1.5":
            assert abs(np.log(numbers[name] / float(limit))) <= np.log(1.5), name
        else:
            assert (limit, rule) == ("–", "free"), name
    rules = [row[-1] for row in ROWS]
    assert (rules.count("at most"), rules.count("within 0.1"), rules.count("factor 1.5")) == (
        6,
        3,
        3,
    )
