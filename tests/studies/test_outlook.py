"""The outlook's laws against draws of literal matrices through Newton's method, its errors against
their definitions, refusals by key, and its page.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import wishart

from pipeline.core.errors import ConfigError, SingularJacobianError
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import validated
from pipeline.studies.outlook import stage
from pipeline.studies.outlook.hexapod import equal_models, platform_covariance, straight
from pipeline.studies.outlook.platform import LEGS, Hexapod, pose_of
from pipeline.studies.outlook.towing import error_rows, lever, recorded_rows, slope_rows
from pipeline.wrench.bounds import Bounds, draw_systems
from pipeline.wrench.matrix import matrix_model
from pipeline.wrench.parametric import wrench_covariance
from pipeline.wrench.study import averaged_sigma_s, variance_errors

SECTION = read_yaml(Path(stage.__file__).with_name("params.yaml"))["paper"]
OPTIONS = validated(stage.Options, SECTION)
START, END = (
    pose_of(np.array(p), np.array(t)) for p, t in zip(OPTIONS.position, OPTIONS.turn, strict=True)
)
ROBOT = Hexapod(
    base=np.array(OPTIONS.base),
    platform=np.array(OPTIONS.platform),
    home=START,
    lower=np.full(LEGS, 0.7),
    upper=np.full(LEGS, 1.2),
    max_speed=np.full(LEGS, np.inf),
    length=OPTIONS.length,
)
MOTION = straight(ROBOT, START, END, 101)
LAWS = equal_models(MOTION, OPTIONS.noise, OPTIONS.bound)
BOUNDS = Bounds(
    *((3.0, 5.0), (np.pi / 4, np.pi), (0.5, 1.0), (100.0, 800.0)),
    elevation=(0.26, 1.3),
    attachment=(-0.25, 0.25),
)


@pytest.mark.parametrize("name", LAWS)
def test_the_noise_of_the_pose_is_that_of_drawn_legs_through_newtons_method(name):
    law, k, draws, rng = LAWS[name], 75, 3000, np.random.default_rng(7)
    assert MOTION.noise_share(law) == pytest.approx(OPTIONS.noise, rel=1e-9)
    q, v, inverse = MOTION.q[k], MOTION.v[k], MOTION.inverse[k]
    if name == "additive":
        steps = inverse @ v + rng.multivariate_normal(np.zeros(6), law.floor, draws)
    elif name == "gaussian":
        # Algorithm 2, literally: J⁻¹ + N
        size = law.alpha * np.sqrt((law.u**2 - np.sum(inverse**2)) / 36)
        steps = (inverse + size * rng.standard_normal((draws, 6, 6))) @ v
    else:
        # Algorithm 1, literally: (J₁BJ₂)⁻¹
        jacobian = np.linalg.inv(inverse)
        first, second = np.linalg.qr(jacobian if name == "qr" else jacobian.T)
        left, right = (first, second) if name == "qr" else (second.T, first.T)
        d = 7 / law.sigma_b**2
        b = wishart(d, np.eye(6) / d, seed=rng).rvs(draws)
        steps = np.linalg.solve(left @ b @ right, np.tile(v, (draws, 1))[..., None])[..., 0]
    pose = ROBOT.pose(q)
    moved = ROBOT.displacement(pose, ROBOT.pose(q + steps, np.broadcast_to(pose, (draws, 12))))
    covariances = platform_covariance(law, MOTION)
    # a variance has a relative standard error of 0.026; the second order is a few percent
    np.testing.assert_allclose(moved.var(axis=0), np.diag(covariances[k]), rtol=0.15)
    # the control: the noise of the legs is not that of the pose
    legs = np.diag(law.covariance(ROBOT, q, v))
    assert not np.allclose(legs, np.diag(covariances[k]), rtol=0.15)
    # under QR of J alone it is the same everywhere
    constant = np.allclose(covariances, covariances[0], rtol=1e-6, atol=1e-15)
    assert constant == (name == "qr")


def test_the_motion_goes_from_start_to_end_in_equal_steps():
    poses = ROBOT.pose(MOTION.q)
    np.testing.assert_allclose(ROBOT.displacement(poses[-1], END), np.zeros(6), atol=1e-9)
    steps = ROBOT.displacement(poses[:-1], poses[1:])
    np.testing.assert_allclose(steps, MOTION.v[1:] * 101 / 100, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"base": [[0.0, 0.0, 0.0]] * 6}, None),
        ({"legs": [0.7, 0.9]}, "legs"),
        ({"noise": 1e-6}, "noise"),
        ({"turn": [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]], "legs": [0.3, 2.0]}, "turn"),
    ],
)
def test_what_is_no_robot_or_motion_is_refused_by_its_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        hexapod_of(replace(OPTIONS, **changes))
    assert refused.value.evidence.get("key") == key
    with pytest.raises(SingularJacobianError, match="1 place"):
        straight(ROBOT, START, pose_of(START[:3], np.array([0.0, 0.0, np.pi / 2])), 5)


def hexapod_of(options):
    """The models of the robot and motion of ``options``."""
    ends = [
        pose_of(np.array(p), np.array(t))
        for p, t in zip(options.position, options.turn, strict=True)
    ]
    lower, upper = (np.full(LEGS, length) for length in options.legs)
    base, platform = np.array(options.base), np.array(options.platform)
    robot = replace(ROBOT, base=base, platform=platform, home=ends[0], lower=lower, upper=upper)
    return equal_models(straight(robot, *ends, 9), options.noise, options.bound)


def test_an_error_is_the_papers_over_the_rows_of_its_part():
    assert lever(BOUNDS) == pytest.approx(0.25)  # a cube's root mean square, half its side
    rows = pd.DataFrame(error_rows(BOUNDS, [5], (100, 50), np.random.default_rng(1)))
    rng = np.random.default_rng(1).spawn(1)[0]
    drawn, fresh = (draw_systems(BOUNDS, n, 5, rng).in_units_of(0.25) for n in (100, 50))
    modelled = matrix_model(fresh).covariance(averaged_sigma_s(drawn)["diagonal"].mean)
    due = wrench_covariance(fresh)
    for part, block in (("forces", slice(3)), ("moments", slice(3, 6))):
        expected = variance_errors(modelled[:, block, block], due[:, block, block]).mean()
        assert rows.set_index("part").loc[part, "variance"] == pytest.approx(expected)


def test_the_slope_of_a_power_law_is_its_power():
    agents, repeat = (grid.ravel() for grid in np.meshgrid([3, 6, 12], range(3)))
    law = pd.DataFrame({"part": "forces", "agents": agents, "repeat": repeat})
    law = law.assign(variance=(1 + repeat) * agents**-0.5, covariance=agents**-0.25)
    rows = slope_rows(law)
    np.testing.assert_allclose(
        rows[["slope", "low", "high"]], [[-0.5] * 3, [-0.25] * 3], atol=1e-12
    )


def test_errors_fall_with_the_cables_and_recorded_directions_reduce_them():
    rows = [
        row | {"repeat": repeat}
        for repeat in range(2)
        for row in error_rows(BOUNDS, [3, 6, 12, 24], (200, 300), np.random.default_rng(repeat))
    ]
    slopes = slope_rows(pd.DataFrame(rows))["slope"]
    assert np.all((slopes > -0.65) & (slopes < -0.35))
    known = pd.DataFrame(recorded_rows(BOUNDS, 6, (200, 8, 400), np.random.default_rng(3)))
    errors = known.pivot(index="part", columns="known", values="error")
    assert np.all(errors["directions"] < 0.7 * errors["bounds"])


def test_the_study_writes_its_page(project):
    stage.run()
    page = Path("reports/studies/outlook.md").read_text()
    motion = pd.read_csv("reports/studies/outlook/hexapod.csv").groupby("model")["rotation"]
    growth = (motion.last() / motion.first())["qr_transposed"]
    assert f"{growth:.3g} with the Wishart model under QR of Jᵀ" in page
    assert "nan" not in page and Path("reports/studies/outlook/outlook.svg").is_file()
