"""Motion models from the parameters that a fit wrote, and a kind that is a folder and no more."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

import pipeline.models
from pipeline.core import config
from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.models import kinds
from pipeline.models.draws import draw_steps
from pipeline.models.steps import Recorded

ROOT = Path(__file__).parents[2]
LEFT = np.diag([0.15, 0.15, 1.0]).tolist()
PARAMETERS = {
    "additive": {"noise_covariance": [[3e-5, -2e-5, 0.0], [-2e-5, 4e-5, 0.0], [0.0, 0.0, 9e-5]]},
    "wishart": {"sigma_b": 0.2, "decomposition": "given", "left": LEFT},
    "gaussian": {"alpha": 0.15, "u": 20.0},
    "scaled": {"floor": (4e-6 * np.eye(3)).tolist(), "gain": np.full((3, 3), 0.04).tolist()},
}


@pytest.mark.parametrize(
    "text",
    [
        None,
        "",
        "{",
        "[]",
        "null",
        '{"kind": "laplace"}',
        '{"kind": "gaussian", "alpha": 0.1}',
        '{"kind": "gaussian", "alpha": "low", "u": 20.0}',
        '{"kind": "wishart", "sigma_b": [0.2], "decomposition": "pivoted_lu"}',
        '{"kind": "scaled", "floor": [[1.0]]}',
        '{"kind": "additive", "noise_covariance": [[1.0, 2.0], [3.0]]}',
    ],
)
def test_malformed_and_missing_parameters_are_refused(text, tmp_path):
    if text is not None:
        (tmp_path / "parameters.json").write_text(text)
    with pytest.raises(ContractError, match=r"parameters.*run the stage fit") as refused:
        kinds.fitted_model(tmp_path)
    assert refused.value.evidence["file"] == tmp_path / "parameters.json"


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("wishart", {"sigma_b": 2.0, "decomposition": "pivoted_lu"}),
        ("wishart", {"sigma_b": float("nan"), "decomposition": "pivoted_lu"}),
        ("wishart", {"sigma_b": 0.2, "decomposition": "given", "left": np.eye(2).tolist()}),
        ("gaussian", {"alpha": -0.1, "u": 20.0}),
        ("gaussian", {"alpha": 0.1, "u": float("inf")}),
        ("additive", {"noise_covariance": [[1.0, 2.0], [3.0, 4.0]]}),
        ("additive", {"noise_covariance": np.eye(2).tolist()}),
        ("scaled", {"floor": np.eye(3).tolist(), "gain": (-np.eye(3)).tolist()}),
    ],
)
def test_parameters_outside_the_models_range_are_refused(kind, parameters, chain):
    with pytest.raises(ModelDomainError):
        kinds.build_model({"kind": kind} | parameters).law(chain)


def test_the_level_of_an_unbounded_gaussian_model_is_its_limit(chain, poses, step):
    def variance(**parameters: float) -> np.ndarray:
        model = kinds.build_model({"kind": "gaussian", **parameters})
        return model.covariance(chain, poses, step)[:, 0, 0]

    np.testing.assert_allclose(variance(level=2.0), variance(alpha=1e-6, u=2e6), rtol=1e-9)
    # control: another level
    assert np.all(variance(level=2.1) > 1.05 * variance(level=2.0))


LAW = """
import numpy as np
from pipeline.models.scaled.law import ScaledModel

def build(parameters):
    return ScaledModel(np.array(parameters["std"]) ** 2 * np.eye(3))
"""
FIT = """
from pipeline.core import validation
from pipeline.models import options as base
from pipeline.models.steps import Estimate, Truth

@validation.options(kw_only=True)
class Options(base.Options):
    std: float = 0.0

def estimate(recorded, options):
    std = options.std or float(recorded.noise.std())
    return Estimate({"kind": "tiny", "std": std}, {"std_rad": std}, {})

def truths(recorded, options, dispersions):
    return [Truth("tiny", {"kind": "tiny", "std": 0.01}, {"std_rad": 0.01})]
"""


@pytest.fixture
def tiny(tmp_path, monkeypatch) -> None:
    """A model that is a folder and nothing else."""
    (tmp_path / "tiny").mkdir()
    for name, text in (("__init__", ""), ("law", LAW), ("fit", FIT)):
        (tmp_path / "tiny" / f"{name}.py").write_text(text)
    monkeypatch.setattr(pipeline.models, "__path__", [*pipeline.models.__path__, str(tmp_path)])
    yield
    for name in [name for name in sys.modules if name.startswith("pipeline.models.tiny")]:
        del sys.modules[name]


def test_a_folder_is_a_model_that_is_found_composed_fitted_and_drawn_from(
    tiny, tmp_path, monkeypatch, chain, poses, step
):
    shutil.copytree(config.CONF, tmp_path / "conf")
    (tmp_path / "conf/model/tiny.yaml").write_text("kind: tiny\nlabel: a tiny model\n")
    params = OmegaConf.load(ROOT / "params.yaml")
    params.models = ["additive", "tiny"]
    OmegaConf.save(params, tmp_path / "params.yaml")
    monkeypatch.setattr(config, "CONF", tmp_path / "conf")
    composed = config.compose_config(tmp_path / "params.yaml").models["tiny"]
    requested = kinds.options_type("tiny")(kind="tiny", label=composed.label)
    assert composed.label == "a tiny model"

    rng = np.random.default_rng(1)
    noise = 0.01 * rng.standard_normal((40, 20, 3))
    q, v = np.broadcast_to(poses[:20], noise.shape), np.tile(step, (20, 1))
    recorded = Recorded(chain, q, v, noise, ("a", "b", "c"), 1e-6 * np.eye(3))
    found = kinds.estimate(recorded, requested).estimates["std_rad"]
    assert found == pytest.approx(0.01, rel=0.05)
    (truth,) = kinds.truths(recorded, requested, [])
    (tmp_path / "parameters.json").write_text(json.dumps(truth.parameters))
    model = kinds.fitted_model(tmp_path)
    moved, _ = draw_steps(model, chain, np.tile(poses[0], (2000, 1)), step, rng)
    np.testing.assert_allclose(moved.var(axis=0), 1e-4, rtol=0.15)


@pytest.mark.slow
def test_options_and_plain_fits_load_no_compiler():
    program = (
        "import sys; from pipeline.models import kinds; [*map(kinds.options_type, kinds.kinds())]; "
        "sys.exit('numba' in sys.modules or 'cvxpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False).returncode == 0
