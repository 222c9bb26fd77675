"""Motion models from the parameters that a fit wrote."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pipeline.errors import ContractError, ModelDomainError
from pipeline.motion.build import fitted_model
from pipeline.motion.gaussian_forward import GaussianForwardModel

PARAMETERS = {
    "additive": {"noise_covariance": [[3e-5, -2e-5, 0.0], [-2e-5, 4e-5, 0.0], [0.0, 0.0, 9e-5]]},
    "wishart": {"sigma_b": 0.2, "decomposition": "qr"},
    "gaussian": {"alpha": 0.15, "u": 20.0},
    "scaled": {
        "floor": [[3e-6, 0.0, 0.0], [0.0, 4e-6, 0.0], [0.0, 0.0, 9e-6]],
        "gain": [[0.04, 0.04, 0.0], [0.04, 0.04, 0.0], [0.0, 0.0, 0.1]],
    },
    "student": {"nu": 3.5, "scale": [[3e-5, -2e-5, 0.0], [-2e-5, 4e-5, 0.0], [0.0, 0.0, 9e-5]]},
}


@pytest.mark.parametrize("kind", PARAMETERS)
def test_a_model_has_the_parameters_that_were_written(kind, tmp_path):
    (tmp_path / "parameters.json").write_text(json.dumps({"kind": kind} | PARAMETERS[kind]))
    model = fitted_model(tmp_path)
    assert type(model).__name__ == f"{kind.capitalize()}Model"
    for name, value in PARAMETERS[kind].items():
        assert np.array_equal(getattr(model, name), value)


def test_a_given_first_factor_and_the_forward_form_come_back(tmp_path):
    left = [[0.15, 0.0, 0.0], [0.0, 0.15, 0.0], [0.0, 0.0, 1.0]]
    (tmp_path / "parameters.json").write_text(json.dumps({"kind": "wishart", "sigma_b": 0.2, "decomposition": "given", "left": left}))
    assert np.array_equal(fitted_model(tmp_path).decomposition, left)
    (tmp_path / "parameters.json").write_text(json.dumps({"kind": "gaussian", "form": "forward", "alpha": 0.1, "u": 2.0}))
    assert fitted_model(tmp_path) == GaussianForwardModel(0.1, 2.0)


def test_parameters_that_were_not_written_are_refused(tmp_path):
    with pytest.raises(ContractError, match="run the stage fit") as refused:
        fitted_model(tmp_path)
    assert refused.value.evidence["file"] == tmp_path / "parameters.json"


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "3", "null", "{}", '{"kind": "laplace"}', '{"kind": "gaussian", "alpha": 0.1}', '{"alpha": 0.1, "u": 20.0}',
        '{"kind": "gaussian", "alpha": "low", "u": 20.0}', '{"kind": "gaussian", "alpha": null, "u": 20.0}',
        '{"kind": "wishart", "sigma_b": "low", "decomposition": "lu"}', '{"kind": "wishart", "sigma_b": [0.2], "decomposition": "lu"}',
        '{"kind": "scaled", "floor": [[1.0]]}', '{"kind": "student", "nu": "few", "scale": [[1.0]]}', '{"kind": "student", "nu": 3.0}',
        '{"kind": "additive", "noise_covariance": [[1.0, 2.0], [3.0]]}', '{"kind": "additive", "noise_covariance": "large"}',
    ],
)  # fmt: skip
def test_malformed_parameters_are_refused(text, tmp_path):
    (tmp_path / "parameters.json").write_text(text)
    with pytest.raises(ContractError, match="parameters") as refused:
        fitted_model(tmp_path)
    assert refused.value.evidence["file"] == tmp_path / "parameters.json"


@pytest.mark.parametrize(
    "parameters",
    [
        {"kind": "wishart", "sigma_b": 2.0, "decomposition": "lu"},
        {"kind": "wishart", "sigma_b": float("nan"), "decomposition": "lu"},
        {"kind": "wishart", "sigma_b": 0.2, "decomposition": "svd"},
        {"kind": "wishart", "sigma_b": 0.2, "decomposition": "given"},
        {"kind": "wishart", "sigma_b": 0.2, "decomposition": "given", "left": [[1.0, 0.0], [0.0, 1.0]]},
        {"kind": "gaussian", "form": "forward", "alpha": -0.1, "u": 2.0},
        {"kind": "gaussian", "alpha": -0.1, "u": 20.0},
        {"kind": "gaussian", "alpha": 0.1, "u": float("inf")},
        {"kind": "additive", "noise_covariance": [[1.0, 2.0], [3.0, 4.0]]},
        {"kind": "additive", "noise_covariance": None},
        {"kind": "scaled", "floor": [[1.0]], "gain": [[1.0]]},
        {"kind": "scaled", "floor": np.eye(3).tolist(), "gain": (-np.eye(3)).tolist()},
        {"kind": "student", "nu": 0.0, "scale": np.eye(3).tolist()},
        {"kind": "student", "nu": 3.0, "scale": (-np.eye(3)).tolist()},
    ],
)
def test_parameters_outside_the_models_range_are_refused(parameters, tmp_path):
    (tmp_path / "parameters.json").write_text(json.dumps(parameters))
    with pytest.raises(ModelDomainError):
        fitted_model(tmp_path)
