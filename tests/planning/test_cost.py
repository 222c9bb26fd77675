"""What a step costs is its covariance's trace or ln det, where there is one."""

from __future__ import annotations

import numpy as np
import pytest
from planned_arms import LAWS, chain, joint_path, law_cost

from pipeline.core.errors import ConfigError, ModelDomainError, SingularJacobianError
from pipeline.models.draws import draw_steps
from pipeline.models.kinds import build_model
from pipeline.planning.problem import uncertainty, where_defined

STEP = np.array([2e-3, 1e-3])


@pytest.mark.parametrize("law", ["gaussian", "qr_transposed", "pivoted_lu"])
def test_it_is_the_trace_and_the_ln_det_of_drawn_steps(law):
    arm, model = chain("planar"), build_model(LAWS[law])
    q, draws = joint_path("planar", 2)[1], 40_000
    drawn, _ = draw_steps(model, arm, np.tile(q, (draws, 1)), STEP, np.random.default_rng(4))
    variances = np.linalg.eigvalsh(np.cov(drawn, rowvar=False))
    trace, log_det = (
        law_cost(law, arm, objective)(q[None], STEP[None])[0] for objective in ("trace", "log_det")
    )
    # of heavy tails, so that a sample's variance is off by some percent
    assert trace == pytest.approx(variances.sum(), rel=0.1)
    rank = 3 if law == "gaussian" else 2
    assert log_det == pytest.approx(np.log(variances[-rank:]).sum(), abs=0.2)
    # the control: by the other rank it would be far from that
    assert abs(log_det - np.log(np.maximum(variances[-(5 - rank) :], 1e-30)).sum()) > 1


def test_a_step_at_rest_costs_the_matrix_models_nothing_and_the_additive_one_its_noise():
    arm, q = chain("planar"), joint_path("planar", 2)
    still = np.zeros((3, 2))
    for objective in ("trace", "log_det"):
        assert law_cost("qr_transposed", arm, objective)(q, still).tolist() == [0, 0, 0]
        assert law_cost("additive", arm, objective)(q, still) == pytest.approx(
            3e-6 if objective == "trace" else 3 * np.log(1e-6)
        )


def test_singular_poses_cost_infinitely_much_and_no_others():
    arm = chain("planar")
    cost = law_cost("pivoted_lu", arm)
    q = np.random.default_rng(5).uniform(arm.lower, arm.upper, (300, 3))
    q[::30] = np.nan  # which is refused as a singular pose is
    v = np.tile(STEP, (300, 1))
    with pytest.raises(SingularJacobianError):
        cost(q, v)
    costs = where_defined(cost, q, v)
    np.testing.assert_array_equal(np.isfinite(costs), ~arm.singular(q))
    assert np.isinf(costs).sum() >= 10


def test_blocks_leave_the_costs_as_they_are(monkeypatch):
    arm, q = chain("planar"), joint_path("planar", 99)
    cost, v = law_cost("pivoted_lu", arm), np.random.default_rng(6).uniform(0, 0.01, (100, 2))
    monkeypatch.setattr("pipeline.planning.problem.BLOCK", 7)
    np.testing.assert_array_equal(where_defined(cost, q, v), cost(q, v))
    assert where_defined(cost, q[:0], v[:0]).shape == (0,)


def test_a_model_without_a_covariance_is_refused():
    wide = {"kind": "wishart", "sigma_b": 0.9, "decomposition": "qr_transposed"}
    arm, q = chain("planar"), joint_path("planar", 1)
    cost = uncertainty(build_model(wide), arm, "trace")
    with pytest.raises(ModelDomainError, match="Wishart step exists only for sigma_B below"):
        where_defined(cost, q, np.tile(STEP, (2, 1)))


def test_a_moving_step_without_noise_has_no_ln_det():
    arm, q = chain("planar"), joint_path("planar", 1)
    beyond = build_model({"kind": "gaussian", "alpha": 0.1, "u": 1e-3})
    v = np.tile(STEP, (2, 1))
    assert uncertainty(beyond, arm, "trace")(q, v).tolist() == [0, 0]
    with pytest.raises(ModelDomainError, match="no ln det"):
        uncertainty(beyond, arm, "log_det")(q, v)


def test_another_objective_is_refused():
    with pytest.raises(ConfigError, match="no objective 'sum'; there are trace, log_det"):
        uncertainty(build_model(LAWS["additive"]), chain("planar"), "sum")
