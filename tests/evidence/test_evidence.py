"""Rows of evidence: what a table of outcomes gives, by its keys, in known cases."""

import numpy as np
import pandas as pd
import pytest

from pipeline.core.columns import spread, triangle
from pipeline.core.filters import MEMORY, NONE, closed
from pipeline.evidence.filters import filter_evidence
from pipeline.evidence.instruments import camera_evidence, wrench_evidence
from pipeline.evidence.table import KEYS, depends_on, evidence_row, evidence_table
from pipeline.statistics.scores import FOLLOWS, Filtered

JOINTS = ("hip", "knee")


def by(table: pd.DataFrame, *keys: str) -> pd.Series:
    """The values by ``keys``."""
    return table.set_index([*keys])["value"]


def test_a_row_has_empty_keys_where_it_needs_none_and_no_row_has_an_infinite_value():
    rows = [evidence_row("std", 1, model="a", low=-np.inf), evidence_row("std", np.inf, model="b")]
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


def test_a_bias_that_is_nothing_is_about_one_standard_error_and_a_real_one_is_many():
    rng, takes, frames = np.random.default_rng(8), 50, 400
    bias = rng.normal(0.0, 0.02 / np.sqrt(takes), (frames, 2)) + np.array([0.0, 0.03])
    covariance = np.tile(4e-4 * np.eye(2), (frames, 1, 1))
    noise = spread("b", JOINTS, bias) | triangle("r", JOINTS, covariance)
    others = pd.DataFrame({"take": [f"t{n}" for n in range(takes)]})
    table = pd.concat([pd.DataFrame({"take": "none"} | noise), others])
    slopes = pd.DataFrame({"joint": ["hip"], "slope": [0.5], "standard_error": [0.1]})
    evidence = camera_evidence(table, slopes)
    values = by(evidence, "quantity", "joint")
    assert values["camera_bias", "hip"] == pytest.approx(1, abs=0.1)
    many = 0.03 / 0.02 * np.sqrt(takes)
    assert values["camera_bias", "knee"] == pytest.approx(many, rel=0.05)
    assert values["camera_bias_variation", "knee"] == pytest.approx(1, abs=0.1)
    assert values["camera_std_variation", "knee"] == 0
    slope = evidence.query("quantity == 'depth_error_slope'").iloc[0]
    assert (slope["joint"], slope["value"], slope["standard_error"]) == ("hip", 0.5, 0.1)


def test_a_bound_that_follows_the_ramps_alone_does_not_follow_at_constant_speed():
    steps = np.arange(61)
    ramp, steady = np.minimum(steps, 20.0), steps[1:] > 20
    error, bound = (np.stack([(1 + ramp + sign * np.sin(steps))[:, None]] * 3) for sign in (1, -1))
    law = Filtered(error, bound[..., None] ** 2, np.zeros((1, 1)))
    filters, rng = {NONE: law, "m": law}, np.random.default_rng(1)
    evidence, _, _ = filter_evidence(filters, ["hip"], steady, rng)
    values = by(evidence, "quantity", "model", "steps", "rival")
    assert values[FOLLOWS, "m", "", ""] > 0.9
    assert values[FOLLOWS, "m", "constant_speed", ""] < -0.9
    assert values["filter_log_score", "m", "", NONE] == 0.0


def filtered(error: np.ndarray, bound: np.ndarray) -> Filtered:
    return Filtered(error, bound[..., None] ** 2 * np.eye(2), np.zeros((2, 2)))


def test_filters_are_compared_with_the_first_model_and_with_the_training_mean():
    rng, steps = np.random.default_rng(1), 100
    width = np.linspace(0.5, 2.0, steps)[:, None] * np.ones(2)
    error, other = width * rng.normal(size=(2, 40, steps, 2))
    constant = 1.3 + 0.01 * rng.random(error.shape)
    filters = {
        NONE: filtered(error, np.tile(width, (40, 1, 1))),
        MEMORY: filtered(error / 2, np.tile(width / 2, (40, 1, 1))),
        "constant": filtered(2 * error, constant),
        "follows": filtered(other, np.tile(width, (40, 1, 1))),
        closed("constant"): filtered(error / 2, np.tile(width / 2, (40, 1, 1))),
    }
    evidence, against, refusals = filter_evidence(filters, JOINTS, np.full(steps - 1, False), rng)
    assert refusals == [] and np.isnan(against.query("model == @NONE")["difference"]).all()
    rows = evidence.set_index(["quantity", "model", "rival", "joint", "steps"])
    assert rows.loc[("filter_log_score", "constant", NONE, "", ""), "high"] < 0
    assert rows.loc[("filter_log_score", closed("constant"), NONE, "", ""), "low"] > 0
    assert rows.loc[("rms_error_of_a_take", MEMORY, NONE, "knee", ""), "high"] < 0
    assert rows.loc[("filter_log_score", NONE, "constant", "", ""), "low"] > 0
    # only the models' bounds are compared
    assert rows.loc[(FOLLOWS, "follows", "constant", "knee", ""), "low"] > 0.5
    assert rows.loc[("relative_error_of_bound", "follows", "constant", "knee", ""), "high"] < 0
    assert (FOLLOWS, MEMORY, "constant", "knee", "") not in rows.index


def test_the_study_of_the_wrench_has_rows_by_number_of_cables_and_no_force_without_a_record():
    errors = pd.DataFrame({"agents": [3, 3, 20], "error": [0.1, 0.3, 0.05]})
    maxima = [0.2, 0.25, 0.4, 0.05, 0.06, 0.1]
    repeats = pd.DataFrame({"agents": [3] * 3 + [20] * 3, "maximum": maxima})
    tables = {"wrench_errors": errors, "wrench_spread": repeats}
    evidence = wrench_evidence(tables)
    values = by(evidence, "quantity", "configuration")
    assert values["mean_error_of_variances", "3"] == pytest.approx(0.2)
    assert values["greatest_error_of_variances", "3"] == 0.3
    assert values["median_of_greatest_errors", "20"] == 0.06
    greatest = evidence.query("quantity == 'greatest_error_of_variances'").iloc[0]
    assert (greatest["low"], greatest["high"]) == (0.2, 0.4)
    assert {*evidence["quantity"]} == {name for name, _ in values.index} and len(evidence) == 8
    force = {"configuration": "C1", "source": ["measured", "modelled"], "fx": [3.1, 3], "fy": 5}
    tables["force_moments"] = pd.DataFrame(force)
    names = ["expectation", "expectation_error", "mean", "expected_standard_error"]
    numbers = dict(zip(names, (0.5, 0.1, 0.6, 0.2), strict=True))
    keys = {"system_class": ["C1", "study"], "form": ["diagonal", "full"], "entry": ["11", "22"]}
    classes = pd.MultiIndex.from_product(keys.values(), names=keys).to_frame(index=False)
    tables["sigma_s"] = classes.assign(**numbers)
    both = wrench_evidence(tables).query("estimator == 'diagonal'")
    columns = ["quantity", "configuration", "entry", "value", "standard_error"]
    expected = [("sigma_s", 0.5, 0.1), ("mean_of_sigma_s", 0.6, 0.2)]
    rows = [[name, "C1", entry, *two] for entry in ("11", "22") for name, *two in expected]
    assert both[columns].to_numpy().tolist() == rows
    means = by(wrench_evidence(tables).query("quantity == 'mean_force'"), "configuration", "entry")
    assert means.to_dict() == {("C1", "fx"): 3.1, ("C1", "fy"): 5.0}
