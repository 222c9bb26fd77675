"""The hexapod's worked example: laws held against draws of literal matrices through Newton's
method, the wrench as the dual, refusals by key, and a page that follows its tables.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf
from scipy.stats import wishart

from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError, SingularJacobianError
from pipeline.core.typed_yaml import load_yaml, typed
from pipeline.studies.hexapod import stage
from pipeline.studies.hexapod.figures import hexapod_motion, hexapod_wrench
from pipeline.studies.hexapod.load import legs_of, wrench_rows
from pipeline.studies.hexapod.motion import (
    MODELS,
    leg_spread,
    models_of,
    platform_covariance,
    straight,
)
from pipeline.studies.hexapod.options import Load, Options, Pose
from pipeline.studies.hexapod.words import motion_answer, wrench_answer
from pipeline.wrench.directions import sample_directions
from pipeline.wrench.parametric import wrench_covariance

ROOT = Path(__file__).parents[3]
SECTION = load_yaml(stage.HERE / "params.yaml").smoke
OPTIONS = replace(OmegaConf.to_object(typed(Options, SECTION, "smoke")), places=5)
ROBOT = OPTIONS.hexapod()
MOTION = straight(ROBOT, OPTIONS.start, OPTIONS.end, OPTIONS.places)
LAWS = models_of(MOTION, OPTIONS)


@pytest.fixture(scope="module")
def worked():
    return stage.worked(OPTIONS)


def test_the_motion_goes_from_start_to_end_in_equal_steps():
    np.testing.assert_allclose(MOTION.pose[0], OPTIONS.start.vector(), atol=1e-14)
    np.testing.assert_allclose(MOTION.pose[-1], OPTIONS.end.vector(), atol=1e-14)
    steps = ROBOT.displacement(MOTION.pose[:-1], MOTION.pose[1:])
    np.testing.assert_allclose(steps, MOTION.v[1:] * 5 / 4, atol=1e-14)


@pytest.mark.parametrize("name", MODELS)
def test_every_model_gives_the_legs_the_same_noise(name):
    assert leg_spread(LAWS[name], MOTION) == pytest.approx(OPTIONS.noise, rel=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_the_noise_of_the_pose_is_that_of_drawn_legs_through_newtons_method(name):
    k, draws, rng = 75, 3000, np.random.default_rng(7)
    # the steps of the study: of much longer ones the noise is far beyond first order
    motion = straight(ROBOT, OPTIONS.start, OPTIONS.end, 101)
    law, q, v = models_of(motion, OPTIONS)[name], motion.q[k], motion.v[k]
    inverse = ROBOT.inverse_at(motion.pose[k])
    if name == "additive":
        steps = inverse @ v + rng.multivariate_normal(np.zeros(6), law.noise_covariance, draws)
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
    start = np.broadcast_to(motion.pose[k], (draws, 12))
    moved = ROBOT.displacement(motion.pose[k], ROBOT.pose(q + steps, start))
    expected = platform_covariance(law, motion)[k]
    # a variance has a relative standard error of 0.026; the second order is a few percent
    np.testing.assert_allclose(moved.var(axis=0), np.diag(expected), rtol=0.15)
    # the control: the noise of the legs is not that of the pose
    legs = law.covariance(ROBOT, q, v)
    assert not np.allclose(np.diag(legs), np.diag(expected), rtol=0.15)


def test_with_qr_of_j_the_noise_of_the_pose_is_the_same_everywhere_and_with_no_other():
    for name in MODELS:
        covariance = platform_covariance(LAWS[name], MOTION)
        same = np.allclose(covariance, covariance[0], rtol=1e-6, atol=1e-15)
        assert same == (name == "qr"), name


def test_the_static_jacobian_is_the_duals_and_its_thrusts_hold_the_load():
    options = replace(OPTIONS, load=Load([10.0, -5.0, 200.0], [3.0, 2.0, -1.0]))
    system = legs_of(MOTION, options)
    np.testing.assert_allclose(
        system.jacobian(), np.swapaxes(ROBOT.inverse_at(MOTION.pose), -1, -2), atol=1e-14
    )
    wrench = np.matvec(system.jacobian(), system.tension)
    np.testing.assert_allclose(wrench[:, :3], [[10.0, -5.0, 200.0]] * 5, atol=1e-10)
    np.testing.assert_allclose(wrench[:, 3:] * ROBOT.length, [[3.0, 2.0, -1.0]] * 5, atol=1e-10)
    assert system.tension.min() < 0 < system.tension.max()  # legs push and pull


def test_the_covariance_of_the_wrench_is_that_of_drawn_thrusts_and_directions():
    system, k, draws, rng = legs_of(MOTION, OPTIONS), 4, 20000, np.random.default_rng(3)
    thrust = rng.normal(system.tension[k], system.tension_sd[k], (draws, 6))
    e = sample_directions(system.direction[k], system.concentration[k], draws, rng)
    forces = thrust[..., None] * e
    moments = np.cross(ROBOT.arms(MOTION.pose[k]), forces) / ROBOT.length
    drawn = np.concatenate([forces, moments], axis=-1).sum(axis=1)
    exact = wrench_covariance(system)[k]
    size = np.sqrt(np.diag(exact))
    # correlations have a standard error of at most 0.007, variances a relative one of 0.01
    difference = (np.cov(drawn, rowvar=False) - exact) / np.outer(size, size)
    assert np.abs(difference).max() < 0.05
    table, matrix = wrench_rows(system, np.linspace(0, 1, 5))
    np.testing.assert_allclose(table["exact"].to_numpy()[-6:], size, rtol=1e-12)
    assert matrix.diagonal.shape == (6,) and np.all(matrix.diagonal > 0)
    modelled = table.pivot(index="place", columns="row", values="matrix").to_numpy() ** 2
    due = table.pivot(index="place", columns="row", values="exact").to_numpy() ** 2
    errors = np.linalg.norm(modelled - due, axis=1) / np.linalg.norm(due, axis=1)
    np.testing.assert_allclose(matrix.errors, errors, rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"base": [[0.0, 0.0, 0.0]] * 5}, "base"),
        ({"home": Pose([0.0, 0.0], [0.0, 0.0, 0.0])}, "home.position"),
        ({"load": Load([0.0, 0.0, np.nan], [0.0, 0.0, 0.0])}, "load.force"),
        ({"legs": [1.2, 0.7]}, "legs"),
        ({"legs": [0.7, 0.9]}, "legs"),
        ({"length": 0.0}, "length"),
        ({"bound": 1.0}, "bound"),
        ({"noise": 0.0}, "noise"),
        ({"noise": 1e-6}, "noise"),
        ({"end": Pose([0.0, 0.0, 0.7], [0.0, 0.0, 2.0])}, "end"),
    ],
)
def test_what_is_no_robot_or_motion_is_refused_by_its_key(changes, key):
    with pytest.raises(ConfigError) as refused:
        stage.worked(replace(OPTIONS, **changes))
    assert refused.value.evidence["key"] == key


def test_a_motion_onto_a_singular_pose_is_refused_with_its_place():
    end = Pose([0.0, 0.0, 0.7], [0.0, 0.0, np.pi / 2])
    with pytest.raises(SingularJacobianError, match="1 place") as refused:
        straight(ROBOT, OPTIONS.start, end, 5)
    assert refused.value.evidence["index"] == (4,)


def test_the_page_says_what_the_tables_do(worked):
    tables, facts = worked
    rows = tables["hexapod_motion"]
    assert max(facts.reached.values()) < 1e-9
    text = motion_answer(rows, facts)
    own = rows[rows["model"] == "qr_transposed"]["rotation"]
    assert f"with QR of Jᵀ {own.max() / own.min():.3g} times" in text
    assert "changes by a factor of 1." in text.splitlines()[-1]
    # an answer follows its table
    assert motion_answer(rows.assign(rotation=rows["rotation"] ** 2), facts) != text
    wrench = tables["hexapod_wrench"]
    text = wrench_answer(wrench, tables["hexapod_thrust"], facts)
    assert f"{100 * facts.matrix.errors.max():.3g} % at most" in text
    least = tables["hexapod_thrust"]["thrust"].min()
    assert f"from {least:.3g} N" in text
    assert wrench_answer(wrench, 2 * tables["hexapod_thrust"], facts) != text


def test_the_figures_draw_a_line_a_model_six_legs_and_the_rows_of_the_wrench(worked):
    tables, _ = worked
    names = ("hexapod_legs", "hexapod_motion", "hexapod_density")
    robot, position, rotation, density = hexapod_motion.draw(*(tables[n] for n in names)).axes
    assert len(robot.lines) == 12 and len(robot.patches) == 4
    rows = tables["hexapod_motion"]
    for axes, column in ((position, "position"), (rotation, "rotation")):
        for line, name in zip(axes.lines, hexapod_motion.LINES, strict=True):
            expected = 1e3 * rows[rows["model"] == name][column]
            np.testing.assert_array_equal(line.get_ydata(), expected)
    assert len(density.lines) == len(MODELS)
    names = ("hexapod_thrust", "hexapod_wrench")
    thrusts, force, moment = hexapod_wrench.draw(*(tables[n] for n in names)).axes
    assert len(thrusts.lines) == 7 and len(force.lines) == len(moment.lines) == 6


@pytest.mark.slow
def test_the_stage_writes_its_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("pipeline", "dvc.yaml", "data/raw"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).symlink_to(ROOT / name)
    params = (ROOT / "params.yaml").read_text().replace("scale: paper", "scale: smoke")
    Path("params.yaml").write_text(params.replace("compute: local", "compute: serial"))
    config.write_config(Path("params.yaml"))
    stage.run()
    rows = contracts.read("hexapod_motion", stage.OUT, stage.HERE / "tables.yaml")
    assert set(rows["model"]) == set(MODELS)
    page = Path("reports/studies/hexapod.md").read_text()
    assert "(hexapod/figures/hexapod_motion.png)" in page
    assert "(hexapod/figures/hexapod_wrench.png)" in page
