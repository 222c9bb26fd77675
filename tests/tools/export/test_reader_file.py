"""The reader beside an exported model is one file, needs NumPy alone and gives the project's own
numbers for every kind of model.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exported_models import PARAMETERS, write_model

from pipeline.models import load
from pipeline.models.exported import FORMAT, chain_record
from pipeline.tools.export.reader_file import NAME, reader_source

SEEN = {"least": -7.0, "greatest": 7.0, "unit": "rad"}
PLAIN = {
    "kind": "joint_steps",
    "joints": ["a", "b", "c"],
    "resolution": [1e-7] * 3,
    "floor": [1e-10] * 3,
    "gain": [1e-4, None, 1e-4],
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
    record = {
        "format": FORMAT,
        "model": "scaled_t",
        "dataset": "bench",
        "joints": ["a", "b", "c"],
        "rate_per_s": 100.0,
        "parameters": PLAIN | changes,
        "closed_loop_share": 0.0,
        "ranges": {"pose": dict.fromkeys("abc", SEEN), "joint speed": dict.fromkeys("abc", SEEN)},
        "arm": chain_record(chain),
    }
    file.write_text(json.dumps(record))
    return file


@pytest.mark.parametrize("kind", [*PARAMETERS, "joint_steps", "untold"])
def test_the_copied_reader_gives_the_projects_numbers_by_numpy_alone(kind, folder, chain):
    file = folder / f"{kind}.json"
    if kind in PARAMETERS:
        write_model(file, kind, chain)
    else:
        write_plain(file, chain, **({} if kind == "untold" else {"gain": [1e-4] * 3}))
    done = subprocess.run(
        [sys.executable, "-c", ALONE, file.name], cwd=folder, capture_output=True, text=True
    )
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
    model = load(write_plain(folder / "steps.json", chain, gain=[1e-4] * 3))
    straight = np.array([0.3, chain.straight, -0.4])
    dq = np.array([0.01, 0.0, -0.01])
    with pytest.raises(Exception, match="singular"):
        model.covariance(straight, np.zeros(3))
    expected = np.array([2.0, 1.0, 1.5]) * (1e-10 + 1e-14 + 1e-4 * dq**2)
    np.testing.assert_allclose(np.diag(model.covariance_of_joint_step(dq)), expected)
    for call, words in (
        (lambda: model.covariance_of_joint_step(np.zeros(4)), r"dq must have 3 numbers.*\(4,\)"),
        (lambda: model.mean(np.zeros(2), np.zeros(3)), r"q must have 3 numbers.*\(2,\)"),
        (lambda: model.mean(np.zeros(3), np.zeros(6)), r"v must have 3 numbers.*\(6,\)"),
    ):
        with pytest.raises(Exception, match=words):
            call()
    matrix = load(write_model(folder / "wishart.json", "wishart", chain))
    with pytest.raises(Exception, match="depends on the pose"):
        matrix.covariance_of_joint_step(dq)
    scaled = load(write_model(folder / "scaled.json", "scaled", chain))
    np.testing.assert_allclose(
        scaled.covariance_of_joint_step(dq), 1e-7 * np.eye(3) + np.diag(0.09 * dq**2)
    )
