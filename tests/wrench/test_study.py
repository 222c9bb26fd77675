"""The numerical study: systems that fill their bounds, the expectation of Σ_S against direct
integration and averages, standard errors, errors of fresh systems, and what the paper claims about
numbers of cables.
"""

from dataclasses import replace

import numpy as np
import pytest
from cable_systems import planar_cables
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.integrate import dblquad
from scipy.stats import kstest
from standard_errors import largest_score

from pipeline.core.errors import ConfigError
from pipeline.core.options.analysis import Wrench
from pipeline.core.options.dataset import Arrangement, Force
from pipeline.wrench.models import (
    FORMS,
    Bounds,
    configuration_bounds,
    draw_systems,
    nominal_system,
    unbounded_sigma_s,
    wrench_covariance,
)
from pipeline.wrench.study import (
    averaged_sigma_s,
    covariance_errors,
    expected_sigma_s,
    expected_unbounded_sigma_s,
    run_study,
    variance_errors,
)

RANGES = {"tension": (3.0, 5.0), "direction": (np.pi / 4, np.pi)}
RANGES |= {"tension_sd": (0.5, 1.0), "concentration": (100.0, 800.0)}
STUDY = Bounds(**RANGES)
TILTED = Bounds(**RANGES, elevation=(0.2, 1.3), attachment=(-0.3, 0.5))


def characteristics(system):
    """Return the values that bounds name, by name; angles from the directions."""
    e = system.direction
    values = {name: value for name, value in vars(system).items() if value is not None}
    values["direction"] = np.arctan2(e[..., 1], e[..., 0])
    if system.dimension == 3:
        values["elevation"] = np.arcsin(e[..., 2])
    return values


@pytest.mark.parametrize(
    "bounds",
    [STUDY, replace(STUDY, attachment=(0.1, 0.2)), TILTED],
)
def test_systems_stay_within_their_bounds_and_fill_them(bounds):
    system = draw_systems(bounds, 4000, 3, default_rng(12))
    assert system.direction.shape == (4000, 3, bounds.dimension)

    drawn = characteristics(system)
    stated = {name: ends for name, ends in vars(bounds).items() if ends is not None}
    assert drawn.keys() == stated.keys()

    for name, (low, high) in stated.items():
        margin = 0.01 * (high - low)
        least = drawn[name].min()
        greatest = drawn[name].max()
        assert low - 1e-12 <= least < low + margin
        assert high + 1e-12 >= greatest > high - margin


def test_directions_in_space_are_uniform_on_the_sphere_and_not_in_elevation():
    system = draw_systems(TILTED, 4000, 3, default_rng(12))
    elevation = characteristics(system)["elevation"].ravel()
    low, high = TILTED.elevation

    heights = (np.sin(elevation) - np.sin(low)) / (np.sin(high) - np.sin(low))
    angles = (elevation - low) / (high - low)

    assert kstest(heights, "uniform").pvalue > 1e-3
    assert kstest(angles, "uniform").pvalue < 1e-6  # control


@pytest.mark.parametrize(
    "change",
    [
        {"tension": (5.0, 3.0)},
        {"concentration": (0.0, np.inf)},
        {"elevation": (0.0, 2.0)},
    ],
)
def test_bounds_that_bound_no_system_are_refused(change):
    with pytest.raises(ConfigError):
        Bounds(**(RANGES | change))


PLANAR = {"file": "a.csv", "direction": [0.1, 2.0], "tension": [5.0, 4.0]}
PLANAR |= {"direction_bounds": [0.0, 3.0]}
SPATIAL = PLANAR | {"elevation": [0.3, -0.4], "elevation_bounds": [-0.5, 0.5]}
SPATIAL |= {
    "attachment": [[0.1, 0.0, 0.02], [-0.1, 0.0, 0.02]],
    "attachment_bounds": [-0.1, 0.1],
}


