"""The evidence has the names under which the claims look for it, and says what the numbers say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.cases.case import Camera
from pipeline.cases.evidence import case_evidence, filter_evidence, motion_evidence
from pipeline.cases.fits import outcome
from pipeline.core import config
from pipeline.core.columns import spread, triangle
from pipeline.core.filters import MEMORY
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior
from pipeline.statistics.filters import no_filter
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import decide
from pipeline.verdicts.reference import ArmNames

ROOT = Path(__file__).parents[2]
JOINTS = ("a", "b", "c")
ARM = ArmNames(JOINTS, ("x", "z", "phi"))
DT = 0.01
CLAIMS = ("reports/claims.yaml", "pipeline/studies/robustness/conclusions.yaml")
# claims of the wrench, the closed loop, the linear filter and the speed-scaled model, which
# these takes lack
WRENCH = ("wrench", "sigma-s", "force", "closed-loop", "memory", "scaled")


def posterior(mean: np.ndarray, covariance: np.ndarray) -> Posterior:
    grid = len(mean)
    counts = np.zeros(grid, dtype=int)
    return Posterior(
        mean, covariance, np.ones(grid), counts > 0, counts > 0, counts, counts, 0, 0.0
    )


@pytest.fixture
def truth(takes) -> np.ndarray:
    return np.stack(list(takes.test.values()))


@pytest.fixture
def posteriors(base, truth) -> dict[str, list[Posterior]]:
    rng = np.random.default_rng(2)
    grid = truth.shape[1]
    covariance = 1e-4 * np.exp(rng.standard_normal((grid, 1, 1))) * np.eye(3)
    return {
        kind: [
            posterior(take + 0.01 * rng.standard_normal(take.shape), covariance) for take in truth
        ]
        for kind in base.models
    }


def camera_noise(takes) -> pd.DataFrame:
    """The table ``kinect_noise`` of a few frames."""
    growing = np.linspace(1, 2, len(takes))
    covariance = growing[:, None, None] * np.eye(3)
    noise = spread("b", JOINTS, np.outer(growing, np.ones(3)))
    return pd.DataFrame({"take": takes} | noise | triangle("r", JOINTS, covariance))


def by_take(takes, posteriors) -> dict[str, dict[str, Posterior | str]]:
    return {model: dict(zip(takes.test, own, strict=True)) for model, own in posteriors.items()}


def test_there_is_evidence_on_every_claim_about_motion_camera_and_filter(base, takes, posteriors):
    outcomes = {
        kind: outcome(base.model_case(kind), takes, 12, np.random.default_rng(1))
        for kind in base.models
    }
    camera = Camera(camera_noise(np.repeat(["none", "a", "b"], 5)), {})
    evidence, refusals = case_evidence(
        base, takes, outcomes, camera, by_take(takes, posteriors), DT
    )
    assert refusals == []
    claims = [
        claim for file in CLAIMS for claim in parse_claims(config.read_yaml(ROOT / file)["claims"])
    ]
    verdicts = decide(
        [claim for claim in claims if not claim.id.startswith(WRENCH)], evidence, "paper", ARM
    )
    assert len(verdicts) > 20
    missing = [v.claim.id for v in verdicts if any(case.value is None for case in v.cases)]
    assert missing == []


def spread_out(takes, seed: int):
    """The takes and measured poses with noise, as at the first step the fixture's do not differ."""
    rng = np.random.default_rng(seed)
    poses = takes.poses + 1e-3 * rng.standard_normal(takes.poses.shape)
    truth = np.stack(list(takes.test.values()))
    return replace(takes, poses=poses), truth + 1e-3 * rng.standard_normal(truth.shape)


def test_a_filter_has_the_error_and_the_coverage_of_its_own_posterior(takes):
    takes, truth = spread_out(takes, 5)
    covariance = np.broadcast_to(1e-4 * np.eye(3), (truth.shape[1], 3, 3))
    near, far = ([posterior(take + off, covariance) for take in truth] for off in (0.005, 0.02))
    evidence = filter_evidence(
        {"additive": near, "wishart": far}, None, truth, takes, np.zeros((2, 3, 3))
    )["metrics/filter"]
    assert evidence["additive_b_rms_error_rad"] == pytest.approx(0.005)
    assert evidence["additive_b_mean_bound_rad"] == pytest.approx(0.01)
    assert evidence["wishart_b_rms_error_rad"] == pytest.approx(0.02)
    covered = [evidence[f"{model}_b_coverage_of_the_bound"] for model in ("additive", "wishart")]
    assert covered == [1, 0]


