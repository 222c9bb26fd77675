"""A wrong unit, order, sign or clock of the command is found whatever the others do."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import RecordingError
from pipeline.recordings import pairing
from pipeline.recordings.pairing import Pairing, delayed, missed, pairing_of, require_pair, suspects

RATE, JOINTS = 100.0, ("a", "b", "c", "d")
TURN = 180 / np.pi
HELD = {"rate": RATE, "limit": 0.05, "joints": JOINTS}


def logged(kind: str = "there and back", lag: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Measured and commanded angles (N, 4) in rad at 100 Hz: point to point with pauses, all joints
    in step; or without rest, each in its own way. The last joint stands still.
    """
    t = np.arange(1500) / RATE
    noise = np.random.default_rng(1).normal(0, 1e-4, (len(t), 4))

    def angles(t: np.ndarray) -> np.ndarray:
        if kind == "without rest":
            ways = [np.sin(0.9 * t), np.cos(1.3 * t), 0.6 * np.sin(0.9 * t + 1), 0 * t]
        else:
            share = np.clip(np.abs((t / 5 + 0.3) % 2 - 1) * 2 - 0.5, 0, 1)
            share = (1 - np.cos(np.pi * share)) / 2
            ways = [share, -1.6 * share, 0.3 * share, 0 * t]
        return np.stack(ways, axis=1) + np.array([0.2, -1.0, 0.9, -0.4])

    return angles(t - lag) + noise, angles(t)


KINDS = ("there and back", "without rest")
WRONG = {
    "unit": ([TURN] * 4, [0, 1, 2, 3], 0),
    "unit twice": ([TURN**2] * 4, [0, 1, 2, 3], 0),
    "order": ([1] * 4, [1, 0, 2, 3], 0),
    "sign": ([1, 1, -1, 1], [0, 1, 2, 3], 0),
    "clock": ([1] * 4, [0, 1, 2, 3], 140),
    "late clock": ([1] * 4, [0, 1, 2, 3], -60),
    "all": ([1 / TURN, -1 / TURN, 1 / TURN, 1 / TURN], [2, 0, 1, 3], 140),
}


def spoiled(target: np.ndarray, right: Pairing) -> np.ndarray:
    """The commanded angles that ``right`` makes those of the measured ones again."""
    wrong = np.empty_like(target)
    wrong[:, right.order] = target / right.factor
    return wrong


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_found_to_the_row_and_refused_with_its_option(kind, name):
    factor, order, delay = WRONG[name]
    right = Pairing(np.array(factor, float), np.array(order), delay)
    actual, target = delayed(*logged(kind, lag=4e-3), -delay)
    wrong = spoiled(target, right)
    pair = pairing_of(actual, wrong, RATE)
    np.testing.assert_allclose(pair.factor, right.factor)
    assert (pair.order.tolist(), pair.delay) == (order, delay)
    assert missed(*pair.apply(actual, wrong)).max() < 0.02
    with pytest.raises(RecordingError, match="are no pair") as refused:
        require_pair(actual, wrong, **HELD, file="log")
    for option, said in (
        ("target_factor", np.any(right.factor != 1)),
        ("signals", order != [0, 1, 2, 3]),
        ("target_delay", delay != 0),
    ):
        assert (f"({option}: " in refused.value.message) == said
    assert refused.value.evidence["file"] == "log"


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_right_stays_as_it_is(kind):
    actual, target = logged(kind, lag=4e-3)
    require_pair(actual, target, **HELD)
    assert not list(suspects(pairing_of(actual, target, RATE), actual, target, RATE))
    # up to the limit a lag is the controller's
    actual, target = logged(kind, lag=0.9 * pairing.LATEST)
    require_pair(actual, target, **HELD)
    actual, target = logged(kind, lag=1.3 * pairing.LATEST)
    with pytest.raises(RecordingError, match=r"s behind its command|target_delay: 0.0[67]"):
        require_pair(actual, target, **HELD)


def test_joints_with_the_same_command_are_not_taken_for_exchanged():
    actual, target = logged("without rest")
    actual[:, 1], target[:, 1] = actual[:, 0] + 1e-4, target[:, 0]
    pair = pairing_of(actual, target / TURN, RATE)
    assert pair.order.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(pair.factor, TURN)


def test_another_movement_is_no_pair_and_a_few_pushes_do_not_decide():
    actual, _ = logged("without rest")
    _, target = logged("there and back")
    with pytest.raises(RecordingError, match=r"no other unit, order or clock .* of one movement"):
        require_pair(actual, target, **HELD)
    actual, target = logged()
    actual[700:760, 0] += 0.3
    require_pair(actual, target, **HELD)
    # the control: a joint that stands elsewhere than it is commanded to does
    actual[:, 3] += 0.2
    with pytest.raises(RecordingError, match="d misses its command by 1"):
        require_pair(actual, target, **HELD)


def test_an_arm_that_never_moves_is_held_to_where_it_is_commanded():
    rest = np.full((50, 2), 0.3)
    require_pair(rest, rest, **HELD)
    # encoders have noise, a command that is read back creeps, and a static error is no lag
    rng = np.random.default_rng(2)
    noisy, creeping = (rest + rng.normal(0, 2e-5, rest.shape) for _ in range(2))
    require_pair(noisy + 1e-3, creeping, **HELD)
    assert not list(suspects(pairing_of(noisy, creeping, RATE), noisy, creeping, RATE))
    with pytest.raises(RecordingError, match="misses its command"):
        require_pair(rest, rest + 0.1, **HELD)
