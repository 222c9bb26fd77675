"""One-step predictions on takes drawn from a known model: calibrated and best where the model is
the true one, and not where it is not.
"""

from __future__ import annotations

import numpy as np
import pytest
from known_law import JOINTS, MODELS, REST, STEPS, TAKES, TRUE, write_project
from scipy.stats import chi2, multivariate_normal

from pipeline.models.kinds import build_model
from pipeline.models.noise import process_noise
from pipeline.models.prediction import score_steps
from pipeline.models.steps import Recorded
from pipeline.statistics.scores import compared, prediction_scores

MOVING = slice(REST, STEPS)


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """The recorded training takes, and the poses of the test takes."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("known")
        patch.chdir(folder)
        chain, q, v = write_project(folder)
    noise = process_noise(chain, q[:TAKES], v)
    return Recorded(chain, q[:TAKES, :-1], v, noise, tuple(JOINTS)), q[TAKES:]


def scored(known, model: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The scores (takes, M) of every test take, and why some are missing."""
    recorded, poses = known
    law = build_model(MODELS[model])
    takes = [score_steps(law, recorded, take) for take in poses]
    return {name: np.stack([take[name] for take, _ in takes]) for name in takes[0][0]}, takes[0][1]


def test_every_step_of_a_take_is_scored_by_the_density_of_its_law(known):
    (recorded, poses), (scores, _) = known, scored(known, "gaussian")
    for k in (0, REST + 29):
        before, after = poses[0, k], poses[0, k + 1]
        mean = before + np.linalg.solve(recorded.chain.jacobian(before), recorded.v[k])
        alone = TRUE.covariance(recorded.chain, before, recorded.v[k])
        law = multivariate_normal(mean, alone + recorded.measurement)
        error = after - mean
        assert scores["log_density"][0, k] == pytest.approx(law.logpdf(after))
        assert scores["nees"][0, k] == pytest.approx(error @ np.linalg.solve(law.cov, error))
        assert scores["z"][0, k, 1] == pytest.approx(error[1] / np.sqrt(law.cov[1, 1]))


def test_the_true_model_is_calibrated_and_a_wrong_one_is_not(known):
    """The band of the mean NEES holds it with a probability of 99.9 %."""
    cases = TAKES * (STEPS - REST)
    low, high = chi2(3 * cases).ppf([5e-4, 1 - 5e-4]) / cases
    true, wrong = (scored(known, model)[0]["nees"] for model in ("gaussian", "gaussian_ml"))
    assert low < true[:, MOVING].mean() < high
    assert not low < wrong[:, MOVING].mean() < high


def test_what_a_model_does_not_have_is_a_gap_with_a_reason(known):
    scores, reasons = scored(known, "wishart")
    assert "sigma_B 1.2" in reasons["mean and covariance"]
    assert all(np.isnan(scores[name]).all() for name in ("z", "nees"))
    assert np.isfinite(scores["log_density"]).all()
    # a gap stays one in the comparison, and does not become a number
    summary = compared({"wishart": prediction_scores(scores, JOINTS)}, "wishart")
    means = summary.set_index("score")["mean"]
    assert np.isnan(means["nees"]) and np.isnan(means[f"coverage_of_one_sigma_{JOINTS[0]}"])
    assert np.isfinite(means["log_score"])
