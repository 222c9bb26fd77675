"""All motions keep the task path; a model's plan is what it holds for the least uncertain of them,
and a model that says the same of every step has none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core import config
from pipeline.core.errors import ModelDomainError
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.studies.planning.motions import (
    BEST,
    GIVEN,
    MINIMUM,
    RECORDED,
    Terms,
    fitted,
    fixed_motions,
    planned,
)
from pipeline.studies.planning.spread import predicted

TERMS = Terms(margin=0.5, smoothness=0.1, conditioned=1000.0)


@pytest.fixture(scope="module")
def motions(bench):
    return fixed_motions(bench, TERMS)


def test_the_motions_share_their_task_path_and_no_more(bench, motions):
    path = bench.chain.pose(bench.recorded)
    for joints in motions.values():
        assert np.abs(bench.chain.displacement(bench.chain.pose(joints), path)).max() < 1e-8
    assert np.array_equal(motions[MINIMUM][0], motions[RECORDED][0])
    assert np.abs(motions[BEST] - motions[RECORDED]).max() > 0.1
    least = {
        name: np.linalg.svd(bench.chain.jacobian(joints), compute_uv=False)[:, -1].min()
        for name, joints in motions.items()
    }
    assert least[BEST] == max(least.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    "model", [WishartModel(0.2, Decomposition("qr_transposed")), GaussianModel(0.5, 12.0)]
)
def test_a_plan_is_less_uncertain_by_its_model_than_the_motions_without_one(bench, motions, model):
    plan = planned(bench, model, TERMS)
    sums = [predicted(bench, model, path)["joints"].sum() for path in motions.values()]
    assert predicted(bench, model, plan)["joints"].sum() < min(sums)


def test_a_model_without_an_order_or_a_covariance_has_no_plan(bench):
    for model, words in (
        (AdditiveModel(1e-6 * np.eye(3)), "same of every step"),
        (WishartModel(0.9, Decomposition("qr_transposed")), "exists only"),
    ):
        with pytest.raises(ModelDomainError, match=words):
            planned(bench, model, TERMS)


def test_a_model_that_cannot_be_fitted_is_named_with_why(bench, rig):
    options = config.model_options([GIVEN, "additive"])
    recorded = rig.training()
    models, refused = fitted(bench, recorded, options)
    assert list(models) == [GIVEN, "additive"] and refused == {}
    # metres alone: both rows of x and z have the mean length of the arm
    length = bench.built.lengths.mean()
    np.testing.assert_allclose(models[GIVEN].decomposition.left, length * np.eye(2))
    still = replace(recorded, noise=np.zeros_like(recorded.noise))
    models, refused = fitted(bench, still, options)
    assert list(models) == ["additive"] and "no fit" in refused[GIVEN]
