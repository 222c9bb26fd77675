"""The bounds of the inverse form are smoother than those of the Jacobian form of equal noise."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.random import default_rng

from pipeline.evidence import forms
from pipeline.evidence.motion import Outcome
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.gaussian.law import GaussianModel
from pipeline.verdicts import decision as d
from pipeline.verdicts.claims import read_claims
from pipeline.verdicts.run import ArmNames

ARM = ArmNames(("hip", "knee", "toe"), ("x", "z", "pitch"))
CLAIM = [claim for claim in read_claims() if claim.id == "inverse-form-smoother"]


def motion(chain, steps: int = 60) -> SimpleNamespace:
    """A folding arm, its Jacobian far from singular, without noise in its two takes."""
    path = np.linspace([0.4, -1.2, 0.5], [0.1, -1.9, 0.9], steps)
    v = np.matvec(chain.jacobian(path[:-1]), np.diff(path, axis=0))
    training = SimpleNamespace(chain=chain, q=np.stack([path[:-1]] * 2), v=v)
    return SimpleNamespace(training=training)


def evidence_on(chain, level: float):
    """The evidence on a Gaussian matrix model of the noise ``level`` α·u in 1/m."""
    models = {
        "gaussian": GaussianModel(level / 1e6, 1e6),
        "additive": AdditiveModel(np.eye(3)),
    }
    outcomes = {name: Outcome(model=model) for name, model in models.items()}
    rng = default_rng
    return forms.smoothness_evidence(
        outcomes,
        motion(chain),
        lambda name: rng(len(name)),
    )


def verdict(evidence) -> str:
    return d.decide(CLAIM, evidence, "synthetic", ARM)[0].verdict


def test_the_inverse_form_is_smoother_where_the_jacobian_form_has_heavy_tails(chain):
    evidence = evidence_on(chain, level=5.0)
    assert evidence["model"].tolist() == ["gaussian", "gaussian_jacobian", "gaussian"]
    assert verdict(evidence) == d.REPRODUCED

    # control: the claim about the forms in exchanged roles
    exchanged = evidence.assign(
        value=-evidence["value"],
        low=-evidence["high"],
        high=-evidence["low"],
    )

    assert verdict(exchanged) == d.NOT_REPRODUCED


def test_forms_of_little_noise_have_equal_bounds_and_no_verdict(chain):
    assert verdict(evidence_on(chain, level=0.01)) == d.NO_EVIDENCE
    assert evidence_on(chain, level=0.0).empty


@pytest.mark.parametrize("level", [0.003, 0.03])
def test_both_forms_have_one_total_variance_of_a_step_to_first_order(chain, level):
    training = motion(chain).training
    q = training.q[0]
    v = training.v
    variances = GaussianModel(level / 1e6, 1e6).covariance(chain, q, v)[:, 0, 0]
    rng = default_rng(3)
    bounds = forms.form_bounds(chain.jacobian(q), v, variances, rng)
    for form, bound in bounds.items():
        relative = np.sum(bound**2, axis=-1) / (3 * variances)
        assert relative.mean() == pytest.approx(1.0, abs=0.02), form
