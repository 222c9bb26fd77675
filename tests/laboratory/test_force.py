"""The force rig: stationary moments, correlation in time, what the transducer adds; and options of
the laboratory that describe nothing, refused with the key of their fault.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import i0e, i1e
from standard_errors import mean_scores
from synthetic_session import ARM, DYNAMICS

from pipeline.core.errors import ConfigError
from pipeline.laboratory.dynamics import open_session
from pipeline.laboratory.force import directions, record_force, slipping, wander
from pipeline.laboratory.options import Robots, TrajectoryOptions, Transducer

TENSION = np.array([9.0, 7.0, 8.0])
DIRECTION = np.array([0.15, 3.7, 1.6])


def pulled(tension, direction, elevation=None, attachment=None) -> SimpleNamespace:
    """The values of an arrangement of which the rig makes use."""
    values = {"tension": tension, "direction": direction}
    return SimpleNamespace(**values, elevation=elevation, attachment=attachment)


ENDS = [[0.1, 0.0, 0.01], [-0.05, 0.09, 0.0], [-0.05, -0.08, 0.02]]
CABLES = pulled(TENSION, DIRECTION)
IN_SPACE = pulled(TENSION, DIRECTION, [0.9, 1.1, 0.7], ENDS)
ROBOTS = Robots(tension_sd=(0.5, 1.2, 2.0), concentration=(2400.0, 600.0, 170.0))
SILENT = Transducer(noise=(0.0, 0.0), bias=(0.0, 0.0), drift=(0.0, 0.0))
PATHS = 6000  # independent robots, so that statistics across them have a known error


def across(values, truth) -> float:
    """Standardised deviation of the mean over independent robots from ``truth``."""
    return abs(mean_scores(values, truth))


def silent_record(cables):
    """Record of a transducer without noise, unloaded for 5 s."""
    return record_force(cables, ROBOTS, SILENT, 5.0, 20.0, default_rng(32))


@pytest.mark.parametrize("rate", [62.5, 2.0])
def test_slipping_has_the_moments_and_correlation_of_its_law_at_any_sampling_rate(rate):
    slip_rate = 20.0
    recovery = 0.25
    sd = 1.7
    robots = replace(ROBOTS, slip_rate=slip_rate, slip_recovery=recovery)
    paths = slipping(np.full(PATHS, sd), robots, 40, rate, default_rng(29)) / sd
    skewness = -2 / np.sqrt(slip_rate * recovery)
    correlation = np.exp(-1 / (rate * recovery))

    for path in paths[[0, 39]]:  # stationary from the first sample on
        assert across(path, 0.0) < 4.5
        assert across(path**2, 1.0) < 4.5
        assert across(path**3, skewness) < 4.5
    assert across(paths[20] * paths[21], correlation) < 4.5
    assert across(paths[39] ** 3, 0.0) > 9  # what a normal law would have


@pytest.mark.parametrize("rate", [62.5, 2.0])
def test_wander_is_a_stationary_ornstein_uhlenbeck_process_at_any_sampling_rate(rate):
    paths = wander(np.full(PATHS, 0.08), 0.4, 40, rate, default_rng(30)) / 0.08

    for path in paths[[0, 39]]:
        assert across(path, 0.0) < 4.5
        assert across(path**2, 1.0) < 4.5
    for lag in (1, 5):
        correlation = np.exp(-lag / (rate * 0.4))
        assert across(paths[10] * paths[10 + lag], correlation) < 4.5
    assert across(paths[0] ** 2, 0.9**2) > 6


def test_directions_spread_by_their_concentration_and_tensions_by_their_deviation():
    kappa = 6.0
    robots = 400
    many = Robots(tension_sd=(1.5,) * robots, concentration=(kappa,) * robots)
    cables = pulled(np.full(robots, 30.0), np.full(robots, 1.0))
    record = record_force(cables, many, SILENT, 0.0, 40.0, default_rng(31))
    along = record.direction @ [np.cos(1.0), np.sin(1.0), 0.0]
    squares = (record.tension - 30.0) ** 2

    assert across(along.mean(axis=0), i1e(kappa) / i0e(kappa)) < 4.5
    assert across(squares.mean(axis=0), 1.5**2) < 4.5
    # the small-angle law 1/κ
    assert across(along.mean(axis=0), np.exp(-1 / (2 * kappa))) > 9


@pytest.mark.parametrize(
    ("cables", "places"),
    [(CABLES, np.zeros(3)), (IN_SPACE, np.array(ENDS))],
    ids=["plane", "space"],
)
def test_a_silent_transducer_measures_the_cables_pulls_and_their_moments_about_the_origin(
    cables,
    places,
):
    record = silent_record(cables)
    unloaded = record.time < 5.0
    pulls = record.tension[..., None] * record.direction
    torque = np.cross(places + SILENT.lever, pulls).sum(axis=1)

    assert not record.force[unloaded].any()
    assert not record.torque[unloaded].any()
    assert_allclose(np.linalg.norm(record.direction, axis=-1), 1, rtol=1e-14)
    assert_allclose(record.force, pulls.sum(axis=1), atol=1e-12)
    assert_allclose(record.torque, torque, atol=1e-12)


def test_in_a_plane_nothing_pulls_out_of_it_and_cables_at_one_point_turn_otherwise():
    at_one_point = silent_record(pulled(TENSION, DIRECTION, IN_SPACE.elevation))
    apart = silent_record(IN_SPACE)

    assert not silent_record(CABLES).force[:, 2].any()
    assert_array_equal(at_one_point.force, apart.force)
    assert np.abs(at_one_point.torque - apart.torque).max() > 0.1


@pytest.mark.parametrize("kappa", [6.0, 300.0])
def test_directions_in_space_spread_by_their_concentration_alike_in_all_directions(
    kappa,
):
    azimuth = 0.4
    elevation = 0.8
    many = 600
    cables = pulled([1.0] * many, [azimuth] * many, [elevation] * many)
    options = {"tension_sd": (1.0,) * many, "concentration": (kappa,) * many}
    robots = Robots(**options, wander_time=0.4)
    e = directions(cables, robots, 60, 2.0, default_rng(41))

    level = np.cos(elevation)
    mean = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
    sideways = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    upwards = np.cross(mean, sideways)
    along = (e @ mean).mean(axis=0)
    squares = []
    for axis in (sideways, upwards):
        assert across((e @ axis).mean(axis=0), 0.0) < 4.5
        squares.append(((e @ axis) ** 2).mean(axis=0))

    assert across(squares[0] - squares[1], 0.0) < 4.5
    assert across(along, 1 / np.tanh(kappa) - 1 / kappa) < 4.5
    # the control: in a plane of the same concentration cables keep nearer to their mean
    assert across(along, i1e(kappa) / i0e(kappa)) > 9


@pytest.mark.parametrize("channel", ["force", "torque"])
def test_the_transducer_adds_the_stated_noise_bias_and_drift(channel):
    transducer = Transducer(noise=(0.02, 0.001), bias=(0.4, 0.01), drift=(1e-3, 1e-4))
    records = []
    for rng in default_rng(34).spawn(300):
        records.append(record_force(CABLES, ROBOTS, transducer, 30.0, 0.1, rng))
    time = records[0].time
    unloaded = time < 30.0
    readings = np.stack([getattr(record, channel)[unloaded] for record in records], 1)

    slope, start = np.polyfit(time[unloaded], readings.reshape(len(readings), -1), 1)
    noise = np.diff(readings, axis=0).std() / np.sqrt(2)

    number = ["force", "torque"].index(channel)
    assert across(start**2, transducer.bias[number] ** 2) < 4.5
    assert across(slope**2, transducer.drift[number] ** 2) < 4.5
    assert noise == pytest.approx(transducer.noise[number], rel=0.01)


def test_a_cable_never_pushes(rng):
    cables = pulled([2.0, 7.0, 2.0], DIRECTION)
    record = record_force(cables, ROBOTS, SILENT, 0.0, 60.0, rng)
    assert record.tension.min() == 0.0


def test_the_disturbances_of_another_arm_are_refused(rng):
    two_joints = replace(DYNAMICS, sway_std=(1e-3, 1e-3))
    with pytest.raises(ConfigError, match=r"sway_std .*laboratory\.dynamics"):
        open_session(ARM.chain, two_joints, rng)


def test_cables_of_fewer_robots_are_refused(rng):
    two_cables = pulled(TENSION[:2], DIRECTION)
    with pytest.raises(ConfigError, match="3 robots and 2 cables"):
        record_force(two_cables, ROBOTS, Transducer(), 1.0, 1.0, rng)


MOTION = TrajectoryOptions(folded=(0.0, 0.0), extended=(0.5, 0.5))
REFUSALS = [  # options, a change that makes no sense, the key of the fault
    (MOTION, {"folded": (0.0,)}, "extended"),
    (MOTION, {"rest": 0.6}, "duration"),
    (ROBOTS, {"concentration": (100.0,)}, "concentration"),
]


@pytest.mark.parametrize(("options", "change", "key"), REFUSALS)
def test_options_without_a_meaning_are_refused_by_their_key(options, change, key):
    with pytest.raises(ConfigError) as refused:
        replace(options, **change)
    assert refused.value.evidence["key"] == key
