"""Two records of one motion: the clock offset between them with an honest standard error; unit,
order, sign and clock of a command, found whatever the others do; uneven clocks of a log.
"""

import numpy as np
import pytest
from case_tables import cases_beside
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal

from pipeline.core.errors import RecordingError
from pipeline.formats.joints.log import JointLog, LogOptions
from pipeline.recordings import commands, movement
from pipeline.recordings.clocks import find_offset

cases = cases_beside(__file__)
OFFSET = 0.0837  # s
MIX = np.array([[0.8, 0.15], [-0.1, 1.1]])


def path(t: np.ndarray) -> np.ndarray:
    """A centroid (m) that goes 12 cm out and back between 0 and 3.2 s, symmetric in time."""
    phase = 2 * np.pi * np.clip(t / 3.2, 0, 1)
    p = (1 - np.cos(phase)) / 2
    x = 0.12 * p
    z = 0.05 * np.sin(np.pi * p) + 0.02 * p
    return np.stack([x, z], axis=-1)


def recording(
    noise: float = 0.0,
    seed: int = 0,
    offset: float = OFFSET,
) -> tuple[np.ndarray, ...]:
    """30 Hz frames with jittered stamps on their own clock, another point of the body; 100 Hz on
    the motion clock.
    """
    rng = default_rng(seed)
    t_b = np.arange(-30, 351) / 100
    t_a = np.arange(97) / 30 + rng.uniform(-0.004, 0.004, 97)

    noise_of_a = rng.normal(scale=noise, size=(97, 2))
    noise_of_b = rng.normal(scale=noise / 20, size=(len(t_b), 2))
    a = path(t_a + offset) @ MIX + [0.3, 0.5] + noise_of_a
    return t_a, a, t_b, path(t_b) + noise_of_b


def test_without_noise_the_offset_is_found_to_a_microsecond_on_any_clock():
    t_a, a, t_b, b = recording()
    result = find_offset(t_a, a, t_b, b)
    assert result.value == pytest.approx(OFFSET, abs=2e-6)
    assert result.correlation == pytest.approx(1.0, abs=1e-6)

    apart = find_offset(t_a + 40.0, a, t_b, b, search=(-40.5, -39.5))
    assert apart.value == pytest.approx(OFFSET - 40.0, abs=2e-6)


@pytest.mark.slow
def test_the_standard_errors_are_the_spread_of_the_estimates():
    offsets = [find_offset(*recording(0.002, seed)) for seed in range(120)]
    errors = np.array([offset.value for offset in offsets]) - OFFSET  # s, 2 mm of noise
    z = errors / [offset.standard_error for offset in offsets]

    # the standard deviation of 120 normal values is known to 6.5 %; the inflation by chance
    # correlation adds a few per cent
    assert 0.75 < z.std() < 1.2
    assert abs(z.mean()) < 4 / np.sqrt(120)
    assert errors.std() < 0.0024 and np.abs(errors).max() < 0.006

    # and the test would see a wrong clock: one frame of the motion capture
    late = find_offset(*recording(0.001, 0, OFFSET + 0.01))
    right = find_offset(*recording(0.001, 0, OFFSET))
    assert late.value - right.value == pytest.approx(0.01, abs=0.002)

    std_of_drift = np.std([offset.drift for offset in offsets])
    stated = np.mean([offset.drift_standard_error for offset in offsets])
    assert stated == pytest.approx(std_of_drift, rel=0.25)


@pytest.mark.parametrize("drift", [0.0, 0.01, -0.03])
def test_a_drift_is_found_beside_the_offset_and_none_where_there_is_none(drift):
    t_a, a, t_b, b = recording(0.001, 5)
    middle = t_a.mean()
    result = find_offset(middle + (t_a - middle) / (1 + drift), a, t_b, b)
    margin = 3 * result.drift_standard_error + 0.05 * abs(drift)

    assert abs(result.drift - drift) < margin
    assert result.value == pytest.approx(OFFSET, abs=0.006)


@cases("no offset")
def test_signals_that_tell_no_offset_are_refused_with_the_take(fault, search, words):
    t_a, a, t_b, b = recording(0.001)
    if fault == "at rest":
        a = np.zeros_like(a)
    elif fault == "only noise":
        a = default_rng(6).normal(size=a.shape)
    elif fault == "100 s later":
        t_a = t_a + 100
    elif fault == "backwards":
        t_a = t_a[::-1]

    with pytest.raises(RecordingError, match=words):
        find_offset(t_a, a, t_b, b, search=(-search, search), take="take-2")


