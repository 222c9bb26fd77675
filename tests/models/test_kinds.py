"""Motion models from the files of a fit or an export; an exported model warns once, by name, of
values outside the ranges of its fit.
"""

import warnings

import numpy as np
import pytest
from exported_models import write_model
from numpy.testing import assert_allclose

from pipeline.core.errors import ContractError, ModelDomainError
from pipeline.models import kinds, load
from pipeline.models.exported.reader import OutsideRanges

MALFORMED = [
    *(None, "{", "[]", '{"kind": "laplace"}', '{"kind": "gaussian", "alpha": 0.1}'),
    '{"kind": "gaussian", "alpha": "low", "u": 20.0}',
    '{"kind": "additive", "noise_covariance": [[1.0, 2.0], [3.0]]}',
]
OUTSIDE = {
    "sigma_B without a density": {
        "kind": "wishart",
        "sigma_b": 2.0,
        "decomposition": "qr",
    },
    "no sigma_B": {"kind": "wishart", "sigma_b": float("nan"), "decomposition": "qr"},
    "alpha": {"kind": "gaussian", "alpha": -0.1, "u": 20.0},
    "asymmetric": {"kind": "additive", "noise_covariance": [[1.0, 2.0], [3.0, 4.0]]},
    "two joints": {"kind": "additive", "noise_covariance": np.eye(2).tolist()},
    "negative": {"kind": "additive", "noise_covariance": (-np.eye(3)).tolist()},
}


@pytest.mark.parametrize("text", MALFORMED)
def test_malformed_and_missing_parameters_are_refused(text, tmp_path):
    if text is not None:
        (tmp_path / "parameters.json").write_text(text)
    with pytest.raises(
        ContractError,
        match=r"parameters.*run the stage fit",
    ) as refused:
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

    assert_allclose(
        variance(level=2.0),
        variance(alpha=1e-6, u=2e6),
        rtol=1e-9,
    )

    # control: another level
    assert np.all(variance(level=2.1) > 1.05 * variance(level=2.0))


def test_a_closed_loop_corrects_its_share_of_the_way_to_the_target(
    tmp_path,
    chain,
    poses,
    step,
):
    model = load(write_model(tmp_path / "model.json", "additive", chain, share=0.25))
    target = chain.pose(poses[0])
    off = chain.displacement(chain.pose(poses), target)
    assert_allclose(
        model.command(poses, target, task_step=step),
        step + 0.25 * off,
    )

    opened = load(write_model(tmp_path / "open.json", "additive", chain))
    assert (
        opened.command(poses, target, task_step=step) == np.tile(step, (len(poses), 1))
    ).all()


def test_it_warns_once_by_name_beyond_what_was_fitted_and_not_within(tmp_path, chain):
    model = load(write_model(tmp_path / "model.json", "additive", chain, width=0.5))
    q = np.array([0.3, 1.5, -0.4])
    v = np.array([0.001, 0.001, 0.01])
    bent = np.array([0.3, 2.4, -0.4])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.mean(q, task_step=v)

    with pytest.warns(
        OutsideRanges,
        match=r"b: 2\.4 rad is outside the range 1\.071 to 2\.071",
    ):
        model.mean(bent, task_step=v)
    with pytest.warns(
        OutsideRanges,
        match=r"speed of phi: 5 rad/s is outside the range -4 to 4",
    ):
        model.step(q, task_step=v * 5, rng=np.random.default_rng(1))

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.covariance(bent, task_step=v * 5)
