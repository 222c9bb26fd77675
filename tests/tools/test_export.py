"""The reader beside an exported model is one file, needs NumPy alone and gives the project's own
numbers; worked examples run with it: filters, a planner's cost, the covariance of a frame.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import types
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from exported_models import PARAMETERS, write_model
from source_code import ROOT

from pipeline.core.options.dataset import Robot
from pipeline.models import load
from pipeline.models.exported import FORMAT, chain_record
from pipeline.models.other_motions import MotionSteps
from pipeline.tools.export import command
from pipeline.tools.export.reader_file import NAME, reader_source

SEEN = {"least": -7.0, "greatest": 7.0, "unit": "rad"}
PLAIN = {
    "kind": "joint_steps",
    "joints": ["a", "b", "c"],
    "resolution": [1e-7] * 3,
    "floor": [1e-10] * 3,
    "gain": [1e-4] * 3,
    "reach": [0.01, 1e-5, 0.01],
    "degrees": [4.0, None, 6.0],
    "correlation": np.eye(3).tolist(),
}
ALONE = """
import json, sys
class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in "pipeline pydantic pandas scipy numba yaml hydra".split():
            raise AssertionError(name)
sys.meta_path.insert(0, Refused())
import numpy as np
from read_motion_model import load
model = load(sys.argv[1])
q, v = np.array([[0.3, 1.5, -0.4]] * 5), np.array([0.001, -0.001, 0.01])
out = {"mean": model.mean(q, v).tolist(), "repr": repr(model)}
try:
    out["covariance"] = model.covariance(q, v).tolist()
    drawn = model.step(q, v, np.random.default_rng(1))
    out["density"] = model.log_density(q, v, drawn).tolist()
except Exception as error:
    out["refused"] = str(error)
print(json.dumps(out))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("colleague")
    (place / NAME).write_text(reader_source())
    return place


def write_plain(file: Path, chain, **changes) -> Path:
    record = {"format": FORMAT, "model": "scaled_t", "dataset": "bench", "joints": ["a", "b", "c"]}
    record |= {"rate_per_s": 100.0, "parameters": PLAIN | changes, "closed_loop_share": 0.0}
    seen = dict.fromkeys("abc", SEEN)
    record |= {"ranges": {"pose": seen, "joint speed": seen}, "arm": chain_record(chain)}
    file.write_text(json.dumps(record))
    return file


@pytest.mark.parametrize("kind", [*PARAMETERS, "joint_steps", "untold"])
def test_the_copied_reader_gives_the_projects_numbers_by_numpy_alone(kind, folder, chain):
    file = folder / f"{kind}.json"
    if kind in PARAMETERS:
        write_model(file, kind, chain)
    else:
        write_plain(file, chain, **({"gain": [1e-4, None, 1e-4]} if kind == "untold" else {}))
    words = [sys.executable, "-c", ALONE, file.name]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    got, model = json.loads(done.stdout), load(file)
    q, v = np.array([[0.3, 1.5, -0.4]] * 5), np.array([0.001, -0.001, 0.01])
    np.testing.assert_array_equal(got["mean"], model.mean(q, v))
    assert "\n" not in got["repr"] and got["repr"] == repr(model)
    if kind == "untold":
        assert "noise of b at a step of" in got["refused"]
        return
    np.testing.assert_array_equal(got["covariance"], model.covariance(q, v))
    assert np.isfinite(got["density"]).all()


def test_a_joint_step_needs_no_jacobian_and_a_wrong_shape_is_named(folder, chain):
    model = load(write_plain(folder / "steps.json", chain))
    straight, dq = np.array([0.3, chain.straight, -0.4]), np.array([0.01, 0.0, -0.01])
    expected = np.array([2.0, 1.0, 1.5]) * (1e-10 + 1e-14 + 1e-4 * dq**2)
    np.testing.assert_allclose(np.diag(model.covariance_of_joint_step(dq)), expected)
    matrix = load(write_model(folder / "wishart.json", "wishart", chain))
    for call, words in (
        (lambda: model.covariance(straight, np.zeros(3)), "singular"),
        (lambda: model.covariance_of_joint_step(np.zeros(4)), r"dq must have 3 numbers.*\(4,\)"),
        (lambda: model.mean(np.zeros(2), np.zeros(3)), r"q must have 3 numbers.*\(2,\)"),
        (lambda: model.mean(np.zeros(3), np.zeros(6)), r"v must have 3 numbers.*\(6,\)"),
        (lambda: matrix.covariance_of_joint_step(dq), "depends on the pose"),
    ):
        with pytest.raises(Exception, match=words):
            call()
    scaled = load(write_model(folder / "scaled.json", "scaled", chain))
    known = 1e-7 * np.eye(3) + np.diag(0.09 * dq**2)
    np.testing.assert_allclose(scaled.covariance_of_joint_step(dq), known)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("name", "home"), [("ur5", np.zeros(6)), ("lwr4", np.full(7, 0.3))])
