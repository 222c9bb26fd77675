"""A case has the stages' own fit, realisations and scores; its evidence has the names under which
the claims look for it, and is decided under every reading of "LU or QR".
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from sample_options import filter_options
from scipy.stats import multivariate_normal

from pipeline.configuration import config
from pipeline.core.columns import PLANE, spread, triangle
from pipeline.core.filters import NONE, closed
from pipeline.evidence.case import KINDS, Camera, Choices, Recordings, Takes, readings
from pipeline.evidence.motion import motion_evidence
from pipeline.evidence.outcomes import (
    PosteriorMoments,
    all_filters,
    case_evidence,
    evaluate,
    outcome,
    pose_covariances,
)
from pipeline.evidence.table import KEYS, evidence_row, evidence_table
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Start
from pipeline.models.kinds import options_type
from pipeline.models.steps import Recorded, mean_covariance, process_noise
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import decide, reading_verdicts
from pipeline.verdicts.run import ArmNames, Run

ROOT = Path(__file__).parents[2]
JOINTS = ("a", "b", "c")
ARM = ArmNames(JOINTS, PLANE)
CLAIMS = (
    "pipeline/verdicts/claims.yaml",
    "pipeline/studies/robustness/conclusions.yaml",
)
# claims of the wrench, the closed loop and the linear filter, which these takes lack
WRENCH = ("wrench", "sigma-s", "force", "closed-loop", "memory")
READINGS = ["pivoted LU", "QR of J", "QR of Jᵀ (control)"]
STEPS = 24
REST = 6
STD = np.array([2e-3, 3e-3, 4e-3])
MOVING = [0.002, -0.001, 0.02]  # a commanded step, in m, m and rad


@pytest.fixture(scope="module")
def takes(chain) -> Takes:
    """12 takes to fit to and 4 to test on; noise at every step, ten times as much while the robot
    moves.
    """
    rng = default_rng(5)
    v = np.zeros((STEPS, 3))
    v[REST:-REST] = MOVING
    poses = np.empty((16, STEPS + 1, 3))
    poses[:, 0] = rng.normal([0.3, 1.5, 0.2], 0.1 * STD, (16, 3))
    for k, command in enumerate(v):
        size = 1.0 if command.any() else 0.1
        noise = rng.normal(0.0, size * STD, (16, 3))
        nominal = chain.nominal_step(poses[:, k], command)
        poses[:, k + 1] = poses[:, k] + nominal + noise

    training = poses[:12]
    noise = process_noise(chain, training, v)
    recorded = Recorded(chain, training[:, :-1], v, noise, JOINTS)
    names = tuple(f"train_{n}" for n in range(12))
    tested = {f"test_{n}": take for n, take in enumerate(poses[12:])}
    return Takes(recorded, names, training, tested)


@pytest.fixture(scope="module")
def base() -> Choices:
    further = {
        "additive": {},
        "gaussian": {"beta": 0.5},
        "wishart": {"decomposition": "by_shape", "floor": 0.2},
    }
    models = {}
    for kind in KINDS:
        options = options_type(kind)
        models[kind] = options(kind, estimator="paper", **further[kind])
    return Choices(models, filter_options(60), "one_step")


def outcome_of(case, kind: str, takes):
    return outcome(case.model_case(kind), recordings_of(takes, Camera(None, {})))


@pytest.fixture
def posteriors(base, takes) -> dict[str, dict[str, PosteriorMoments | str]]:
    """Posterior of each model and test take, about 0.01 rad off, of a bound that varies."""
    rng = default_rng(2)
    variances = 1e-4 * np.exp(rng.standard_normal((STEPS + 1, 1, 1)))
    posteriors = {}
    for kind in base.models:
        posteriors[kind] = {}
        for name, take in takes.test.items():
            mean = take + 0.01 * rng.standard_normal(take.shape)
            posteriors[kind][name] = PosteriorMoments(mean, variances * np.eye(3))
    return posteriors


def recordings_of(takes: Takes, camera: Camera) -> Recordings:
    return Recordings(takes, {"aligned": camera}, 100.0, 4, 12, 1)


def camera_noise(takes) -> pd.DataFrame:
    """The table ``kinect_noise`` of a few frames; ``takes`` are the names in its rows."""
    frames = pd.Series(takes).groupby(np.array(takes)).cumcount()
    growing = np.linspace(1, 2, len(takes))
    covariance = growing[:, None, None] * np.eye(3)
    noise = spread("b", JOINTS, np.outer(growing, np.ones(3)))
    keys = {"take": takes, "frame": frames}
    return pd.DataFrame(keys | noise | triangle("r", JOINTS, covariance))


def test_a_filter_has_the_noise_of_a_pose_by_its_loop_and_the_training_mean_its_own(
    takes,
):
    truth = np.stack(list(takes.test.values()))
    training = takes.training
    law = (truth + 0.02, np.zeros((*truth.shape, 3)))
    posteriors = {"additive": law, closed("additive"): law}
    open_loop, closed_loop = pose_covariances(training, takes.poses)

    filters = all_filters(takes, truth, posteriors, None, 100.0, factor=2.0)

    assert_array_equal(filters["additive"].measurement, 2 * open_loop)
    assert_array_equal(filters[closed("additive")].measurement, 2 * closed_loop)
    assert not filters[NONE].measurement.any()
    assert_allclose(filters["additive"].error, 0.02)
    # the posterior's covariance is zero: the bound is the noise of a measured pose
    bound = np.sqrt(np.diag(2 * open_loop))
    assert_allclose(filters["additive"].bound, np.broadcast_to(bound, truth.shape))


def test_the_noise_of_a_pose_is_half_that_of_a_step_at_rest_and_a_loop_has_its_own(
    takes,
):
    training = takes.training
    open_loop, closed_loop = pose_covariances(training, takes.poses)
    with_identity = replace(training, known_measurement=np.eye(3))

    # an open loop has half the noise of ω at rest, which is of two poses
    assert_allclose(2 * open_loop, training.measurement)
    assert not np.allclose(open_loop, closed_loop)
    for covariance in pose_covariances(with_identity, takes.poses):
        assert_array_equal(covariance, np.eye(3) / 2)


def test_the_filters_start_has_the_covariance_of_the_training_takes(takes):
    start = Start.of_takes(takes.training)
    assert_allclose(start.covariance, np.cov(takes.poses[:, 0].T))


@pytest.fixture
def outcomes(base, takes) -> dict:
    """Outcome of each model."""
    return {kind: outcome_of(base, kind, takes) for kind in base.models}


@pytest.fixture
def evidence(base, takes, outcomes, posteriors) -> pd.DataFrame:
    """Evidence of all models, none of which is refused."""
    camera = Camera(camera_noise(np.repeat(["none", "a", "b"], 5)), {})
    recordings = recordings_of(takes, camera)
    rows, refusals, *_ = case_evidence(base, recordings, outcomes, posteriors)
    assert refusals == []
    return rows


VALUE_KEYS = ["quantity", "model", "joint", "steps"]


def values_of(evidence: pd.DataFrame) -> pd.Series:
    """Values without a rival, by their keys."""
    rows = evidence[evidence["rival"] == ""]
    return rows.set_index(VALUE_KEYS)["value"].sort_index()


def test_claims_have_the_numbers_of_the_outcomes(evidence):
    claims = []
    for file in CLAIMS:
        claims += parse_claims(config.read_yaml(ROOT / file)["claims"])
    decidable = [claim for claim in claims if not claim.id.startswith(WRENCH)]

    verdicts = decide(decidable, evidence, "paper", ARM)

    without = set()
    for verdict in verdicts:
        if None in [case.value for case in verdict.cases]:
            without.add(verdict.claim.id)
    assert len(verdicts) > 20
    # an unbounded û and its α̂ have no number, two takes of the camera no test
    assert without <= {"u", "alpha", "kinect-biased", "kinect-bias-varies"}


def test_a_difference_is_value_minus_rival(evidence):
    values = values_of(evidence)
    for row in evidence[evidence["rival"] != ""].itertuples():
        rival_keys = (row.rival, row.joint)
        if row.rival in JOINTS:
            rival_keys = (row.model, row.rival)
        rival = values[row.quantity, *rival_keys, row.steps]
        value = values[row.quantity, row.model, row.joint, row.steps]
        assert row.value == pytest.approx(value - rival, abs=1e-12), row
        assert row.low <= row.value <= row.high


def test_ranges_and_mean_errors_are_those_of_the_nominal_motion(
    evidence,
    outcomes,
    takes,
):
    values = values_of(evidence)
    training = takes.training
    nominal = training.chain.nominal_step(training.q, training.v)
    ranges = np.ptp(np.cumsum(nominal.mean(axis=0), axis=0), axis=0)
    means = {
        "additive": outcomes["additive"].mean[1:],
        "no_noise": (training.q + nominal).mean(axis=0),
    }
    recorded = takes.poses[:, 1:].mean(axis=0)

    assert_allclose(values["commanded_range", "recorded"], ranges)
    for name, mean in means.items():
        greatest = np.linalg.norm(mean - recorded, axis=1).max()
        assert values["greatest_mean_error", name].item() == pytest.approx(greatest)


def test_the_deviation_of_free_running_realisations_is_over_the_whole_motion(
    base,
    takes,
):
    free = outcome_of(replace(base, mode="free_running"), "additive", takes)
    table = motion_evidence({"additive": free}, takes, "free_running", None)
    std = table.query("quantity == 'std' and model == 'additive'")["value"]
    assert_allclose(std, np.sqrt(np.mean(free.deviation[1:] ** 2, axis=0)))


def test_a_model_or_filter_without_outcome_leaves_the_others_theirs_and_says_why(
    base,
    takes,
    posteriors,
):
    posteriors["gaussian"]["test_2"] = "all weights vanished"
    never_rests = np.broadcast_to(MOVING, takes.training.v.shape)
    training = replace(takes.training, v=never_rests)
    refused = outcome_of(base, "wishart", replace(takes, training=training))
    outcomes = {"additive": outcome_of(base, "additive", takes), "wishart": refused}
    recordings = recordings_of(takes, Camera(camera_noise(["none", "a"]), {}))

    evidence, refusals, *_ = case_evidence(base, recordings, outcomes, posteriors)

    assert (refused.model, refused.log_score, refused.mean) == (None, {}, None)
    (reason,) = refused.refusals
    assert "rest" in reason
    assert {"gaussian: all weights vanished"} < {*refusals}
    models = {name: {*rows["model"]} for name, rows in evidence.groupby("quantity")}
    assert models["rms_error_rad"] == {"additive", "wishart"}
    assert models["coverage"] == {"none", "additive", "wishart"}
    assert "sigma_b" not in models
    assert models["step_log_score"] == {"additive", "speed"}


@pytest.fixture(scope="module")
def measured(takes) -> Camera:
    """Frames of the test takes at every third step, and their noise."""
    rng = default_rng(6)
    t = np.arange(0, STEPS + 1, 3) / 100.0
    bias = np.zeros((len(t), 3))
    noise = np.broadcast_to(np.diag(STD**2), (len(t), 3, 3))
    frames = {}
    for name, poses in takes.test.items():
        y = poses[::3] + rng.normal(0.0, STD, (len(t), 3))
        frames[name] = Measurements(name, t, y, bias, noise)
    return Camera(None, frames)


def evidence_by_keys(case: Choices, recordings: Recordings) -> pd.DataFrame:
    (result,) = evaluate([case], recordings, map)
    assert result.refusals == []
    return result.evidence.set_index([*KEYS]).sort_index()


@pytest.fixture(scope="module")
def evidence_of_three(base, takes, measured) -> pd.DataFrame:
    recordings = recordings_of(takes, measured)
    return evidence_by_keys(replace(base, closed=True), recordings)


@pytest.mark.parametrize(
    "names",
    [["additive", "gaussian", "another"], ["wishart", "gaussian", "additive"]],
    ids=["one removed and one added", "reordered"],
)
def test_a_model_that_is_added_removed_or_moved_changes_no_row_of_another(
    base,
    takes,
    measured,
    evidence_of_three,
    names,
):
    further = {"another": replace(base.models["gaussian"], estimator="likelihood")}
    models = base.models | further
    case = replace(base, models={name: models[name] for name in names}, closed=True)
    before = evidence_of_three
    after = evidence_by_keys(case, recordings_of(takes, measured))
    common = before.index.intersection(after.index)

    pd.testing.assert_frame_equal(before.loc[common], after.loc[common])

    limits = {"correlation_of_bound_limit", "error_variation_limits"}
    assert limits | {"std_correlation_limit"} <= {*common.unique("quantity")}

    # rows of models in both cases are missing only if they compare with the first model
    missing = before.index.difference(after.index).to_frame()
    removed = [name for name in base.models if name not in names]
    removed += [closed(name) for name in removed]
    of_removed = missing[["model", "rival"]].isin(removed).any(axis=1)
    compared = missing["rival"].eq("additive") & (names[0] != "additive")

    assert (of_removed | compared).all()


def test_another_draw_changes_realisations_filters_and_their_limits(
    base,
    takes,
    measured,
    evidence_of_three,
):
    case = replace(base, draw=1, closed=True)
    drawn = evidence_by_keys(case, recordings_of(takes, measured))

    def sums(evidence: pd.DataFrame) -> pd.Series:
        return evidence.groupby("quantity")[["value", "low"]].sum().sum(axis=1)

    changed = sums(evidence_of_three) != sums(drawn)
    assert changed["rms_error_rad"] and changed["error_variation_limits"]
    # the fits are of the same takes
    assert not changed["sigma_b"]


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_the_log_score_has_the_measurement_noise_times_its_factor(base, takes, factor):
    training = takes.training
    test = np.stack(list(takes.test.values()))
    nominal = training.chain.nominal_step(test[:, :-1], training.v)
    noise = np.diff(test, axis=1) - nominal
    covariance = mean_covariance(training.noise) + factor * training.measurement
    densities = multivariate_normal(np.zeros(3), covariance).logpdf(noise)
    moving = np.any(training.v, axis=1)

    scores = outcome_of(replace(base, measurement=factor), "additive", takes).log_score

    assert_allclose(scores["all"], densities.mean(axis=1), rtol=1e-10)
    assert_allclose(scores["moving"], densities[:, moving].mean(axis=1), rtol=1e-10)


def test_without_noise_at_rest_moving_steps_alone_are_scored_and_modes_differ(
    base,
    takes,
):
    scores = outcome_of(replace(base, measurement=0.0), "gaussian", takes).log_score
    assert [*scores] == ["moving"]
    assert np.all(np.isfinite(scores["moving"]))

    last = {}
    for mode in ("one_step", "free_running"):
        case = replace(base, mode=mode)
        last[mode] = outcome_of(case, "additive", takes).deviation[-1]
    assert np.all(last["free_running"] > 2 * last["one_step"])


def test_without_test_takes_each_training_take_is_predicted_by_a_fit_to_the_others(
    base,
    takes,
):
    rest = takes.training.subset(np.delete(np.arange(12), 3))
    covariance = mean_covariance(rest.noise) + rest.measurement
    law = multivariate_normal(np.zeros(3), covariance)
    expected = law.logpdf(takes.training.noise[3]).mean()

    scores = outcome_of(base, "additive", replace(takes, test={})).log_score["all"]

    assert len(scores) == 12
    assert scores[3] == pytest.approx(expected, rel=1e-10)


def test_the_runs_own_reading_is_first_and_every_other_comes_once(base):
    assert list(readings(base)) == READINGS
    assert readings(base)[READINGS[0]] == base

    redundant = readings(base, ["x", "z"])
    assert list(redundant) == [READINGS[n] for n in (1, 0, 2)]
    assert redundant[READINGS[1]] == base


def test_a_reading_changes_the_decomposition_alone(base):
    for case in readings(base.with_wishart(floor=0.1)).values():
        assert case.models["wishart"].floor == 0.1
        assert case.models["gaussian"] == base.models["gaussian"]


def std_of_models(sizes: dict[str, float]) -> pd.DataFrame:
    """Evidence of the standard deviation of each model."""
    rows = [evidence_row("std", value, model=model) for model, value in sizes.items()]
    return evidence_table(rows)


SMALL = {
    "id": "small",
    "about": "method",
    "rule": "below",
    "limit": 1.0,
    "value": {"quantity": "std", "model": "{model}"},
    "each": {"model": ["wishart", "gaussian"]},
} | {key: key for key in ("where", "statement", "quantity", "reason")}


@pytest.mark.parametrize(
    ("wishart", "expected"),
    [
        (0.4, ("holds", "wishart: 0.4; gaussian: 0.2", "")),
        (1.4, ("fails", "wishart: 1.4 ✗; gaussian: 0.2", "")),
        (None, ("no evidence", "gaussian: 0.2", "no noise")),
    ],
)
def test_a_claim_holds_where_its_rule_does_in_every_case_and_lacks_none(
    wishart,
    expected,
):
    evidence = std_of_models({"wishart": 0.5, "gaussian": 0.2})
    of_reading = std_of_models({} if wishart is None else {"wishart": wishart})
    refusals = {"reading": ["own", "other"], "refused": [np.nan, "no noise"]}
    tables = {
        "evidence": evidence,
        "readings": of_reading.assign(reading="other"),
        "reading_refusals": pd.DataFrame(refusals),
    }
    run = Run("lab", "paper", True, ["a"], ["x"], {}, {}, tables)

    table = reading_verdicts(parse_claims([SMALL]), run)

    assert tuple(table.loc[0, ["holds", "refused"]]) == ("holds", "")
    assert tuple(table.loc[1, ["holds", "value", "refused"]]) == expected