def force(configuration: Arrangement, **changes) -> Force:
    bounds = {"kappa_bounds": [400.0, 900.0], "tension_std_bounds": [0.4, 0.8]}
    bounds |= {"tension_bounds": [3.0, 6.0], "configurations": {"C1": configuration}}
    return Force(tare=1.0, tension_std=[0.5, 0.6, 0.7], **bounds, **changes)


def test_a_configuration_in_space_has_elevations_and_attachments_over_the_length():
    configuration = Arrangement(**SPATIAL)
    options = force(configuration, length=0.2)

    system = nominal_system(options, configuration)
    bounds = configuration_bounds(options, configuration)

    x, y, z = system.direction.T
    assert_allclose(np.hypot(np.hypot(x, y), z), 1)
    assert_allclose(np.arcsin(z), SPATIAL["elevation"])
    assert_allclose(np.arctan2(y, x), SPATIAL["direction"])
    assert_allclose(0.2 * system.attachment, SPATIAL["attachment"])
    assert bounds.elevation == [-0.5, 0.5]
    assert_allclose(bounds.attachment, [-0.5, 0.5])


def test_a_configuration_in_the_plane_has_neither():
    configuration = Arrangement(**PLANAR)
    options = force(configuration)

    system = nominal_system(options, configuration)
    bounds = configuration_bounds(options, configuration)

    x, y = system.direction.T
    assert_allclose(np.arctan2(y, x), PLANAR["direction"])
    assert system.tension_sd.tolist() == [0.5, 0.6]
    assert system.attachment is None
    assert (bounds.dimension, bounds.attachment) == (2, None)


def test_more_cables_than_robots_and_a_length_that_is_none_are_refused():
    four = {name: PLANAR[name] * 2 for name in ("direction", "tension")}
    configuration = Arrangement(**(PLANAR | four))
    with pytest.raises(ConfigError, match="3 values for the 4 robots"):
        nominal_system(force(configuration), configuration)
    with pytest.raises(ConfigError, match=r"length: .* greater than 0, got 0\.0"):
        force(configuration, length=0.0)
    with pytest.raises(ConfigError, match="point"):
        force(configuration, point=[0.0, 0.0])


# the bound Σ_S ≥ 0 holds often within the first, and hardly ever with many cables within the second
WIDE = Bounds((1.5, 6.0), (0.1, 0.7), (0.5, 2.3), (100.0, 400.0))
ROUND = Bounds((5.0, 9.0), (0.3, 2.8), (0.5, 2.0), (100.0, 800.0))
DISTINCT = ((0, 0), (0, 1), (1, 1))
APART = replace(WIDE, attachment=(-0.2, 0.5))
SPACE = replace(ROUND, elevation=(0.2, 1.2), attachment=(-0.2, 0.5))


def z_scores(estimate, expected):
    """Deviation of the average from the expectation in standard errors of both, for the entries
    that vary.
    """
    error = np.hypot(estimate.standard_error, expected.standard_error)
    deviation = estimate.mean - expected.mean
    assert np.all(deviation[error == 0] == 0)
    return deviation[error > 0] / error[error > 0]


def test_for_one_cable_it_is_the_integral_over_tension_and_its_deviation():
    bounds = Bounds(WIDE.tension, (0.6, 0.6), WIDE.tension_sd, (150.0, 150.0))
    expected = expected_unbounded_sigma_s(bounds, 1)
    area = np.ptp(bounds.tension) * np.ptp(bounds.tension_sd)
    for i, j in DISTINCT:

        def entry(sd, tension, i=i, j=j):
            values = [np.array([value]) for value in (tension, 0.6, sd, 150.0)]
            return unbounded_sigma_s(planar_cables(*values))[i, j]

        ends = *bounds.tension, *bounds.tension_sd
        integral, _ = dblquad(entry, *ends, epsabs=1e-10)
        assert expected[i, j] == pytest.approx(integral / area, abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bounds", "agents"),
    [(WIDE, 1), (WIDE, 3), (ROUND, 1), (ROUND, 8), (APART, 3), (SPACE, 3), (SPACE, 30)],
)
def test_without_the_bound_it_is_what_averages_over_systems_tend_to(bounds, agents):
    systems = draw_systems(bounds, 20_000, agents, default_rng(45))
    expected = expected_unbounded_sigma_s(bounds, agents)
    assert largest_score(unbounded_sigma_s(systems), expected) < 4


