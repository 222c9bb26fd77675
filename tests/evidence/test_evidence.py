"""Rows of evidence: what a table of outcomes gives, by its keys, in known cases."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose

from pipeline.core.columns import spread, triangle
from pipeline.core.filters import MEMORY, NONE, closed
from pipeline.core.rng import stream
from pipeline.evidence.filters import filter_evidence
from pipeline.evidence.instruments import (
    camera_evidence,
    errors_of_takes,
    wrench_evidence,
)
from pipeline.evidence.motion import Outcome, dexterity_evidence
from pipeline.evidence.table import KEYS, depends_on, evidence_row, evidence_table
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kinds import build_model
from pipeline.statistics.scores import FOLLOWS, Filtered

JOINTS = ("hip", "knee")


def by(table: pd.DataFrame, *keys: str) -> pd.Series:
    """The values by ``keys``."""
    return table.set_index([*keys])["value"]


def test_a_row_has_empty_keys_where_it_needs_none_and_no_row_has_an_infinite_value():
    rows = [
        evidence_row("std", 1, model="a", low=-np.inf),
        evidence_row("std", np.inf, model="b"),
    ]
    rows += [evidence_row("u", np.nan), evidence_row("u", 2, rival="a_closed")]
    table = evidence_table(rows)

    assert table[[*KEYS]].to_numpy().tolist() == [
        ["std", "a", *[""] * (len(KEYS) - 2)],
        ["u", "", "", "a_closed", *[""] * (len(KEYS) - 4)],
    ]
    assert table["value"].tolist() == [1.0, 2.0] and table["low"].isna().all()
    assert depends_on(table, "a").all() and not depends_on(table, "b").any()
    with pytest.raises(TypeError, match="no column modle"):
        evidence_row("std", 1.0, modle="a")
    assert list(evidence_table([])) == list(table)


def test_a_bias_and_its_change_are_detected_and_no_bias_is_not():
    rng, takes, frames = default_rng(8), 50, 400
    joints = ("none", "constant", "moving")
    course = np.sin(np.linspace(0, 2 * np.pi, frames))  # its mean is zero
    bias = np.stack([0 * course, 0 * course + 0.003, 0.003 * course], axis=1)
    errors = bias + rng.normal(0.0, 0.02, (takes, frames, 3))
    growing = np.linspace(0.5, 1.5, frames)  # standard deviation in units of 0.02
    covariance = 4e-4 * growing[:, None, None] ** 2 * np.eye(3)
    shares = np.append(0.0, rng.random(takes))
    parts = []
    for number, share in enumerate(shares):
        mean = errors.mean(axis=0)
        if number:
            mean = np.delete(errors, number - 1, axis=0).mean(axis=0)
        noise = triangle("r", joints, covariance + share * 4e-4 * np.eye(3))
        take = {"take": f"t{number}" if number else "none", "frame": np.arange(frames)}
        parts.append(pd.DataFrame(take | spread("b", joints, mean) | noise))
    slopes = pd.DataFrame({"joint": ["none"], "slope": [0.5], "standard_error": [0.1]})
    evidence = camera_evidence(pd.concat(parts), slopes)
    values = by(evidence, "quantity", "joint")
    detected = values[["camera_bias_p_value", "camera_bias_change_p_value"]] < 1e-4

    assert [*detected] == [False, True, True, False, False, True]
    assert values["camera_std_variation", "constant"] == pytest.approx(growing.std())

    widths = np.sqrt(growing**2 + shares[1:, None])
    jackknifed = np.std(widths.std(axis=1) / widths.mean(axis=1)) * np.sqrt(takes - 1)
    rows = evidence.query("quantity == 'camera_std_variation'")
    assert rows["standard_error"].tolist() == pytest.approx([jackknifed] * 3)

    slope = evidence.query("quantity == 'depth_error_slope'").iloc[0]
    assert slope["joint"] == "none"
    assert (slope["value"], slope["standard_error"]) == (0.5, 0.1)


def test_errors_of_single_takes_follow_from_the_means_without_them_also_where_one_lacks_a_frame():
    errors = default_rng(2).normal(0.0, 0.02, (5, 30, 3))
    errors[1, 4] = errors[3, 20:] = np.nan
    without = [np.nanmean(np.delete(errors, take, axis=0), axis=0) for take in range(5)]
    computed = errors_of_takes(np.nanmean(errors, axis=0), np.stack(without))
    assert_allclose(computed, errors, atol=1e-15)


def test_a_bound_that_follows_the_ramps_alone_does_not_follow_at_constant_speed():
    steps = np.arange(61)
    ramp, steady = np.minimum(steps, 20.0), steps[1:] > 20
    ramp[20] = 300.0  # the last step of the ramp
    error = np.stack([(1 + ramp + np.sin(steps))[:, None]] * 3)
    bound = np.stack([(1 + ramp - np.sin(steps))[:, None]] * 3)
    law = Filtered(error, bound[..., None] ** 2, np.zeros((1, 1)))
    filters = {NONE: law, "m": law}
    evidence, _, _ = filter_evidence(filters, ["hip"], steady, partial(stream, 1))
    values = by(evidence, "quantity", "model", "steps", "rival")

    assert values[FOLLOWS, "m", "", ""] > 0.9
    assert values[FOLLOWS, "m", "constant_speed", ""] < -0.9
    assert values["filter_log_score", "m", "", NONE] == 0.0


def test_an_error_varies_only_beyond_what_as_many_takes_reach_by_chance():
    rng = default_rng(4)
    wave = 1 + 0.9 * np.sin(np.linspace(0, 6, 80))[:, None]
    never_steady = np.full(79, False)
    for takes, width, varies in ((6, 1.0, False), (40, wave, True)):
        error = width * rng.normal(size=(takes, 80, 2))
        law = Filtered(error, np.tile(np.eye(2), (takes, 80, 1, 1)), np.zeros((2, 2)))
        filters = dict.fromkeys([NONE, MEMORY, "m", closed("m")], law)
        evidence, against, refusals = filter_evidence(
            filters,
            JOINTS,
            never_steady,
            partial(stream, takes),
        )
        rows = evidence[evidence["model"] == "m"].set_index(["quantity", "joint"])
        limits = rows.loc["error_variation_limits"]
        values = rows.loc["error_variation", "value"]
        assert (values > 0.25).all()  # control: a limit without draws
        assert (values > limits["high"]).all() == varies
        inside = (np.abs(error) <= 1).mean(axis=1)  # of each take
        assert_allclose(rows.loc["coverage", "value"], inside.mean(axis=0))
        errors = inside.std(axis=0, ddof=1) / np.sqrt(takes)
        assert_allclose(rows.loc["coverage", "standard_error"], errors)

    assert (limits["low"] < limits["high"]).all() and refusals == []
    # only the bounds of models in an open loop are compared, all filters with the training mean
    assert {*evidence.query("quantity == @FOLLOWS")["model"]} == {"m"}
    assert {*against.query("difference == 0")["model"]} == {*filters} - {NONE}


def test_the_study_of_the_wrench_has_rows_by_number_of_cables_and_no_force_without_a_record():
    errors = pd.DataFrame({"agents": [3, 3, 20], "error": [0.1, 0.3, 0.05]})
    maxima = [0.2, 0.25, 0.4, 0.05, 0.06, 0.1]
    repeats = pd.DataFrame({"agents": [3] * 3 + [20] * 3, "maximum": maxima})
    repeats["mean"] = [0.2, 0.3, 0.4, 0.05, 0.06, 0.07]
    repeats["mean_without_matrix"] = [0.3, 0.4, 0.5, 0.1, 0.2, 0.3]
    tables = {"wrench_errors": errors, "wrench_spread": repeats}
    evidence = wrench_evidence(tables)
    without = evidence.query("estimator == 'none'")

    assert without["value"].tolist() == [0.3, 0.1]
    assert without["standard_error"].tolist() == pytest.approx([0.1, 0.1])

    evidence = evidence.drop(without.index)
    values = by(evidence, "quantity", "configuration")
    assert values["mean_error_of_variances", "3"] == pytest.approx(0.2)
    assert values["greatest_error_of_variances", "3"] == 0.3
    assert values["median_of_greatest_errors", "20"] == 0.06

    greatest = evidence.query("quantity == 'greatest_error_of_variances'").iloc[0]
    assert (greatest["low"], greatest["high"]) == (0.2, 0.4)

    errors = evidence.query("quantity == 'mean_error_of_variances'")["standard_error"]
    assert errors.tolist() == pytest.approx([0.1, 0.01])
    assert len(evidence) == 6 and not evidence["quantity"].str.contains("force").any()

    force = {"configuration": "C1", "source": ["measured", "modelled"]}
    force |= {"fx": [3.1, 3], "fy": 5, "var_fx": [4.0, 9.0], "var_fy": 1.0}
    tables["force_moments"] = pd.DataFrame(force)
    test = {"configuration": ["C1"], "form": "none", "effective_samples": 100.0}
    test |= {"two_sample_p_value": 0.5, "matrix_share_fx": 0.0}
    tables["force_test"] = pd.DataFrame(test)
    names = ["expectation", "expectation_error", "mean", "expected_standard_error"]
    numbers = dict(zip(names, (0.5, 0.1, 0.6, 0.2), strict=True))
    keys = {
        "system_class": ["C1", "study"],
        "form": ["diagonal", "full"],
        "entry": ["11", "22"],
    }
    classes = pd.MultiIndex.from_product(keys.values(), names=keys)
    tables["sigma_s"] = classes.to_frame(index=False).assign(**numbers)
    both = wrench_evidence(tables).query("estimator == 'diagonal'")
    columns = ["quantity", "configuration", "entry", "value", "standard_error"]
    expected = [("sigma_s", 0.5, 0.1), ("mean_of_sigma_s", 0.6, 0.2)]
    rows = []
    for entry in ("11", "22"):
        rows += [[name, "C1", entry, *numbers] for name, *numbers in expected]

    assert both[columns].to_numpy().tolist() == rows

    means = wrench_evidence(tables).query("quantity == 'mean_force' and rival == ''")
    measured = means.set_index("entry")[["value", "standard_error"]]
    assert measured.T.to_dict("list") == {"fx": [3.1, 0.2], "fy": [5, 0.1]}


def test_the_variance_of_a_matrix_model_follows_dexterity_by_its_law(chain, poses):
    """‖J⁻¹‖ is large at low dexterity: the inverse Gaussian form has less variance there."""
    wishart = {"kind": "wishart", "decomposition": "qr_transposed", "sigma_b": 0.2}
    models = {
        "additive": AdditiveModel(1e-6 * np.eye(3)),
        "gaussian": GaussianModel(alpha=0.1, u=30.0),
        "wishart": build_model(wishart),
    }
    outcomes = {name: Outcome(model=model) for name, model in models.items()}
    takes = SimpleNamespace(training=SimpleNamespace(chain=chain, q=poses))
    evidence = dexterity_evidence(outcomes, takes, default_rng(1))
    rows = evidence.set_index("model")

    assert {*rows.index} == {"gaussian", "wishart"}
    assert rows.loc["gaussian", "high"] < 0 < rows.loc["wishart", "low"]
