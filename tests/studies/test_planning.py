"""Steps have the paper's constraint with the duration; a plan keeps its limits and has the least
sum of all starts; sums are variances of the takes, with equal draws for every motion.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from planning_arms import ARMS, LAWS, path_task
from scipy.integrate import solve_ivp
from study_runs import options_of

from pipeline.core import rng
from pipeline.core.errors import ConfigError
from pipeline.laboratory.dynamics import JointPath, open_session, perform
from pipeline.models.kinds import build_model
from pipeline.studies.planning import stage
from pipeline.studies.planning.solver import (
    PathTask,
    feasible,
    feasible_motions,
    least_uncertain,
    motions_from,
    start_poses,
    summed_variance,
)
from pipeline.studies.planning.stage import PLAN, RECORDED_START, Bench, bench_of

OPTIONS = options_of("planning")


def numerical_jacobian(task: PathTask, q: np.ndarray) -> np.ndarray:
    """(m, n) central differences of the pose at ``q`` (n,)."""
    step = 1e-6
    chain = task.chain
    columns = []
    for direction in step * np.eye(len(q)):
        behind = chain.pose(q - direction)
        ahead = chain.pose(q + direction)
        columns.append(chain.displacement(behind, ahead) / (2 * step))
    return np.stack(columns, axis=-1)


def off_path(task: PathTask, q: np.ndarray) -> float:
    """Greatest distance of the poses ``q`` (steps + 1, n) from the path."""
    return np.abs(task.chain.displacement(task.chain.pose(q), task.path)).max()


@pytest.mark.parametrize("k", [10, 30])
@pytest.mark.parametrize("arm", ARMS)
def test_a_step_is_the_inverse_jacobian_times_velocity_and_duration(arm, k):
    task = path_task(arm, 50)
    q, *_ = feasible_motions(task, 64)
    step = q[k + 1] - q[k]
    way = task.chain.displacement(task.chain.pose(q[k]), task.path[k + 1])
    velocity = task.rate * way
    expected = np.linalg.pinv(numerical_jacobian(task, q[k])) @ velocity

    assert_allclose(step * task.rate, expected, rtol=1e-5, atol=1e-7)
    # the control: the printed constraint, without the duration
    assert np.linalg.norm(step - expected) > 0.9 * np.linalg.norm(expected)


def test_starts_of_a_square_arm_are_its_branches_and_of_others_lie_on_the_path():
    square = path_task("square", 10)
    assert len(start_poses(square, 64)) == 2

    for arm in ("planar", "seven"):
        task = path_task(arm, 10)
        starts = start_poses(task, 64)
        off = task.chain.displacement(task.chain.pose(starts), task.path[0])
        assert len(starts) > 10 and np.abs(off).max() < 1e-10
        assert task.chain.within_limits(starts).all()


def starts_by_self_motion(task: PathTask, start: np.ndarray) -> np.ndarray:
    """Poses (S, n) that the arm with its tip at rest reaches from ``start`` (n,)."""

    def along(_: float, q: np.ndarray) -> np.ndarray:
        # across both rows of J, and so continuous
        return np.cross(*numerical_jacobian(task, q)) * 100

    poses = []
    for end in (-2.0, 2.0):
        times = np.linspace(0.0, end, 60)
        poses.append(solve_ivp(along, (0.0, end), start, t_eval=times, rtol=1e-9).y.T)
    return np.concatenate(poses)


@pytest.mark.parametrize("arm", ARMS)
def test_half_the_duration_of_a_step_leaves_a_quarter_of_the_distance_from_the_path(
    arm,
):
    coarse = path_task(arm, 50)
    finer = path_task(arm, 100)
    q, *_ = feasible_motions(coarse, 64)
    (fine,) = motions_from(finer, q[:1])
    assert off_path(finer, fine) == pytest.approx(off_path(coarse, q) / 4, rel=0.1)


def test_starts_of_a_square_arm_are_its_branches():
    assert len(start_poses(path_task("square", 10), 64)) == 2


@pytest.mark.parametrize("arm", ["planar", "seven"])
def test_starts_of_a_redundant_arm_lie_on_the_path(arm):
    task = path_task(arm, 10)
    starts = start_poses(task, 64)
    off = task.chain.displacement(task.chain.pose(starts), task.path[0])
    assert len(starts) > 10
    assert np.abs(off).max() < 1e-10
    assert task.chain.within_limits(starts).all()


@pytest.mark.parametrize("law", LAWS)
def test_a_plan_keeps_its_limits_and_has_the_least_sum_of_all_starts(law):
    task = path_task("planar", 40)
    model = build_model(LAWS[law])
    chain = task.chain
    plan = least_uncertain(model, task, feasible_motions(task, 1024))

    speed = np.abs(np.diff(plan, axis=0)) * task.rate
    singular_values = np.linalg.svd(chain.jacobian(plan), compute_uv=False)
    assert chain.within_limits(plan).all()
    assert np.all(speed <= chain.max_speed)
    assert singular_values.min() >= task.margin

    # the independent check: starts that the arm reaches from the path's own by self-motion
    starts = starts_by_self_motion(task, np.array(ARMS["planar"][1]))
    off = chain.displacement(chain.pose(starts), task.path[0])
    assert np.abs(off).max() < 1e-6
    motions = motions_from(task, starts)
    sums = summed_variance(model, task, motions[feasible(task, motions)])
    assert summed_variance(model, task, plan[None])[0] < sums.min() * 1.01
    assert sums.max() > 1.02 * sums.min()


@pytest.mark.parametrize("changes", [{"margin": 5.0}, {"rate": 1e5}], ids=str)
def test_a_path_without_a_motion_in_the_limits_is_refused(changes):
    task = replace(path_task("planar", 20), **changes)
    words = "no start has a motion within the limits"
    with pytest.raises(ConfigError, match=words):
        feasible_motions(task, 64)


@pytest.fixture(scope="module")
def bench() -> Bench:
    """Return the youBot at 200 steps of the servo a second."""
    whole = bench_of("youbot", "timing", OPTIONS, seed=1)
    return replace(whole, dynamics=replace(whole.dynamics, rate=200.0), takes=6)


def test_takes_of_a_motion_are_those_that_the_laboratory_performs(bench):
    motion = JointPath(bench.recorded, bench.task.rate)
    stream = rng.stream(1, "planning.session")
    session = open_session(bench.built, bench.dynamics, stream)
    take = perform(session, motion, bench.dynamics, rng.stream(1, "planning.take", 2))

    steps = bench.recorded_steps(bench.recorded, "take")
    training = bench.recorded_steps(bench.recorded, "training")

    assert_array_equal(steps.q[2], take.motion_capture[:-1])
    # other motions have equal draws, training takes have others
    assert np.abs(training.q - steps.q).max() > 1e-4
    with pytest.raises(ConfigError, match="joint limits"):
        bench.recorded_steps(bench.recorded + 3.0, "take")


def test_sums_are_the_variances_of_the_takes_resampled_or_not(bench):
    resampled = default_rng(1).integers(6, size=6)
    choices = [np.arange(6), resampled, np.array([3, 3, 5])]
    noise = bench.recorded_steps(bench.recorded, "take").noise
    sums = stage.realised_sums(noise, choices)
    for takes, value in zip(choices, sums, strict=True):
        expected = noise[takes].var(axis=0, ddof=1).sum()
        assert value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("predicted", "agreement"),
    [
        ([1.0, 2.0, 3.0, 4.0], 1.0),
        ([2.5, 2.0, 3.0, 4.0], 1 - 2 / 6),
        ([1.0, 2.0], np.nan),
    ],
)
def test_orders_agree_in_part(predicted, agreement):
    ratios = np.arange(1.0, len(predicted) + 1)
    tau = stage.agreement(pd.DataFrame({"predicted": predicted, "ratio": ratios}))
    assert tau == pytest.approx(agreement, nan_ok=True)


def test_the_page_counts_plans_of_least_sum():
    case = {"arm": "youbot", "cause": "timing"}
    ratios = {RECORDED_START: 1.0, "conditioning 0%": 3.0, PLAN + "gaussian": 0.5}
    planning = pd.DataFrame({"motion": list(ratios), "ratio": list(ratios.values())})
    planning = planning.assign(low=0.4, high=3.1, least=[0.0, 0.0, 1.0], **case)
    predicted = pd.DataFrame({"motion": list(ratios), "sum": [2.0, 1.0, 0.4]})
    predicted = predicted.assign(model="gaussian", **case)
    tables = {"planning": planning, "planning_predictions": predicted}
    facts = stage.facts(tables, OPTIONS)

    assert (facts["sure"], facts["pairs"]) == (1, 1)
    assert facts["medians"] == "0.333 (gaussian)"
    assert facts["cells"][0][2:] == [
        "plan of gaussian (100%)",
        "0.5 [0.4, 3.1]",
        "0.5 [0.4, 3.1]",
    ]