@pytest.mark.parametrize("agents", [1, 3])
@pytest.mark.parametrize("form", FORMS)
def test_with_its_own_bounds_alone_it_is_what_averages_over_systems_tend_to(
    form,
    agents,
):
    systems = draw_systems(WIDE, 40_000, agents, default_rng(46))
    estimate = averaged_sigma_s(systems)[form]
    expected = expected_sigma_s(WIDE, agents, default_rng(47))[form]
    error = np.diag(estimate.standard_error)

    assert estimate.clipped > 1000
    assert np.abs(z_scores(estimate, expected)).max() < 4
    # the standard error tends to the deviation of single systems over √systems
    deviations = error * np.sqrt(estimate.systems)
    assert_allclose(deviations, np.diag(expected.deviation), rtol=0.05)

    # controls: without the bound, and of wider directions
    unbounded = expected_unbounded_sigma_s(WIDE, agents)
    wider = replace(WIDE, direction=(0.1, 0.8))
    of_wider = expected_sigma_s(wider, agents, default_rng(48))[form].mean
    assert np.max(np.diag(estimate.mean - unbounded) / error) > 8
    assert np.max(np.abs(np.diag(estimate.mean - of_wider)) / error) > 8


def study_options(agents: list[int], repeats: int) -> Wrench:
    ranges = STUDY.concentration, STUDY.tension_sd, STUDY.tension, STUDY.direction
    return Wrench(agents, *map(list, ranges), 1000, 2000, repeats, 1)


def test_errors_are_relative_to_the_parametric_model():
    whole = np.array([[3.0, 1.0], [1.0, 4.0]])
    assert variance_errors(2 * whole, whole) == 1
    assert covariance_errors(2 * whole, whole) == 1


def test_off_diagonal_terms_lower_the_error_of_the_covariance_and_less_so_with_few_cables():
    _, errors, _ = run_study(study_options([3, 20], 1), default_rng(42))
    diagonal = errors["covariance_error_diagonal"]
    gain = diagonal - errors["covariance_error_full"]
    of_agents = gain.groupby(errors["agents"])

    assert (of_agents.mean() > 4 * of_agents.sem()).all()

    relative = of_agents.mean() / diagonal.groupby(errors["agents"]).mean()
    assert relative[20] > 2 * relative[3]


def test_without_the_random_matrix_the_error_is_larger_and_hardly_falls():
    _, _, spread = run_study(study_options([3, 20], 3), default_rng(42))

    means = spread.groupby("agents")[["mean", "mean_without_matrix"]].mean()

    assert_allclose(means["mean"], [0.041, 0.0165], rtol=0.05)
    assert_allclose(means["mean_without_matrix"], [0.083, 0.078], rtol=0.03)


@pytest.mark.slow
def test_the_error_falls_with_the_number_of_cables_in_every_repeat():
    rng = default_rng(14)
    agents = np.array([3, 5, 10, 15, 20])
    _, _, spread = run_study(study_options(agents.tolist(), 5), rng)
    means = spread.pivot(index="repeat", columns="agents", values="mean").to_numpy()
    alike = []  # errors of one covariance for every system
    for m in agents:
        systems, fresh = (
            wrench_covariance(draw_systems(STUDY, 2000, m, rng)) for _ in "ab"
        )
        alike.append(variance_errors(fresh.mean(axis=0), systems).mean())

    assert (np.diff(means, axis=1) < 0).all()
    # and with the root of their number, as the error of one covariance for every system does
    for errors in (means.mean(axis=0), np.array(alike)):
        scaled = errors * np.sqrt(agents)
        assert np.ptp(scaled) < 0.1 * np.mean(scaled)