def test_filters_are_compared_with_the_training_takes_and_hold_the_noise_of_a_pose(takes):
    takes, truth = spread_out(takes, 6)
    middle = takes.poses.mean(axis=0)
    covariance = np.array([np.cov(step.T) for step in takes.poses.swapaxes(0, 1)])
    known, off = ([posterior(middle + shift, covariance)] * len(truth) for shift in (0.0, 0.05))
    linear = no_filter(takes.poses, truth)

    def against(noise: np.ndarray) -> pd.DataFrame:
        filters = {"additive": off, "gaussian": known, "gaussian_closed": known}
        evidence = filter_evidence(filters, linear, truth, takes, noise)
        return evidence["tables/filter_against_none"].set_index(["model", "score"])

    rows = against(np.zeros((2, 3, 3)))
    for model in ("gaussian", "gaussian_closed", MEMORY):
        np.testing.assert_allclose(rows.loc[model, "difference"].dropna(), 0.0, atol=1e-9)
    assert rows.loc[("additive", "rms_error_b_rad"), "low"] > 0.02
    assert rows.loc[("additive", "log_score"), "high"] < -1
    # the noise of a measured pose is another to a closed loop
    rows = against(np.stack([np.zeros((3, 3)), np.eye(3)]))
    assert rows.loc[("gaussian", "log_score"), "difference"] == pytest.approx(0.0)
    assert rows.loc[("gaussian_closed", "log_score"), "high"] < -1


def test_filters_in_a_closed_loop_come_with_the_linear_one_of_the_takes(base, takes, posteriors):
    rng = np.random.default_rng(3)
    # one frame a tenth of the spread off, at the step before the last
    noise = 1e-8 * np.eye(3)[None]
    frames = {
        name: Measurements(
            name,
            np.array([DT * (len(take) - 2)]),
            take[[-2]] + 1e-4 * rng.standard_normal((1, 3)),
            np.zeros((1, 3)),
            noise,
        )
        for name, take in takes.test.items()
    }
    camera, filters = Camera(camera_noise(["none", "a"]), frames), by_take(takes, posteriors)
    apart, _ = spread_out(takes, 3)

    def rows(closed: bool) -> pd.Series:
        case = replace(base, closed=closed)
        evidence, _ = case_evidence(case, apart, {}, camera, filters, DT)
        table = evidence["tables/filter_against_none"]
        return table.set_index(["model", "score"])["difference"]

    assert (rows(True)[MEMORY][[f"rms_error_{joint}_rad" for joint in JOINTS]] < 0).all()
    assert MEMORY not in rows(False)


def test_a_model_without_outcome_leaves_the_others_their_evidence(base, takes):
    outcomes = {
        kind: outcome(base.model_case(kind), takes, 12, np.random.default_rng(1))
        for kind in ("additive", "gaussian")
    }
    outcomes["wishart"] = type(outcomes["additive"])(refusals=["no"])
    evidence = motion_evidence(outcomes, takes, "one_step")
    assert (
        evidence["metrics/fit_wishart"] == {}
        and "additive_std_a_rms_rad" in evidence["metrics/motion"]
    )
    assert not any(name.startswith("wishart") for name in evidence["metrics/motion"])
    assert set(evidence["tables/one_step_scores"]["model"]) == {"additive", "gaussian"}


def test_a_filter_that_was_lost_on_one_take_is_no_evidence_and_says_why(base, takes, posteriors):
    camera, lost = Camera(camera_noise(["none", "a"]), {}), by_take(takes, posteriors)
    lost["gaussian"]["test_2"] = "all weights vanished"
    evidence, refusals = case_evidence(base, takes, {}, camera, lost, DT)
    assert refusals == ["gaussian: all weights vanished"]
    models = {name.partition("_")[0] for name in evidence["metrics/filter"]}
    assert models == {"none", "additive", "wishart"}


def test_without_a_camera_there_is_no_evidence_on_it_or_the_filter(base, takes):
    evidence, _ = case_evidence(
        base,
        takes,
        {"additive": outcome(base.model_case("additive"), takes, 12, np.random.default_rng(1))},
        None,
        {},
        DT,
    )
    assert set(evidence) == {
        "metrics/fit_additive",
        "metrics/motion",
        "tables/mean_error_comparison",
        "tables/one_step_scores",
        "tables/spread_comparison",
    }
