"""Clock offset between two instruments: recovery, precision, an honest standard error, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arm.chain import PlanarChain
from pipeline.core.errors import RecordingError
from pipeline.recordings.clocks import find_offset

OFFSET = 0.0837  # s
MIX = np.array([[0.8, 0.15], [-0.1, 1.1]])


def phase(t: np.ndarray) -> np.ndarray:
    """Out and back between 0 and 3.2 s, at rest before and after."""
    return (1 - np.cos(2 * np.pi * np.clip(t / 3.2, 0, 1))) / 2


def path(t: np.ndarray) -> np.ndarray:
    """A centroid (m) that goes 12 cm out and back, symmetric in time."""
    p = phase(t)
    return np.stack([0.12 * p, 0.05 * np.sin(np.pi * p) + 0.02 * p], axis=-1)


def recording(noise: float = 0.0, seed: int = 0, offset: float = OFFSET) -> tuple[np.ndarray, ...]:
    """30 Hz frames with jittered stamps on their own clock, another point of the body; 100 Hz on
    the motion clock.
    """
    rng = np.random.default_rng(seed)
    t_b = np.arange(-30, 351) / 100
    t_a = np.arange(97) / 30 + rng.uniform(-0.004, 0.004, 97)
    a = path(t_a + offset) @ MIX + [0.3, 0.5] + rng.normal(scale=noise, size=(97, 2))
    return t_a, a, t_b, path(t_b) + rng.normal(scale=noise / 20, size=(len(t_b), 2))


def test_without_noise_the_offset_is_found_to_a_microsecond_on_any_clock():
    t_a, a, t_b, b = recording()
    result = find_offset(t_a, a, t_b, b)
    assert result.value == pytest.approx(OFFSET, abs=2e-6)
    assert result.correlation == pytest.approx(1.0, abs=1e-6)
    # clocks that do not start at 0, as of a camera that counts from 1970
    later = find_offset(t_a + 1e5, a, t_b + 1e5, b)
    assert later.value == pytest.approx(OFFSET, abs=2e-6)
    apart = find_offset(t_a + 40.0, a, t_b, b, search=(-40.5, -39.5))
    assert apart.value == pytest.approx(OFFSET - 40.0, abs=2e-6)


@pytest.mark.slow
def test_with_a_millimetre_of_noise_the_error_is_below_three_milliseconds():
    errors = np.array([find_offset(*recording(0.001, seed)).value - OFFSET for seed in range(60)])
    assert errors.std() < 0.0012
    assert np.abs(errors).max() < 0.003
    # and the test would see a wrong clock: one frame of the motion capture
    late, right = (find_offset(*recording(0.001, 0, OFFSET + way)).value for way in (0.01, 0.0))
    assert late - right == pytest.approx(0.01, abs=0.002)


def test_the_centroid_of_an_unevenly_seen_arm_gives_the_offset_from_its_joint_angles():
    links = np.array([0.155, 0.135, 0.17])
    limits = np.full(3, -3.0), np.full(3, 3.0), np.full(3, 1.6)
    chain = PlanarChain(np.zeros(2), np.stack([0 * links, links], axis=1), np.ones(3), *limits)
    rng, t_a, t_b = np.random.default_rng(8), np.arange(95) / 30, np.arange(321) / 100

    def nodes_at(t: np.ndarray) -> np.ndarray:
        turns = phase(t)[:, None] * np.array([75.0, -70.0, 75.0])
        return chain.points(np.radians(np.array([-55.0, 135.0, -60.0]) + turns))

    observed = []
    for nodes in nodes_at(t_a + 0.031):
        share = rng.beta(1.5, 1.0, size=(3, 500, 1))
        across = rng.beta(1.0, 1.4, size=(3, 500, 1)) - 0.5
        steps = np.diff(nodes, axis=0)[:, None]
        side = steps[..., ::-1] * [1, -1] / links[:, None, None]
        observed.append((nodes[:3, None] + share * steps + 0.06 * across * side).mean(axis=(0, 1)))
    nodes = nodes_at(t_b)
    expected = np.einsum("tjx,j->tx", (nodes[:, 1:] + nodes[:, :-1]) / 2, links / links.sum())
    result = find_offset(t_a, np.array(observed), t_b, expected)
    assert result.value == pytest.approx(0.031, abs=0.003)
    assert result.standard_error < 0.0015


@pytest.mark.slow
def test_the_standard_errors_are_the_spread_of_the_estimates():
    result = [find_offset(*recording(0.002, seed)) for seed in range(120)]
    z = np.array([(f.value - OFFSET) / f.standard_error for f in result])
    # the standard deviation of 120 normal values is known to 6.5 %; the inflation by chance
    # correlation adds a few per cent
    assert 0.75 < z.std() < 1.2
    assert abs(z.mean()) < 4 / np.sqrt(120)
    spread, stated = np.std([f.drift for f in result]), [f.drift_standard_error for f in result]
    assert np.mean(stated) == pytest.approx(spread, rel=0.25)


@pytest.mark.parametrize("drift", [0.0, 0.01, -0.03])
def test_a_drift_is_found_beside_the_offset_and_none_where_there_is_none(drift):
    t_a, a, t_b, b = recording(0.001, 5)
    middle = t_a.mean()
    result = find_offset(middle + (t_a - middle) / (1 + drift), a, t_b, b)
    assert abs(result.drift - drift) < 3 * result.drift_standard_error + 0.05 * abs(drift)
    assert result.value == pytest.approx(OFFSET, abs=0.006)


def test_correlated_residuals_widen_the_standard_error():
    t_a, a, t_b, b = recording()
    white = np.random.default_rng(5).normal(scale=0.002, size=a.shape)
    slow = np.zeros_like(white)
    for i in range(1, len(slow)):
        slow[i] = 0.7 * slow[i - 1] + np.sqrt(1 - 0.49) * white[i]
    wide, narrow = (find_offset(t_a, a + each, t_b, b).standard_error for each in (slow, white))
    assert wide > 1.5 * narrow


def test_any_affine_image_of_the_body_any_component_and_gaps_give_the_offset():
    t_a, a, t_b, b = recording(0.002, 3)
    one = find_offset(t_a, a, t_b, b)
    other = find_offset(t_a, 1000 * a + 7, t_b, b @ np.array([[0.0, 2.0], [-1.0, 0.5]]) - 4)
    assert other.value == pytest.approx(one.value, abs=1e-6)
    t_a, a, t_b, b = recording(0.001, 4)
    a[10:14] = np.nan
    assert find_offset(t_a, a[:, 0], t_b, b[:, 0]).value == pytest.approx(OFFSET, abs=0.003)


@pytest.mark.parametrize(
    ("spoil", "search", "words"),
    [
        (lambda t, a: (t, np.zeros_like(a)), 0.5, r"no motion.*take-2"),
        (lambda t, a: (t, np.random.default_rng(6).normal(size=a.shape)), 0.5, "not alike|edge"),
        (lambda t, a: (t, a), 0.05, "edge"),
        (lambda t, a: (t + 100, a), 0.5, "overlap"),
        (lambda t, a: (t[::-1], a), 0.5, "increase"),
    ],
)
def test_signals_that_tell_no_offset_are_refused_with_the_take(spoil, search, words):
    t_a, a, t_b, b = recording(0.001)
    with pytest.raises(RecordingError, match=words):
        find_offset(*spoil(t_a, a), t_b, b, search=(-search, search), take="take-2")
