"""On recordings whose law is known the model they were drawn from scores as the truth does, and no other."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from known_law import write_project
from omegaconf import OmegaConf

from pipeline import config, contracts
from pipeline.stages import control

FITS = {  # of different sizes and directions of the noise
    "additive": {"kind": "additive", "noise_covariance": [[4e-6, -3e-6, 0.0], [-3e-6, 5e-6, 1e-6], [0.0, 1e-6, 9e-6]]},
    "wishart": {"kind": "wishart", "sigma_b": 0.15, "decomposition": "lu"},
    "gaussian": {"kind": "gaussian", "alpha": 0.05, "u": 25.0},
    "scaled": {"kind": "scaled", "floor": (1e-6 * np.eye(3)).tolist(), "gain": (0.02 * np.eye(3)).tolist()},
}


@pytest.fixture(scope="module")
def scores(tmp_path_factory):
    """The table of the controls by true and fitted model."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("controls")
        patch.chdir(folder)
        write_project(folder)
        return controls()


def controls() -> pd.DataFrame:
    """What the stage writes in the project that stands in the current directory."""
    params = OmegaConf.load("params.yaml")
    params.update({"models": list(FITS), "overrides": {"scale": {"control_takes": 12}}})
    OmegaConf.save(params, "params.yaml")
    config.write_config(Path("params.yaml"))
    for name, parameters in FITS.items():
        Path(f"data/fit/{name}").mkdir(exist_ok=True)
        Path(f"data/fit/{name}/parameters.json").write_text(json.dumps(parameters))
    control.run()
    return contracts.read("control_scores", Path("data/control")).set_index(["true", "fitted"])


def test_the_best_entries_are_on_the_diagonal_and_nothing_beats_the_truth(scores):
    for true in ("additive", "wishart", "gaussian"):
        of_true = scores.loc[true]
        own = of_true.loc[f"{true}, consistent"]
        # two or so parameters from 720 moving steps cost some thousandths of a nat
        assert abs(own["difference"]) < 0.02
        others = of_true[~of_true.index.str.startswith(true)]
        assert (others["high"] < 0).all()
        assert (own["log_score"] > others["log_score"]).all()


def test_the_papers_estimator_of_the_wishart_model_misses_its_own_model(scores):
    assert scores.loc[("wishart", "wishart"), "high"] < -0.05
    assert scores.loc[("wishart", "wishart, consistent"), "low"] > -0.02


def test_the_standard_deviation_over_time_would_tell_a_constant_noise_from_one_that_follows_the_motion(scores):
    for j in (1, 2, 3):
        correlation = scores[f"std_correlation_q{j}"]
        assert correlation["gaussian", "gaussian, consistent"] > 0.8
        assert abs(correlation["additive", "gaussian, consistent"]) < 0.5
        assert correlation["gaussian", "additive, consistent"] == 0


def test_at_rest_the_matrix_models_are_the_truth_and_the_additive_one_counts_the_measurement_noise_twice(scores):
    rest = scores.loc["rest"]
    assert (rest["difference"][["wishart", "gaussian"]] == 0).all() and rest["undetermined"][["wishart", "gaussian"]].all()
    # of noise twice as wide: −½·ln 2 + ¼ for each joint
    assert rest.loc["additive", "difference"] == pytest.approx(3 * (0.25 - 0.5 * np.log(2)), abs=0.03)
    assert rest.loc["additive, consistent", "difference"] == pytest.approx(0, abs=0.01)
    assert not rest["undetermined"][["additive", "additive, consistent"]].any()


def test_a_motion_that_never_rests_has_no_controls(project, capsys):
    trajectory = contracts.read("trajectory", Path("data/ingest"))
    contracts.write(trajectory.assign(vx=0.01), "trajectory", Path("data/ingest"))
    control.run()
    assert "no control recordings" in capsys.readouterr().out
    assert not contracts.exists("control_scores", Path("data/control"))
