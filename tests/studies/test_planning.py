"""Motions keep the task path; sums are variances of the takes, with equal draws for every motion; a
plan has the least sum by its model.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from study_runs import options_of

from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kinds import build_model
from pipeline.models.steps import process_noise
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.studies.planning import stage
from pipeline.studies.planning.stage import Bench

OPTIONS = options_of("planning")


def coarse(task: list[str]) -> Bench:
    """Return the youBot at 25 steps of the motion and 200 of the servo a second."""
    own = Bench.of_dataset("youbot", task, OPTIONS, seed=1)
    motion, dynamics = (
        replace(own.trajectory, rate=25.0),
        replace(own.dynamics, rate=200.0),
    )
    return replace(own, trajectory=motion, dynamics=dynamics, takes=6)


@pytest.fixture(scope="module")
def bench() -> Bench:
    return coarse(["x", "z"])


@pytest.fixture(scope="module")
def motions(bench):
    return stage.fixed_motions(bench, OPTIONS)


def test_the_motions_share_their_task_path_and_no_more(bench, motions):
    path = bench.chain.pose(bench.recorded)
    for joints in motions.values():
        assert (
            np.abs(bench.chain.displacement(bench.chain.pose(joints), path)).max()
            < 1e-8
        )
    assert np.array_equal(motions["minimum_norm"][0], motions["recorded"][0])
    least = {
        name: np.linalg.svd(bench.chain.jacobian(joints), compute_uv=False)[:, -1].min()
        for name, joints in motions.items()
    }
    assert least["best_conditioned"] == max(least.values())


@pytest.mark.slow
def test_a_plan_has_the_least_sum_by_its_model(bench, motions):
    model = GaussianModel(0.5, 12.0)
    plan = stage.plan_motion(bench, model, OPTIONS)
    sums = [stage.predicted_sum(bench, model, path) for path in motions.values()]
    assert stage.predicted_sum(bench, model, plan) < min(sums)


def test_a_model_without_an_order_or_a_covariance_has_no_plan(bench):
    wide = WishartModel(0.9, Decomposition("qr_transposed"))
    constant = {"kind": "additive", "noise_covariance": (1e-6 * np.eye(3)).tolist()}
    constant = build_model(constant)
    for model, words in ((constant, "same at every step"), (wide, "exists only")):
        with pytest.raises(ModelDomainError, match=words):
            stage.plan_motion(bench, model, OPTIONS)
    assert np.isnan(stage.predicted_sum(bench, wide, bench.recorded))


def test_sums_are_the_variances_of_the_takes_resampled_or_not(bench):
    rng = np.random.default_rng(1)
    choices = [np.arange(6), rng.integers(6, size=6), np.array([3, 3, 5])]
    sums = stage.realised_sums(bench, {"recorded": bench.recorded}, choices)["recorded"]
    q = bench.poses(bench.recorded, "take")
    noise = process_noise(bench.chain, q, bench.command(bench.recorded))
    for takes, value in zip(choices, sums, strict=True):
        assert value == pytest.approx(noise[takes].var(axis=0, ddof=1).sum(), rel=1e-9)


def test_orders_agree_in_part_and_equal_predictions_have_no_order():
    realised = [1.0, 2.0, 3.0, 4.0]

    def tau(predicted: list[float]) -> float:
        return stage.agreement(
            pd.DataFrame({"predicted": predicted, "ratio": realised})
        )

    assert tau(realised) == 1.0 and tau([2.5, 2.0, 3.0, 4.0]) == pytest.approx(
        1 - 2 / 6
    )
    assert np.isnan(
        tau([1.0 + 1e-13 * value for value in realised])
    )  # equal but for rounding


def test_the_takes_of_two_motions_err_alike_and_those_of_training_are_others(bench):
    moved = bench.recorded + np.array([0.0, 0.0, 0.01])
    first, second = (
        bench.poses(path, "take") - path for path in (bench.recorded, moved)
    )
    training = bench.poses(bench.recorded, "training") - bench.recorded
    spread = first.std()
    assert np.abs(first - second).max() < 0.2 * spread < np.abs(first - training).max()
    # a take does not depend on the number of takes
    fewer = replace(bench, takes=2)
    assert np.array_equal(
        fewer.poses(bench.recorded, "take"), (first + bench.recorded)[:2]
    )


def test_the_task_that_is_planned_changes_nothing_of_the_arm_that_moves(bench):
    whole = coarse([])
    assert (bench.chain.task, whole.chain.task) == (("x", "z"), ("x", "z", "phi"))
    assert np.array_equal(
        bench.poses(bench.recorded, "take"), whole.poses(whole.recorded, "take")
    )
    with pytest.raises(ConfigError, match="joint limits"):
        bench.poses(bench.recorded + 3.0, "take")


def test_the_page_counts_plans_of_least_sum():
    sums = {
        "recorded": 2.0,
        "minimum_norm": 1.0,
        "best_conditioned": 3.0,
        "gaussian": 0.5,
    }
    rows = stage.sum_rows({name: np.full(3, x) for name, x in sums.items()})
    assert rows["least"].tolist() == [0, 0, 0, 1] and rows["ratio"].tolist() == [
        2,
        1,
        3,
        0.5,
    ]
    place = {"arm": "youbot", "physics": "base condition"}
    predicted = pd.DataFrame({"motion": list(sums), "sum": [2.0, 1.0, 0.5, 0.4]})
    tables = {
        "planning": rows.assign(**place),
        "planning_predictions": predicted.assign(model="gaussian", **place),
    }
    facts = stage.facts(tables, OPTIONS)
    assert (facts["sure"], facts["pairs"], facts["medians"]) == (
        1,
        1,
        "0.333 (gaussian)",
    )
