"""The evidence has the names under which the claims look for it, and says what the numbers say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.cases.case import Camera
from pipeline.cases.evidence import case_evidence, filter_evidence, motion_evidence, outcome
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
    none = np.zeros(len(mean), dtype=int)
    return Posterior(mean, covariance, none + 1.0, none > 0, none > 0, none, none, 0, 0.0)


def fared(base, takes, *kinds: str) -> dict:
    """The outcome of each of the kinds of model."""
    return {
        kind: outcome(base.model_case(kind), takes, 12, np.random.default_rng(1)) for kind in kinds
    }


@pytest.fixture
def truth(takes) -> np.ndarray:
    return np.stack(list(takes.test.values()))


@pytest.fixture
def posteriors(base, takes, truth) -> dict[str, dict[str, Posterior | str]]:
    rng = np.random.default_rng(2)
    spread_of_step = 1e-4 * np.exp(rng.standard_normal((truth.shape[1], 1, 1))) * np.eye(3)
    return {
        kind: {
            name: posterior(take + 0.01 * rng.standard_normal(take.shape), spread_of_step)
            for name, take in takes.test.items()
        }
        for kind in base.models
    }


def camera_noise(takes) -> pd.DataFrame:
    """The table ``kinect_noise`` of a few frames."""
    growing = np.linspace(1, 2, len(takes))
    covariance = growing[:, None, None] * np.eye(3)
    noise = spread("b", JOINTS, np.outer(growing, np.ones(3)))
    return pd.DataFrame({"take": takes} | noise | triangle("r", JOINTS, covariance))


def test_there_is_evidence_on_every_claim_about_motion_camera_and_filter(base, takes, posteriors):
    outcomes = fared(base, takes, *base.models)
    camera = Camera(camera_noise(np.repeat(["none", "a", "b"], 5)), {})
    evidence, refusals = case_evidence(base, takes, outcomes, camera, posteriors, DT)
    assert refusals == []
    claims = [
        claim for file in CLAIMS for claim in parse_claims(config.read_yaml(ROOT / file)["claims"])
    ]
    asked = [claim for claim in claims if not claim.id.startswith(WRENCH)]
    verdicts = decide(asked, evidence, "paper", ARM)
    assert len(verdicts) > 20
    assert [v.claim.id for v in verdicts if any(case.value is None for case in v.cases)] == []


def spread_out(takes, seed: int):
    """The takes and measured poses with noise, as at the first step the fixture's do not differ."""
    rng = np.random.default_rng(seed)
    poses = takes.poses + 1e-3 * rng.standard_normal(takes.poses.shape)
    truth = np.stack(list(takes.test.values()))
    return replace(takes, poses=poses), truth + 1e-3 * rng.standard_normal(truth.shape)


def test_filters_are_compared_with_the_training_takes_and_hold_the_noise_of_a_pose(takes):
    takes, truth = spread_out(takes, 6)
    middle = takes.poses.mean(axis=0)
    covariance = np.array([np.cov(step.T) for step in takes.poses.swapaxes(0, 1)])
    known, off = ([posterior(middle + shift, covariance)] * len(truth) for shift in (0.0, 0.05))
    beside = [posterior(take + 0.02, covariance) for take in truth]
    linear = no_filter(takes.poses, truth)

    def against(noise: np.ndarray) -> pd.DataFrame:
        filters = {"additive": off, "gaussian": known, "gaussian_closed": known, "wishart": beside}
        evidence = filter_evidence(filters, linear, truth, takes, noise)
        assert evidence["metrics/filter"]["wishart_b_rms_error_rad"] == pytest.approx(0.02)
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
    rng, noise = np.random.default_rng(3), 1e-8 * np.eye(3)[None]
    frames = {}  # one a tenth of the spread off, at the step before the last
    for name, take in takes.test.items():
        seen = take[[-2]] + 1e-4 * rng.standard_normal((1, 3))
        time = np.array([DT * (len(take) - 2)])
        frames[name] = Measurements(name, time, seen, np.zeros((1, 3)), noise)
    camera, (apart, _) = Camera(camera_noise(["none", "a"]), frames), spread_out(takes, 3)

    def rows(closed: bool) -> pd.Series:
        case = replace(base, closed=closed)
        evidence, _ = case_evidence(case, apart, {}, camera, posteriors, DT)
        table = evidence["tables/filter_against_none"]
        return table.set_index(["model", "score"])["difference"]

    assert (rows(True)[MEMORY][[f"rms_error_{joint}_rad" for joint in JOINTS]] < 0).all()
    assert MEMORY not in rows(False)


def test_a_model_without_outcome_leaves_the_others_their_evidence(base, takes):
    outcomes = fared(base, takes, "additive", "gaussian")
    outcomes["wishart"] = type(outcomes["additive"])(refusals=["no"])
    evidence = motion_evidence(outcomes, takes, "one_step")
    motion = evidence["metrics/motion"]
    assert evidence["metrics/fit_wishart"] == {} and "additive_std_a_rms_rad" in motion
    assert not any(name.startswith("wishart") for name in motion)
    assert set(evidence["tables/one_step_scores"]["model"]) == {"additive", "gaussian"}


def test_a_filter_that_was_lost_on_one_take_is_no_evidence_and_says_why(base, takes, posteriors):
    posteriors["gaussian"]["test_2"] = "all weights vanished"
    camera = Camera(camera_noise(["none", "a"]), {})
    evidence, refusals = case_evidence(base, takes, {}, camera, posteriors, DT)
    assert refusals == ["gaussian: all weights vanished"]
    models = {name.partition("_")[0] for name in evidence["metrics/filter"]}
    assert models == {"none", "additive", "wishart"}


def test_without_a_camera_there_is_no_evidence_on_it_or_the_filter(base, takes):
    evidence, _ = case_evidence(base, takes, fared(base, takes, "additive"), None, {}, DT)
    tables = {"mean_error_comparison", "one_step_scores", "spread_comparison"}
    assert set(evidence) == {"metrics/fit_additive", "metrics/motion"} | {
        f"tables/{name}" for name in tables
    }
