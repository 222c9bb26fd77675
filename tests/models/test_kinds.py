"""Motion models from the parameters that a fit wrote."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.errors import ConfigError, ContractError, ModelDomainError
from pipeline.models import kinds

MALFORMED = [
    *(None, "{", "[]", '{"kind": "laplace"}', '{"kind": "gaussian", "alpha": 0.1}'),
    '{"kind": "gaussian", "alpha": "low", "u": 20.0}',
    '{"kind": "additive", "noise_covariance": [[1.0, 2.0], [3.0]]}',
]
OUTSIDE = {
    "sigma_B without a density": {"kind": "wishart", "sigma_b": 2.0, "decomposition": "qr"},
    "no sigma_B": {"kind": "wishart", "sigma_b": float("nan"), "decomposition": "qr"},
    "J1 of two rows": {"kind": "wishart", "sigma_b": 0.2, "decomposition": "given"}
    | {"left": np.eye(2).tolist()},
    "alpha": {"kind": "gaussian", "alpha": -0.1, "u": 20.0},
    "asymmetric": {"kind": "additive", "noise_covariance": [[1.0, 2.0], [3.0, 4.0]]},
    "two joints": {"kind": "additive", "noise_covariance": np.eye(2).tolist()},
    "negative": {"kind": "scaled", "floor": np.eye(3).tolist(), "gain": (-np.eye(3)).tolist()},
}


@pytest.mark.parametrize("text", MALFORMED)
def test_malformed_and_missing_parameters_are_refused(text, tmp_path):
    if text is not None:
        (tmp_path / "parameters.json").write_text(text)
    with pytest.raises(ContractError, match=r"parameters.*run the stage fit") as refused:
        kinds.fitted_model(tmp_path)
    assert refused.value.evidence["file"] == tmp_path / "parameters.json"


@pytest.mark.parametrize("name", OUTSIDE)
def test_parameters_outside_the_models_range_are_refused(name, chain):
    with pytest.raises(ModelDomainError):
        kinds.build_model(OUTSIDE[name]).law(chain)


def test_the_level_of_an_unbounded_gaussian_model_is_its_limit(chain, poses, step):
    def variance(**parameters: float) -> np.ndarray:
        model = kinds.build_model({"kind": "gaussian", **parameters})
        return model.covariance(chain, poses, step)[:, 0, 0]

    np.testing.assert_allclose(variance(level=2.0), variance(alpha=1e-6, u=2e6), rtol=1e-9)
    # control: another level
    assert np.all(variance(level=2.1) > 1.05 * variance(level=2.0))


def test_a_kind_without_a_folder_is_refused_by_name():
    with pytest.raises(ConfigError, match="no kind 'tiny'; there are additive, gaussian"):
        kinds.options_type("tiny")
