"""The page of results holds the numbers it is given, and says what the dataset lacks."""

from __future__ import annotations

import pandas as pd
import pytest

from pipeline.audit.results import number, results_page

MODELS = ["additive", "wishart"]


@pytest.fixture
def metrics():
    motion = {f"{model}_greatest_mean_error_rad": 0.001234 for model in MODELS}
    for j in (1, 2, 3):
        motion |= {f"{source}_std_q{j}_rms_rad": 0.01 * j for source in ("recorded", *MODELS)}
        motion |= {f"{model}_std_q{j}_correlation_with_recorded": 0.5 for model in MODELS}
    fits = {"fit_additive": {"sigma_omega_11_rad2": 2.5e-5}, "fit_wishart": {"sigma_b": 0.28765}}
    fits |= {f"simulate_{model}": {"realizations_lost_at_a_singular_pose": 7} for model in MODELS}
    return {"motion": motion} | fits | {f"filter_{model}": {"mean_effective_sample_size": 751.5} for model in MODELS}


@pytest.fixture
def tables():
    quality = pd.DataFrame({"instrument": ["motion capture"], "quantity": ["interpolated"], "unit": ["1"], "sum": [17.0]})
    return {
        "wrench_study": pd.DataFrame({"agents": [3], "mean": [0.04095]}),
        "sigma_s": pd.DataFrame({"system_class": ["study"], "s11": [0.001767]}),
        "recording_quality": quality,
    }


def test_numbers_have_four_digits_and_counts_all_of_theirs():
    assert [number(x) for x in (0.287649, 2.5e-5, 32000.0, 0.0)] == ["0.2876", "2.5e-05", "32,000", "0"]


def test_every_number_given_is_on_the_page(metrics, tables):
    page = results_page("youbot", "paper", MODELS, metrics, tables)
    for text in (
        "dataset youbot, scale paper",
        "2.5e-05",
        "0.2877",
        "0.001234",
        "0.04095",
        "interpolated",
        "| 17 |",
        "lost at a singular pose | 7 | 7 |",
    ):
        assert text in page


def test_what_the_dataset_lacks_is_said_and_not_shown(metrics, tables):
    page = results_page("ur5", "paper", MODELS, metrics, tables)
    assert "no instrument for the particle filter and measured force" in page
    assert "Particle filter on the test takes" not in page
    scores = pd.DataFrame({"model": ["additive"], "rms_error_rad": [0.0107]})
    with_filter = results_page("youbot", "paper", MODELS, metrics, tables | {"filter_scores": scores})
    assert "751.5" in with_filter and "0.0107" in with_filter
