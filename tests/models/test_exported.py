"""An exported model is the fitted one, needs NumPy alone, and warns once, by name, of what it was
not fitted to.
"""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from exported_models import PARAMETERS, write_model

from pipeline.core.errors import ContractError
from pipeline.models import load
from pipeline.models.exported import OutsideRanges

ROOT = Path(__file__).parents[2]
# NumPy is what stays of the environment
FORBIDDEN = "dvc hydra omegaconf numba llvmlite pandas pinocchio scipy yaml matplotlib".split()
ALONE = f"""
import sys, time
class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {FORBIDDEN}:
            raise AssertionError(name)
sys.meta_path.insert(0, Refused())
begun = time.process_time()  # of the processor: other tests run beside
import numpy as np
from pipeline.models import load
model = load(sys.argv[1])
took = time.process_time() - begun
q, v = np.array([[0.3, 1.5, -0.4]] * 5), np.array([0.001, -0.001, 0.01])
rng = np.random.default_rng(1)
q_next = model.step(q, v, rng)
assert model.sample(q, v, 7, rng).shape == (7, 5, 3)
assert model.covariance(q, v).shape == (5, 3, 3)
assert np.isfinite(model.log_density(q, v, q_next)).all()
assert model.command(q, v, model.chain.pose(model.mean(q, v))).shape == (5, 3)
print(took)
"""


@pytest.fixture(params=PARAMETERS)
def file(request, tmp_path, chain) -> Path:
    return write_model(tmp_path / "model.json", request.param, chain)


def test_it_is_taken_up_in_less_than_a_second_by_numpy_alone(file):
    done = subprocess.run(
        [sys.executable, "-c", ALONE, file], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 1.0
    # the control: what the fits need is refused
    fits = ALONE.replace("from pipeline.models import load", "import pipeline.models.draws")
    done = subprocess.run([sys.executable, "-c", fits, file], cwd=ROOT, capture_output=True)
    assert b"AssertionError: numba" in done.stderr


def test_a_closed_loop_corrects_its_share_of_the_way_to_the_target(tmp_path, chain, poses, step):
    model = load(write_model(tmp_path / "model.json", "additive", chain, share=0.25))
    target = chain.pose(poses[0])
    off = chain.displacement(chain.pose(poses), target)
    np.testing.assert_allclose(model.command(poses, step, target), step + 0.25 * off)
    opened = load(write_model(tmp_path / "open.json", "additive", chain))
    assert np.array_equal(opened.command(poses, step, target), np.tile(step, (len(poses), 1)))


def test_it_warns_once_by_name_beyond_what_was_fitted_and_not_within(tmp_path, chain):
    model = load(write_model(tmp_path / "model.json", "scaled", chain, width=0.5))
    q, v = np.array([0.3, 1.5, -0.4]), np.array([0.001, 0.001, 0.01])
    bent = np.array([0.3, 2.4, -0.4])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.mean(q, v)
    with pytest.warns(OutsideRanges, match=r"pose of b: 2\.4 rad is outside 1\.071 to 2\.071"):
        model.mean(bent, v)
    with pytest.warns(OutsideRanges, match=r"speed of phi: 5 rad/s is outside -4 to 4"):
        model.step(q, v * 5, np.random.default_rng(1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.covariance(bent, v * 5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "JSONDecodeError"),
        ('{"kind": "additive"}', "KeyError"),
        ('{"format": "motion model 0"}', "motion model 0"),
    ],
)
def test_another_file_is_refused_by_its_name(tmp_path, text, words):
    (tmp_path / "other.json").write_text(text)
    with pytest.raises(ContractError, match=words) as refused:
        load(tmp_path / "other.json")
    assert refused.value.evidence["file"] == tmp_path / "other.json"