RATE = 100.0
JOINTS = ("a", "b", "c", "d")
PAIR = {"rate": RATE, "limit": 0.05, "joints": JOINTS}


def logged(
    kind: str = "there and back",
    lag: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Measured and commanded angles (N, 4) in rad at 100 Hz: point to point with pauses, all joints
    together; or without rest, each joint on another path. The last joint does not move.
    """
    t = np.arange(1500) / RATE
    ways = KINDS[kind]
    middle = np.array([0.2, -1.0, 0.9, -0.4])
    noise = default_rng(1).normal(0, 1e-4, (len(t), 4))
    return middle + ways(t - lag) + noise, middle + ways(t)


def there_and_back(t: np.ndarray) -> np.ndarray:
    triangle = np.abs((t / 5 + 0.3) % 2 - 1)
    share = np.clip(triangle * 2 - 0.5, 0, 1)
    progress = (1 - np.cos(np.pi * share)) / 2
    return np.outer(progress, [1, -1.6, 0.3, 0])


def without_rest(t: np.ndarray) -> np.ndarray:
    first = np.sin(0.9 * t)
    second = np.cos(1.3 * t)
    third = 0.6 * np.sin(0.9 * t + 1)
    return np.stack([first, second, third, 0 * t], axis=1)


KINDS = {"there and back": there_and_back, "without rest": without_rest}


@pytest.mark.parametrize("kind", KINDS)
@cases("pairings")
def test_what_is_wrong_is_found_to_the_row_and_refused_with_its_option(
    kind,
    factor,
    order,
    delay,
):
    actual, target = commands.shift_rows(*logged(kind, lag=4e-3), -delay)
    # commanded angles from which factor and order recover the target
    wrong = np.empty_like(target)
    wrong[:, order] = target / factor

    pair = commands.find_pairing(actual, wrong, RATE)
    with pytest.raises(RecordingError, match="do not agree") as refused:
        commands.require_pair(actual, wrong, **PAIR, file="log")

    assert_allclose(pair.factor, factor)
    assert (pair.order.tolist(), pair.delay) == (order, delay)
    assert commands.tracking_errors(*pair.apply(actual, wrong)).max() < 0.02
    message = refused.value.message
    assert ("(target_factor: " in message) == (factor != [1, 1, 1, 1])
    assert ("(signals: " in message) == (order != [0, 1, 2, 3])
    assert ("(target_delay: " in message) == (delay != 0)
    assert refused.value.evidence["file"] == "log"


@pytest.mark.parametrize("kind", KINDS)
def test_a_controllers_lag_is_no_offset_of_two_clocks_where_the_unit_is_wrong_too(kind):
    for late in (0.6 * commands.LATEST, 1.6 * commands.LATEST):
        actual, target = logged(kind, lag=late)
        pair = commands.find_pairing(actual, np.degrees(target), RATE)
        assert_allclose(pair.factor, np.pi / 180)
        expected = round(late * RATE) if late > commands.LATEST else 0
        assert pair.delay == expected


def test_the_unit_of_joints_that_follow_is_found_beside_a_joint_that_stands():
    actual, target = logged("without rest", lag=4e-3)
    target[:, 3] += np.linspace(0.0, 0.5, len(target))

    pair = commands.find_pairing(actual, np.degrees(target), RATE)

    assert_allclose(pair.factor, np.pi / 180)
    assert pair.order.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_right_stays_as_it_is(kind):
    actual, target = logged(kind, lag=4e-3)
    commands.require_pair(actual, target, **PAIR)
    pairing = commands.find_pairing(actual, target, RATE)
    assert not [*commands.suspects(pairing, actual, target, RATE)]
    # up to the limit a lag is the controller's
    actual, target = logged(kind, lag=0.9 * commands.LATEST)
    commands.require_pair(actual, target, **PAIR)

    actual, target = logged(kind, lag=1.3 * commands.LATEST)
    words = r"s behind its command|target_delay: 0.0[67]"
    with pytest.raises(RecordingError, match=words):
        commands.require_pair(actual, target, **PAIR)


def test_another_movement_is_no_pair_and_a_few_pushes_do_not_decide():
    actual, _ = logged("without rest")
    _, target = logged("there and back")
    words = r"no other unit, order or clock: .* of one movement"
    with pytest.raises(RecordingError, match=words):
        commands.require_pair(actual, target, **PAIR)

    actual, target = logged()
    actual[700:760, 0] += 0.3
    commands.require_pair(actual, target, **PAIR)
    # the control: a joint that stands elsewhere than it is commanded to does
    actual[:, 3] += 0.2
    with pytest.raises(RecordingError, match="d misses its command by 1"):
        commands.require_pair(actual, target, **PAIR)


def test_an_error_is_a_share_of_the_motion_and_at_rest_of_a_tenth_of_a_radian():
    still = np.zeros((100, 1))
    assert commands.tracking_errors(still + 0.01, still) == pytest.approx([0.1])

    moved = np.linspace(0, 2, 100)[:, None]
    assert commands.tracking_errors(moved + 0.01, moved) == pytest.approx([0.01 / 2])


def jittered(
    samples: int = 400,
    jitter: float = 2e-4,
    sampled: bool = True,
) -> JointLog:
    """A log at 200 Hz whose times jitter; ``sampled``: the angles are those of these times."""
    even = np.arange(samples) * 0.005
    times = even + default_rng(1).normal(0, jitter, samples)
    t = (times if sampled else even)[:, None]
    return JointLog(times, {"actual": np.sin(2 * t + np.arange(3))}, {})


@pytest.mark.parametrize("sampled", [True, False])
def test_a_jittered_clock_is_asked_about_and_the_angles_say_which_it_is(
    tmp_path,
    sampled,
):
    log = jittered(sampled=sampled)
    np.savez(tmp_path / "log.npz", times=log.time, q=log.signals["actual"])
    files = {tmp_path / "log.npz": LogOptions(joints=3, signals={"actual": None})}
    words = r"rows are uneven; the jitter is 0.2[0-9]+ ms"
    with pytest.raises(RecordingError, match=words) as refused:
        movement.read_movement(files, 200.0)
    assert refused.value.evidence["key"] == "dataset.joint_log.clock"
    smoother = movement.smoothness_by_rows(log.time, log.signals["actual"], 200.0)
    assert smoother < 0.1 if sampled else smoother > 10

    by_rows, of_rows = movement.read_movement(files, 200.0, "rows")
    by_times, of_times = movement.read_movement(files, 200.0, "times")
    for counts in (of_rows, of_times):
        assert counts["clock_jitter"] == pytest.approx(2e-4 * np.sqrt(2), rel=0.1)
        assert 0 < counts["uneven_rows"] < 400
    assert of_rows.get("resampled_rows", 0) == 0
    assert of_times["resampled_rows"] == len(by_times["actual"])

    errors = [error_of(by_rows["actual"]), error_of(by_times["actual"], log.time[0])]
    right, wrong = errors[::-1] if sampled else errors
    # the jitter of 0.2 ms is up to 0.4 mrad a standard deviation at 2 rad/s
    assert right < 1e-7 and wrong > 4e-4


def error_of(angles: np.ndarray, start: float = 0.0) -> float:
    """Greatest error in rad of the angles at 200 Hz of :func:`jittered` from ``start`` in s on."""
    grid = start + np.arange(len(angles)) * 0.005
    return np.abs(angles - np.sin(np.add.outer(2 * grid, np.arange(3)))).max()


def test_a_late_clock_that_is_on_time_again_is_no_missing_row(tmp_path):
    late = 0.005 * np.arange(400)
    late[50::23] += 0.004  # s, of steps of 5 ms
    files = {tmp_path / "log.npz": LogOptions(joints=3, signals={"actual": None})}
    rows = jittered(400).signals["actual"]

    np.savez(tmp_path / "log.npz", times=np.delete(late, 60), q=rows[1:])
    with pytest.raises(RecordingError, match="are missing"):
        movement.read_movement(files, 200.0)

    np.savez(tmp_path / "log.npz", times=late, q=rows)
    with pytest.raises(RecordingError, match=r"of [0-9]+ rows are uneven"):
        movement.read_movement(files, 200.0)
    signals, _ = movement.read_movement(files, 200.0, "rows")
    assert_array_equal(signals["actual"], rows)
