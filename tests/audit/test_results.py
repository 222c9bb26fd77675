"""The page of results holds the numbers it is given, and says what the dataset lacks."""

from __future__ import annotations

import pandas as pd
import pytest

from pipeline.audit.results import number, results_page

MODELS = ["additive", "wishart"]
VERDICTS = "the verdicts"


@pytest.fixture
def metrics():
    motion = {f"{model}_greatest_mean_error_rad": 0.001234 for model in MODELS}
    for j in (1, 2, 3):
        motion |= {f"{source}_std_q{j}_rms_rad": 0.01 * j for source in ("recorded", *MODELS)}
        motion |= {f"{model}_std_q{j}_correlation_with_recorded": 0.5 for model in MODELS}
        motion |= {f"{model}_std_q{j}_relative_error": 0.25 for model in MODELS}
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


def compared(score: str) -> pd.DataFrame:
    """A score of two models, the second with a paired difference."""
    gap = float("nan")
    rows = [("additive", score, 1.25, gap, gap, gap), ("wishart", score, 1.5, 0.25, 0.125, 0.375)]
    return pd.DataFrame(rows, columns=["model", "score", "mean", "difference", "low", "high"])


def test_models_stand_side_by_side_with_their_paired_differences(metrics, tables):
    rows = pd.concat([compared("log_score").assign(steps=steps) for steps in ("all", "moving")])
    page = results_page("youbot", "paper", MODELS, metrics, tables | {"one_step_scores": rows}, [VERDICTS])
    assert page.count("| log score | 1.25 | 1.5 (+0.25 [+0.125, +0.375]) |") == 2
    assert "No one-step prediction was scored" not in page
    assert "Steps: moving." in page and "difference to additive" in page


def test_a_score_that_does_not_exist_is_a_dash_and_an_infinite_one_is_shown(metrics, tables):
    rows = compared("log_score").assign(steps="all", mean=[float("nan"), float("-inf")], difference=float("nan"))
    page = results_page("youbot", "paper", MODELS, metrics, tables | {"one_step_scores": rows}, [VERDICTS])
    assert "| log score | – | -inf |" in page
    single = compared("log_score").assign(steps="all", low=float("nan"), high=float("nan"))
    assert "| 1.5 (+0.25) |" in results_page("youbot", "paper", MODELS, metrics, tables | {"one_step_scores": single}, [VERDICTS])


def test_numbers_have_four_digits_and_counts_all_of_theirs():
    assert [number(x) for x in (0.287649, 2.5e-5, 32000.0, 0.0)] == ["0.2876", "2.5e-05", "32,000", "0"]


def test_every_number_given_is_on_the_page(metrics, tables):
    page = results_page("youbot", "paper", MODELS, metrics, tables, [VERDICTS])
    for text in (
        "dataset youbot, scale paper",
        "2.5e-05",
        "0.2877",
        "0.001234",
        "0.04095",
        "interpolated",
        "| 17 |",
        "lost at a singular pose | 7 | 7 |",
        "\n\nthe verdicts\n\n## Fitted parameters",
    ):
        assert text in page


def test_what_the_dataset_lacks_is_said_and_not_shown(metrics, tables):
    page = results_page("ur5", "paper", MODELS, metrics, tables, [VERDICTS])
    assert "no instrument for the particle filter and measured force" in page
    assert "Particle filter on the test takes" not in page
    assert "No one-step prediction was scored" in page
    scores = pd.DataFrame({"model": ["additive"], "rms_error_rad": [0.0107]})
    with_filter = results_page(
        "youbot", "paper", MODELS, metrics, tables | {"filter_scores": scores, "filter_comparison": compared("rms_error_q1_rad")}, VERDICTS
    )
    assert "751.5" in with_filter and "0.0107" in with_filter