def test_a_filter_a_planner_and_a_frame_use_the_model_of_a_real_arm(
    name, home, tmp_path, monkeypatch
):
    kalman = pytest.importorskip("filterpy.kalman", reason="filterpy is missing; `make` has it")
    pinocchio = pytest.importorskip("pinocchio", reason="pinocchio is missing")
    n, urdf = len(home), str(ROOT / f"pipeline/arm/{name}.urdf")
    robot = Robot(urdf=urdf, joints=[f"joint_{j}" for j in range(1, n + 1)], tool="flange")
    motion = SimpleNamespace(rate=125.0, pose_noise=None)
    dataset = SimpleNamespace(name=name, robot=robot, motion=motion)
    settings = SimpleNamespace(dataset=dataset, seed=1, scale=SimpleNamespace(name="smoke"))
    rng = np.random.default_rng(1)
    dq = 6e-3 * np.sin(np.outer(np.arange(4000), 0.01 + 0.003 * np.arange(n)))
    noise = (2e-5 + 0.02 * np.abs(dq)) * rng.standard_normal(dq.shape)
    steps = MotionSteps("1", (home + np.cumsum(dq, axis=0))[None], dq[None], noise[None])
    monkeypatch.setattr(command, "SOURCES", [Path(urdf)])
    file = tmp_path / f"{name}_scaled_all.json"
    command.write_export(command.exported("scaled_all", settings, [steps]), file)
    module = types.ModuleType("read_motion_model")
    monkeypatch.setitem(sys.modules, "read_motion_model", module)
    exec(compile((tmp_path / NAME).read_text(), NAME, "exec"), module.__dict__)
    model = module.load(file)

    # a Kalman filter of filterpy is nearer than the measured joints
    filtered = kalman.KalmanFilter(dim_x=n, dim_z=n, dim_u=n)
    filtered.F = filtered.H = filtered.B = np.eye(n)
    filtered.x, filtered.P = home.copy(), 1e-8 * np.eye(n)
    filtered.R = (5e-4) ** 2 * np.eye(n)
    true, errors, measured = home.copy(), [], []
    for step in dq[:200]:
        Q = model.covariance_of_joint_step(step)
        true = true + step + rng.multivariate_normal(np.zeros(n), Q)
        y = true + 5e-4 * rng.standard_normal(n)
        filtered.predict(u=step, Q=Q)
        filtered.update(y)
        errors.append(filtered.x - true)
        measured.append(y - true)
    assert np.sqrt(np.mean(np.square(errors))) < 0.7 * np.sqrt(np.mean(np.square(measured)))

    # a planner: summed variance of a motion of 0.2 rad of every joint in so many equal steps
    costs = {}
    for count in (40, 80, 160, 640, 2560):
        covariances = model.covariance_of_joint_step(np.full((count, n), 0.2 / count))
        costs[count] = float(np.trace(covariances, axis1=1, axis2=2).sum())
    best = min(costs, key=costs.get)
    assert costs[40] > costs[80] > costs[160] and best not in (40, 2560)

    # the covariance of a frame, J Σ Jᵀ of pinocchio, is that of drawn poses
    arm = pinocchio.buildModelFromUrdf(urdf)
    data, frame, q = arm.createData(), arm.getFrameId("flange"), home + dq[60]
    sigma = model.covariance_of_joint_step(dq[60])
    pinocchio.computeJointJacobians(arm, data, q)
    pinocchio.updateFramePlacements(arm, data)
    world = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = pinocchio.getFrameJacobian(arm, data, frame, world)[:3]
    drawn = np.random.default_rng(3).multivariate_normal(q, sigma, 20_000)
    points, expected = model.chain.pose(drawn)[..., :3], J @ sigma @ J.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.cov(points.T) / scale, expected / scale, atol=0.06)


PAGE = (ROOT / "pipeline/tools/export/README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_readmes_filters_are_nearer_than_measured_and_its_planner_swings_out(
    tmp_path, chain, monkeypatch
):
    pytest.importorskip("filterpy", reason="filterpy is missing; `make` has it")
    write_model(tmp_path / "model.json", "wishart", chain, speed=0.1)
    (tmp_path / NAME).write_text(reader_source())
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "read_motion_model", raising=False)
    known: dict = {}
    for block in BLOCKS:
        exec(block, known)
    errors = {
        name: np.sqrt(np.mean(np.subtract(known[name], known["path"]) ** 2))
        for name in ("measured", "by_ukf", "by_particles")
    }
    assert len(BLOCKS) == 4 and len(known["by_ukf"]) == 60
    assert 0.004 < errors["measured"] < 0.006
    assert max(errors["by_ukf"], errors["by_particles"]) < 0.7 * errors["measured"]
    # the swing is less uncertain than the straight way and than one to the other side
    best, cost = known["best"], known["variance"]
    assert abs(best) > 0.002 and cost(best) < min(cost(0.0), cost(-best))
