"""Estimators on takes drawn from known models with measurement noise: they return the parameters on
arms of any number of joints and task rows, and others for another model. Standard errors by the
bootstrap over takes are the standard deviation over independent recordings.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from drawn_recording import drawn_recording
from numpy.random import default_rng
from random_arm import motion, random_arm

from pipeline.core.errors import ModelDomainError
from pipeline.models import kinds
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.bootstrap import replicate, spreads
from pipeline.models.gaussian.fit import Options as Gaussian
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kinds import build_model, estimate
from pipeline.models.model import frobenius
from pipeline.models.steps import Recorded, mean_covariance
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.fit import Options as Wishart
from pipeline.models.wishart.fit import diagnose, problem_steps, solve_problems
from pipeline.models.wishart.law import WishartModel
from pipeline.models.wishart.perturbation import objective_weights
from pipeline.randommatrix.wishart import normalized_std
from pipeline.studies.recovery.stage import draw_data

MEASUREMENT = np.diag([0.6, 1.5, 1.7]) * 1e-6
TAKES = 60
REST = 20


@pytest.fixture
def record(chain, poses, step) -> Callable[..., Recorded]:
    """``record(model, takes, speed, measured)``: takes of a rest and of a motion through ``poses``
    by ``speed`` times ``step``, each step drawn from the ``model``.
    """

    def recorded(model, takes=TAKES, speed=1.0, measured=MEASUREMENT) -> Recorded:
        v = np.concatenate([np.zeros((REST, 3)), np.tile(speed * step, (40, 1))])
        data = drawn_recording(chain, poses[: len(v)], v, measured, model, takes)
        return replace(data, known_measurement=None)

    return recorded


def wishart(estimator: str, name: str = "pivoted_lu", **options) -> Wishart:
    return Wishart("wishart", estimator=estimator, decomposition=name, **options)


def total_variance(model, data: Recorded) -> float:
    """Mean trace of the covariance of a step under the ``model``, in rad²."""
    covariance = model.covariance(data.chain, data.q, data.v)
    return float(np.trace(covariance, axis1=-2, axis2=-1).mean())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pivoted_lu", "qr"])
@pytest.mark.parametrize("sigma_b", [0.1, 0.25, 0.5])
def test_known_dispersions_come_back_from_moments_and_likelihood(record, sigma_b, name):
    """Band of the moments: four standard errors, below 2 %; of the likelihood: 2 %."""
    data = record(WishartModel(sigma_b, Decomposition(name)), takes=200)
    by_moments = estimate(data, wishart("moments", name))
    rng = default_rng(2)
    resampled = []
    for _ in range(50):
        takes = rng.integers(200, size=200)
        resampled.append(by_moments.from_takes(takes)["sigma_b"])
    error = np.std(resampled, ddof=1)
    likely = estimate(data, wishart("likelihood", name))

    assert error < 0.01 * sigma_b
    band = min(4 * error, 0.02 * sigma_b)
    assert by_moments.estimates["sigma_b"] == pytest.approx(sigma_b, abs=band)
    assert likely.estimates["sigma_b"] == pytest.approx(sigma_b, rel=0.02)


def closest_fit(data: Recorded, decomposition: Decomposition) -> float:
    """σ̂_B of the closest fit at the moving steps."""
    steps = problem_steps(data, decomposition)
    b, _ = solve_problems(steps, objective_weights(1e-9, 3), 0.2)
    squares = normalized_std(b[None], np.eye(3)) ** 2
    moving = np.any(data.v, axis=-1)
    return np.sqrt(squares.mean(axis=0))[moving].mean()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pivoted_lu", "qr"])
@pytest.mark.parametrize("sigma_b", [0.1, 0.25, 0.5])
def test_known_dispersions_come_back_but_from_the_papers_estimator(
    record,
    sigma_b,
    name,
):
    """The paper's estimator contains 2m of the m(m + 1) parts of ‖B − I‖²: sqrt(2/(m + 1)) = .71 of
    σ_B at each moving step, plus measurement noise. At σ_B = .5 many perturbations are at the bound
    B⁻¹ ⪰ εI, and it is several times too large: the sign of its bias is not constant.
    """
    decomposition = Decomposition(name)
    model = WishartModel(sigma_b, decomposition)
    exact = record(model, takes=200, measured=1e-8 * MEASUREMENT)
    measured = record(model, takes=200)

    share = closest_fit(exact, decomposition) / sigma_b
    share_measured = closest_fit(measured, decomposition) / sigma_b

    if sigma_b == 0.5:
        assert share > 1.3
    else:
        assert 0.69 < share < 0.79
        assert share + 0.02 < share_measured < 0.9


def test_the_moments_of_a_gaussian_model_and_of_the_measurement_sum_to_the_recorded_ones(
    record,
):
    data = record(GaussianModel(0.05, 30.0), measured=100 * MEASUREMENT)
    fitted = estimate(data, Gaussian("gaussian")).model

    total = np.trace(mean_covariance(data.noise))
    measured = np.trace(data.measurement)
    assert total_variance(fitted, data) + measured == pytest.approx(total, rel=1e-9)
    assert measured > total / 4


@pytest.mark.parametrize("options", [wishart("moments"), Gaussian("gaussian")])
def test_noise_that_is_the_measurements_alone_gives_no_model_and_says_why(
    record,
    options,
):
    quiet = record(GaussianModel(0.0, 30.0))
    quiet.noise[:, REST:] *= 0.9
    with pytest.raises(ModelDomainError, match="does not exceed the measurement noise"):
        estimate(quiet, options)
    with pytest.raises(ModelDomainError, match="measured too well"):
        build_model({"kind": options.kind, "reason": "measured too well"})


every_estimator = pytest.mark.parametrize(
    "estimator",
    ["moments", "paper", "likelihood"],
)


@every_estimator
def test_the_bound_of_the_gaussian_model_is_found_where_the_noise_bends_with_it(
    chain,
    poses,
    record,
    estimator,
):
    norms = frobenius(chain.inverse_jacobian(poses[REST : REST + 40]))
    u = 1.1 * float(norms.max())
    level = 0.1 * np.sqrt(u**2 - np.mean(norms**2))
    data = record(GaussianModel(0.1, u), takes=300)

    fitted = estimate(data, Gaussian("gaussian", estimator=estimator))

    assert fitted.diagnostics["u_unbounded"] == 0
    assert fitted.undetermined == ()
    assert fitted.estimates["u"] == pytest.approx(u, rel=0.1)
    assert fitted.estimates["noise_level"] == pytest.approx(level, rel=0.03)


@every_estimator
def test_where_the_noise_follows_the_speed_alone_the_bound_is_unbounded(
    record,
    estimator,
):
    data = record(GaussianModel(1e-3, 2000.0))
    fitted = estimate(data, Gaussian("gaussian", estimator=estimator))

    parameters = fitted.parameters
    assert fitted.diagnostics["u_unbounded"] == parameters["u_unbounded"] == 1
    assert fitted.undetermined == ("u", "alpha")
    assert fitted.determined == {"noise_level": pytest.approx(2.0, rel=0.05)}
    # the exported model, of this level alone, has the fitted variance; α·u of the search has not
    level = fitted.determined["noise_level"]
    exported = build_model({"kind": "gaussian", "level": level})
    of_fit = total_variance(fitted.model, data)
    assert total_variance(exported, data) == pytest.approx(of_fit, rel=0.01)
    assert parameters["alpha"] * parameters["u"] > 1.04 * level


@every_estimator
@pytest.mark.parametrize("kind", [Gaussian, Wishart])
def test_a_motion_at_rest_throughout_is_refused(record, kind, estimator):
    data = record(GaussianModel(0.1, 25.0), takes=10)
    still = replace(data, v=np.zeros_like(data.v), known_measurement=1e-9 * np.eye(3))
    options = kind(kind.__module__.split(".")[-2], estimator=estimator)
    if kind is Wishart and estimator == "paper":  # B is the identity at rest
        assert estimate(still, options).estimates["sigma_b"] == 0
        return
    with pytest.raises(ModelDomainError, match="at rest at every step"):
        estimate(still, options)


def test_the_curve_over_the_weight_falls_through_the_moment_estimate(record):
    data = record(WishartModel(0.5), takes=20, speed=0.1)
    options = wishart("moments")
    rng = default_rng(3)
    fitted = estimate(data, options)

    _, tables = diagnose(data, options, fitted, 1, rng)
    _, without_model = diagnose(data, options, None, 1, rng)

    for _, points in tables["sigma_b_weights"].groupby("source"):
        rows = dict([*points.groupby("point")])
        curve = rows["curve"]
        ratio = rows["moments"]["ratio"].item()
        near = np.interp(np.log(ratio), np.log(curve["ratio"]), curve["sigma_b"])
        assert near == pytest.approx(fitted.estimates["sigma_b"], rel=0.15)
        assert curve["sigma_b"].iloc[-1] < 0.5 * curve["sigma_b"].iloc[0]
    assert {*tables["sigma_b_weights"]["source"]} == {"recorded", "drawn"}
    # without a model no takes are drawn
    assert {*without_model["sigma_b_weights"]["source"]} == {"recorded"}


@pytest.mark.parametrize(
    ("sigma_b", "speed", "ratio_of_ends"),
    [
        pytest.param(0.5, 0.1, (10, 60), id="wide: the bound holds steps"),
        pytest.param(0.05, 1.0, (0.99, 1.01), id="control: the bound holds no step"),
    ],
)
def test_the_papers_estimate_follows_the_bound_where_the_bound_holds_steps(
    record,
    sigma_b,
    speed,
    ratio_of_ends,
):
    data = record(WishartModel(sigma_b), takes=20, speed=speed)
    options = wishart("moments")
    rng = default_rng(3)

    metrics, tables = diagnose(data, options, estimate(data, options), 1, rng)

    table = tables["sigma_b_floors"]
    floors = table.pivot(index="floor", columns="ratio", values="sigma_b")
    low, high = ratio_of_ends
    assert floors.shape == (6, 3)
    assert (floors.diff().iloc[1:] <= 1e-12).all(axis=None)
    fitted = floors.iloc[:, 1]
    assert low < fitted[0.01] / fitted[0.5] < high
    assert metrics["sigma_b_greatest_over_floors"] == fitted[0.01]
    assert metrics["sigma_b_least_over_floors"] == fitted[0.5]


every_arm = pytest.mark.parametrize(
    ("n", "m"),
    [pytest.param(7, 6, marks=pytest.mark.slow), (3, 2)],
)


# takes, and steps of each, on the arms below
COUNT = 40
STEPS = 80


def scene(n: int, m: int):
    """Arm, a motion of it, the covariance of noise of a tenth of the steps' size, and the
    covariance of a measurement with a hundredth of it.
    """
    arm = random_arm(n, m)
    q, v = motion(arm, STEPS, REST)
    size = 0.01 * np.mean(np.diff(q[REST:], axis=0) ** 2)
    normals = default_rng(1).standard_normal((n, n))
    root = np.eye(n) + 0.5 * normals / np.sqrt(n)
    covariance = size * root @ root.T
    measured = 0.01 * np.diag(np.diag(covariance))
    return (arm, q[:-1], v), covariance, measured


# prefix of the compared estimates, band of their sampling error, factor on the control's noise
ESTIMATORS = {
    ("additive", "estimator", "paper"): ("", 0.15, 1.3),
    ("additive", "estimator", "shrinkage"): ("", 0.15, 1.3),
    ("wishart", "decomposition", "qr_transposed"): ("sigma_b", 0.04, 1.12),
    ("wishart", "decomposition", "pivoted_lu"): ("sigma_b", 0.04, 1.12),
    # α and u are hardly determined apart
    ("gaussian", "estimator", "paper"): ("noise_level", 0.04, 1.1),
    ("gaussian", "estimator", "likelihood"): ("noise_level", 0.04, 1.1),
}


def greatest_error(
    estimates: dict[str, float],
    truth: dict[str, float],
    names: str,
) -> float:
    """Greatest error of the estimates whose names start with ``names``: relative for variances and
    standard deviations, absolute for correlations; covariances do not count.
    """
    errors = []
    for name, true in truth.items():
        is_covariance = name.startswith("sigma_omega") and name[12] != name[13]
        if name.startswith(names) and not is_covariance:
            scale = 1.0 if name.startswith("correlation") else abs(true)
            errors.append(abs(estimates[name] - true) / scale)
    return max(errors)


@every_arm
@pytest.mark.parametrize(
    ("option", "names", "band", "factor"),
    [(option, *band) for option, band in ESTIMATORS.items()],
    ids=[f"{option[0]} {option[2]}" for option in ESTIMATORS],
)
def test_known_parameters_come_back_on_any_arm_and_others_do_not(
    n,
    m,
    option,
    names,
    band,
    factor,
):
    """Control: a model whose noise is larger by a factor."""
    kind, field, value = option
    choice = {field: value}
    if kind == "wishart":
        choice["estimator"] = "likelihood"
    options = kinds.options_type(kind)(kind, **choice)
    at, covariance, measured = scene(n, m)
    data = drawn_recording(*at, measured, AdditiveModel(covariance), COUNT)
    (truth,) = kinds.truths(data, options, [0.25])
    model = build_model(truth.parameters)

    def error(model) -> float:
        drawn = drawn_recording(*at, measured, model, COUNT)
        return greatest_error(estimate(drawn, options).estimates, truth.values, names)

    assert error(model) < band
    larger = model.with_trace(*at, factor**2 * total_variance(model, data))
    assert error(larger) > band


ADDITIVE = kinds.options_type("additive")("additive", estimator="paper")


def correlated(takes: int, rng: np.random.Generator) -> np.ndarray:
    """(takes, 20, 3) noise in rad whose size differs from take to take, so that the squares of a
    take's steps are correlated.
    """
    size = np.sqrt(rng.gamma(4.0, 0.25, (takes, 1, 1)))
    return 5e-3 * size * rng.standard_normal((takes, 20, 3))


def recording(chain, poses, step, noise: np.ndarray) -> Recorded:
    q = np.broadcast_to(poses[: noise.shape[1]], noise.shape)
    v = np.tile(step, (len(noise[0]), 1))
    return Recorded(chain, q, v, noise, ("a", "b", "c"), MEASUREMENT)


def standard_error(data: Recorded, rng: np.random.Generator) -> float:
    again = [replicate(data, ADDITIVE, None, rng) for _ in range(60)]
    assert None not in again
    result = spreads(again, estimate(data, ADDITIVE).estimates, len(data.q))
    return result["sigma_omega_11_rad2"].standard_error


def test_the_standard_error_is_the_spread_over_independent_recordings(
    chain,
    poses,
    step,
):
    rng = default_rng(1)
    estimates = [mean_covariance(correlated(COUNT, rng))[0, 0] for _ in range(1000)]
    spread = np.std(estimates, ddof=1)
    recordings = [correlated(COUNT, rng) for _ in range(12)]

    def mean_error(recordings: list[np.ndarray]) -> float:
        errors = []
        for noise in recordings:
            data = recording(chain, poses, step, noise)
            errors.append(standard_error(data, rng))
        return np.mean(errors)

    assert abs(mean_error(recordings) / spread - 1) < 0.15
    # control: steps drawn one by one, as if the steps of a take were independent
    single_steps = [noise.reshape(-1, 1, 3) for noise in recordings]
    assert mean_error(single_steps) / spread < 0.65


@pytest.mark.parametrize(
    ("kind", "estimator", "tolerance"),
    [
        ("wishart", "moments", 1e-12),
        # the weights follow from a known measurement noise here
        ("wishart", "paper", 1e-12),
        ("wishart", "likelihood", 2e-4),
        ("gaussian", "moments", 1e-12),
        ("gaussian", "likelihood", 5e-3),
    ],
)
def test_resampled_sums_give_the_estimate_of_the_resampled_takes(
    chain,
    poses,
    step,
    kind,
    estimator,
    tolerance,
):
    still = recording(chain, poses, step, np.zeros((8, 20, 3)))
    data = draw_data(WishartModel(0.25), still, default_rng(2))
    options = kinds.options_type(kind)(kind, estimator=estimator)
    fitted = estimate(data, options)
    name = {"wishart": "sigma_b", "gaussian": "noise_level"}[kind]

    for takes in (np.arange(8), np.array([0, 0, 3, 5, 5, 5, 6, 7]), np.array([1, 2])):
        anew = estimate(data.subset(takes), options).estimates[name]
        assert fitted.from_takes(takes)[name] == pytest.approx(anew, rel=tolerance)
    # control: the last takes have another estimate than all
    assert abs(fitted.estimates[name] / anew - 1) > max(2e-3, tolerance)


def test_a_replicate_without_an_estimate_is_counted_and_no_number():
    replicates = [{"a": 1.0, "b": 2.0}, None, {"a": 3.0}]
    spread = spreads(replicates, {"a": 2.0, "b": 2.0}, 4)
    assert set(spread) == {"a"}
    error, low, high = spread["a"]
    assert error == pytest.approx(np.sqrt(2)) and (low + high) / 2 == pytest.approx(2.0)
    assert high - 2.0 == pytest.approx(3.182446 * error)
