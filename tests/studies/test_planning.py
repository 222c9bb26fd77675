"""Steps have the paper's constraint with the duration; a plan keeps its limits and has the least
sum of all starts; sums are variances of the takes, with equal draws for every motion.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
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
    columns = []
    for direction in np.eye(len(q)):
        ends = (
            task.chain.pose(q + step * direction),
            task.chain.pose(q - step * direction),
        )
        columns.append(task.chain.displacement(ends[1], ends[0]) / (2 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("arm", ARMS)
def test_a_step_is_the_inverse_jacobian_times_velocity_and_duration(arm):
    task = path_task(arm, 50)
    q = feasible_motions(task, 64)[0]
    speed = np.diff(q, axis=0) * task.rate
    for k in (10, 30):
        velocity = task.rate * task.chain.displacement(
            task.chain.pose(q[k]),
            task.path[k + 1],
        )
        expected = np.linalg.pinv(numerical_jacobian(task, q[k])) @ velocity
        assert_allclose(speed[k], expected, rtol=1e-5, atol=1e-7)
        # the control: the printed constraint, without the duration
        step = q[k + 1] - q[k]
        assert np.linalg.norm(step - expected) > 0.9 * np.linalg.norm(expected)

    # half the duration of a step leaves a quarter of the distance from the path
    coarse = np.abs(task.chain.displacement(task.chain.pose(q), task.path)).max()
    finer = path_task(arm, 100)
    (fine,) = motions_from(finer, q[:1])
    off = np.abs(finer.chain.displacement(finer.chain.pose(fine), finer.path)).max()

    assert off == pytest.approx(coarse / 4, rel=0.1)


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


@pytest.mark.parametrize("law", LAWS)
def test_a_plan_keeps_its_limits_and_has_the_least_sum_of_all_starts(law):
    task = path_task("planar", 40)
    model = build_model(LAWS[law])
    plan = least_uncertain(model, task, feasible_motions(task, 1024))
    assert task.chain.within_limits(plan).all()
    assert np.all(np.abs(np.diff(plan, axis=0)) * task.rate <= task.chain.max_speed)

    least = np.linalg.svd(task.chain.jacobian(plan), compute_uv=False)[:, -1]
    assert least.min() >= task.margin

    # the independent check: starts that the arm reaches from the path's own by self-motion
    starts = starts_by_self_motion(task, np.array(ARMS["planar"][1]))
    off = task.chain.displacement(task.chain.pose(starts), task.path[0])
    assert np.abs(off).max() < 1e-6

    motions = motions_from(task, starts)
    sums = summed_variance(model, task, motions[feasible(task, motions)])
    assert summed_variance(model, task, plan[None])[0] < sums.min() * 1.01
    assert sums.max() > 1.02 * sums.min()


def test_a_path_without_a_motion_in_the_limits_is_refused():
    task = path_task("planar", 20)
    for changes in ({"margin": 5.0}, {"rate": 1e5}):
        with pytest.raises(
            ConfigError,
            match="no start has a motion within the limits",
        ):
            feasible_motions(replace(task, **changes), 64)


@pytest.fixture(scope="module")
def bench() -> Bench:
    """Return the youBot at 200 steps of the servo a second."""
    whole = bench_of("youbot", "timing", OPTIONS, seed=1)
    return replace(whole, dynamics=replace(whole.dynamics, rate=200.0), takes=6)


def test_takes_of_a_motion_are_those_that_the_laboratory_performs(bench):
    steps = bench.recorded_steps(bench.recorded, "take")
    motion = JointPath(bench.recorded, bench.task.rate)
    stream = rng.stream(1, "planning.session")
    session = open_session(bench.built, bench.dynamics, stream)
    take = perform(session, motion, bench.dynamics, rng.stream(1, "planning.take", 2))

    assert_array_equal(steps.q[2], take.motion_capture[:-1])

    # other motions have equal draws, training takes have others
    training = bench.recorded_steps(bench.recorded, "training")
    assert np.abs(training.q - steps.q).max() > 1e-4
    with pytest.raises(ConfigError, match="joint limits"):
        bench.recorded_steps(bench.recorded + 3.0, "take")


def test_sums_are_the_variances_of_the_takes_resampled_or_not(bench):
    generator = np.random.default_rng(1)
    choices = [np.arange(6), generator.integers(6, size=6), np.array([3, 3, 5])]
    noise = bench.recorded_steps(bench.recorded, "take").noise
    sums = stage.realised_sums(noise, choices)
    for takes, value in zip(choices, sums, strict=True):
        assert value == pytest.approx(noise[takes].var(axis=0, ddof=1).sum(), rel=1e-9)


def test_orders_agree_in_part():
    realised = [1.0, 2.0, 3.0, 4.0]

    def tau(predicted: list[float]) -> float:
        return stage.agreement(
            pd.DataFrame({"predicted": predicted, "ratio": realised[: len(predicted)]}),
        )

    assert tau(realised) == 1.0
    assert tau([2.5, 2.0, 3.0, 4.0]) == pytest.approx(1 - 2 / 6)
    assert np.isnan(tau([1.0, 2.0]))


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
