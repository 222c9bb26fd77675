"""On recordings whose law is known the model they were drawn from scores as the truth does, and no
other.
"""

from __future__ import annotations

import numpy as np
import pytest
from known_law import JOINTS, TAKES, write_project

from pipeline.models.kinds import build_model, options_type
from pipeline.models.noise import process_noise
from pipeline.models.steps import Recorded
from pipeline.studies.recovery.controls import control_scores

FITS = {  # of different sizes and directions of the noise
    "additive": {
        "kind": "additive",
        "noise_covariance": [[4e-6, -3e-6, 0.0], [-3e-6, 5e-6, 1e-6], [0.0, 1e-6, 9e-6]],
    },
    "wishart": {"kind": "wishart", "sigma_b": 0.15, "decomposition": "pivoted_lu"},
    "gaussian": {"kind": "gaussian", "alpha": 0.05, "u": 25.0},
    "scaled": {
        "kind": "scaled",
        "floor": (1e-6 * np.eye(3)).tolist(),
        "gain": (0.02 * np.eye(3)).tolist(),
    },
}
OPTIONS = {
    "additive": options_type("additive")("additive", estimator="paper"),
    "wishart": options_type("wishart")(
        "wishart", estimator="paper", decomposition="pivoted_lu", floor=0.2
    ),
    "gaussian": options_type("gaussian")("gaussian", estimator="paper", beta=0.5),
    "scaled": options_type("scaled")("scaled", structure="diagonal"),
}


@pytest.fixture(scope="module")
def scores(tmp_path_factory):
    """The table of the controls by true and fitted model, of 12 takes."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("controls")
        patch.chdir(folder)
        chain, q, v = write_project(folder)
    noise = process_noise(chain, q[:TAKES], v)
    recorded = Recorded(chain, q[:TAKES, :-1], v, noise, tuple(JOINTS))
    fitted = {name: build_model(parameters) for name, parameters in FITS.items()}
    return control_scores(recorded, OPTIONS, fitted, 2017, map).set_index(["true", "fitted"])


def test_the_best_entries_are_on_the_diagonal_and_nothing_beats_the_truth(scores):
    for true in ("additive", "wishart", "gaussian"):
        rows = scores.loc[true]
        own = rows.loc[f"{true}, consistent"]
        # two or so parameters from 720 moving steps cost some thousandths of a nat
        assert abs(own["difference"]) < 0.02
        others = rows[~rows.index.str.startswith(true)]
        assert (others["high"] < 0).all()
        assert (own["log_score"] > others["log_score"]).all()


def test_the_papers_estimator_of_the_wishart_model_misses_its_own_model(scores):
    assert scores.loc[("wishart", "wishart"), "high"] < -0.05
    assert scores.loc[("wishart", "wishart, consistent"), "low"] > -0.02


def test_the_deviation_over_time_tells_a_constant_noise_from_one_that_follows_the_motion(scores):
    for joint in JOINTS:
        correlation = scores[f"std_correlation:{joint}"]
        assert correlation["gaussian", "gaussian, consistent"] > 0.8
        assert abs(correlation["additive", "gaussian, consistent"]) < 0.5
        assert correlation["gaussian", "additive, consistent"] == 0


def test_at_rest_matrix_models_are_the_truth_and_additive_noise_counts_twice(scores):
    rest = scores.loc["rest"]
    assert (rest["difference"][["wishart", "gaussian"]] == 0).all() and rest["undetermined"][
        ["wishart", "gaussian"]
    ].all()
    # of noise twice as wide: −½·ln 2 + ¼ for each joint
    assert rest.loc["additive", "difference"] == pytest.approx(
        3 * (0.25 - 0.5 * np.log(2)), abs=0.03
    )
    assert rest.loc["additive, consistent", "difference"] == pytest.approx(0, abs=0.01)
    assert not rest["undetermined"][["additive", "additive, consistent"]].any()
