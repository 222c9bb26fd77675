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
    table = evidence_table(
        [
            evidence_row("std", 1, model="a", low=-np.inf),
            evidence_row("std", np.inf, model="b"),
            evidence_row("u", np.nan),
            evidence_row("u", 2, rival="a_closed"),
        ],
    )

    assert table[[*KEYS]].to_numpy().tolist() == [
        ["std", "a", *[""] * (len(KEYS) - 2)],
        ["u", "", "", "a_closed", *[""] * (len(KEYS) - 4)],
    ]
    assert table["value"].tolist() == [1.0, 2.0]
    assert table["low"].isna().all()
    assert depends_on(table, "a").all() and not depends_on(table, "b").any()
    assert list(evidence_table([])) == list(table)
    with pytest.raises(TypeError, match="no column modle"):
        evidence_row("std", 1.0, modle="a")


def camera_table(errors: np.ndarray, variances: np.ndarray, joints) -> pd.DataFrame:
    """The table ``kinect_noise`` of ``errors`` (takes, frames, n): bias from all takes ("none") and
    from all but each, with ``variances`` (takes + 1, frames) of every joint.
    """
    takes, frames, n = errors.shape
    biases = [errors.mean(axis=0)]
    biases += [np.delete(errors, take, axis=0).mean(axis=0) for take in range(takes)]
    names = ["none", *(f"t{take}" for take in range(takes))]
    parts = []
    for name, bias, variance in zip(names, biases, variances, strict=True):
        keys = {"take": name, "frame": np.arange(frames)}
        noise = triangle("r", joints, variance[:, None, None] * np.eye(n))
        parts.append(pd.DataFrame(keys | spread("b", joints, bias) | noise))
    return pd.concat(parts)


SLOPES = pd.DataFrame({"joint": ["none"], "slope": [0.5], "standard_error": [0.1]})


def test_a_bias_and_its_change_are_detected_and_no_bias_is_not():
    rng = default_rng(8)
    course = np.sin(np.linspace(0, 2 * np.pi, 400))  # its mean is zero
    bias = 0.003 * np.stack([0 * course, 0 * course + 1, course], axis=1)
    errors = bias + rng.normal(0.0, 0.02, (50, 400, 3))
    joints = ("none", "constant", "moving")
    table = camera_table(errors, np.full((51, 400), 4e-4), joints)

    values = by(camera_evidence(table, SLOPES), "quantity", "joint")

    detected = values[["camera_bias_p_value", "camera_bias_change_p_value"]] < 1e-4
    assert [*detected] == [False, True, True, False, False, True]


def test_errors_of_single_takes_follow_from_the_means_without_them_also_where_one_lacks_a_frame():
    errors = default_rng(2).normal(0.0, 0.02, (5, 30, 3))
    errors[1, 4] = errors[3, 20:] = np.nan
    without = [np.nanmean(np.delete(errors, take, axis=0), axis=0) for take in range(5)]
    computed = errors_of_takes(np.nanmean(errors, axis=0), np.stack(without))
    assert_allclose(computed, errors, atol=1e-15)


def test_the_variation_of_the_cameras_noise_has_the_standard_error_of_the_jackknife():
    rng = default_rng(8)
    takes = 50
    growing = np.linspace(0.5, 1.5, 400)  # standard deviation in units of 0.02
    shares = np.append(0.0, rng.random(takes))
    widths = np.sqrt(growing**2 + shares[:, None])
    errors = rng.normal(0.0, 0.02, (takes, 400, 2))
    table = camera_table(errors, 4e-4 * widths**2, JOINTS)

    evidence = camera_evidence(table, SLOPES)

    rows = evidence.query("quantity == 'camera_std_variation'")
    variations = widths[1:].std(axis=1) / widths[1:].mean(axis=1)
    jackknifed = np.std(variations) * np.sqrt(takes - 1)
    assert rows["value"].tolist() == pytest.approx([growing.std()] * 2)
    assert rows["standard_error"].tolist() == pytest.approx([jackknifed] * 2)
    (slope,) = evidence.query("quantity == 'depth_error_slope'").itertuples()
    assert (slope.joint, slope.value, slope.standard_error) == ("none", 0.5, 0.1)


def test_a_bound_that_follows_the_ramps_alone_does_not_follow_at_constant_speed():
    steps = np.arange(61)
    ramp = np.minimum(steps, 20.0)
    steady = steps[1:] > 20
    ramp[20] = 300.0  # the last step of the ramp
    wave = np.sin(steps)
    error, bound = (np.tile((1 + ramp + w)[:, None], (3, 1, 1)) for w in (wave, -wave))
    law = Filtered(error, bound[..., None] ** 2, np.zeros((1, 1)))

    filters = {NONE: law, "m": law}
    evidence, _, _ = filter_evidence(filters, ["hip"], steady, partial(stream, 1))

    values = by(evidence, "quantity", "model", "steps", "rival")
    assert values[FOLLOWS, "m", "", ""] > 0.9
    assert values[FOLLOWS, "m", "constant_speed", ""] < -0.9
    assert values["filter_log_score", "m", "", NONE] == 0.0


WAVE = 1 + 0.9 * np.sin(np.linspace(0, 6, 80))[:, None]


@pytest.mark.parametrize(
    ("takes", "width", "varies"),
    [(6, 1.0, False), (40, WAVE, True)],
    ids=["few", "many"],
)
def test_an_error_varies_only_beyond_what_as_many_takes_reach_by_chance(
    takes,
    width,
    varies,
):
    error = width * default_rng(4).normal(size=(takes, 80, 2))
    law = Filtered(error, np.tile(np.eye(2), (takes, 80, 1, 1)), np.zeros((2, 2)))
    filters = dict.fromkeys([NONE, MEMORY, "m", closed("m")], law)
    options = JOINTS, np.full(79, False), partial(stream, takes)

    evidence, against, refusals = filter_evidence(filters, *options)

    rows = evidence[evidence["model"] == "m"].set_index(["quantity", "joint"])
    limits = rows.loc["error_variation_limits"]
    values = rows.loc["error_variation", "value"]
    assert (values > 0.25).all()  # control: a limit without draws
    assert (values > limits["high"]).all() == varies
    assert (limits["low"] < limits["high"]).all()

    inside = (np.abs(error) <= 1).mean(axis=1)  # of each take
    coverage = rows.loc["coverage"]
    assert_allclose(coverage["value"], inside.mean(axis=0))
    standard_error = inside.std(axis=0, ddof=1) / np.sqrt(takes)
    assert_allclose(coverage["standard_error"], standard_error)

    assert refusals == []
    # only the bounds of models in an open loop are compared, all filters with the training mean
    assert {*evidence.query("quantity == @FOLLOWS")["model"]} == {"m"}
    assert {*against.query("difference == 0")["model"]} == {*filters} - {NONE}


@pytest.fixture
def wrench_tables() -> dict[str, pd.DataFrame]:
    """Tables of the study of the wrench, without a record of forces."""
    maxima = [0.2, 0.25, 0.4, 0.05, 0.06, 0.1]
    repeats = {"agents": [3] * 3 + [20] * 3, "maximum": maxima}
    repeats["mean"] = [0.2, 0.3, 0.4, 0.05, 0.06, 0.07]
    repeats["mean_without_matrix"] = [0.3, 0.4, 0.5, 0.1, 0.2, 0.3]
    errors = {"agents": [3, 3, 20], "error": [0.1, 0.3, 0.05]}
    return {
        "wrench_errors": pd.DataFrame(errors),
        "wrench_spread": pd.DataFrame(repeats),
    }


def test_the_study_of_the_wrench_has_rows_by_number_of_cables_and_no_force_without_a_record(
    wrench_tables,
):
    evidence = wrench_evidence(wrench_tables)
    rows = evidence.set_index(["quantity", "configuration"]).sort_index()
    without = rows[rows["estimator"] == "none"].loc["mean_error_of_variances"]
    rows = rows[rows["estimator"] != "none"]

    assert without.loc[["3", "20"], "value"].tolist() == [0.3, 0.1]
    assert without["standard_error"].tolist() == pytest.approx([0.1, 0.1])
    means = rows.loc["mean_error_of_variances"].loc[["3", "20"]]
    assert means["value"].iloc[0] == pytest.approx(0.2)
    assert means["standard_error"].tolist() == pytest.approx([0.1, 0.01])
    greatest = rows.loc[("greatest_error_of_variances", "3")]
    assert (greatest["value"], greatest["low"], greatest["high"]) == (0.3, 0.2, 0.4)
    assert rows.loc[("median_of_greatest_errors", "20"), "value"] == 0.06
    assert len(rows) == 6 and not evidence["quantity"].str.contains("force").any()


def test_a_record_of_forces_has_the_rows_of_its_configuration(wrench_tables):
    force = {"configuration": "C1", "source": ["measured", "modelled"]}
    force |= {"fx": [3.1, 3], "fy": 5, "var_fx": [4.0, 9.0], "var_fy": 1.0}
    test = {"configuration": ["C1"], "form": "none", "effective_samples": 100.0}
    test |= {"two_sample_p_value": 0.5, "matrix_share_fx": 0.0}
    numbers = {"expectation": 0.5, "expectation_error": 0.1}
    numbers |= {"mean": 0.6, "expected_standard_error": 0.2}
    keys = {"system_class": ["C1", "study"], "form": ["diagonal", "full"]}
    keys["entry"] = ["11", "22"]
    classes = pd.MultiIndex.from_product(keys.values(), names=keys)
    record = {
        "force_moments": pd.DataFrame(force),
        "force_test": pd.DataFrame(test),
        "sigma_s": classes.to_frame(index=False).assign(**numbers),
    }

    evidence = wrench_evidence(wrench_tables | record)

    columns = ["quantity", "configuration", "entry", "value", "standard_error"]
    diagonal = evidence.query("estimator == 'diagonal'")
    assert diagonal[columns].to_numpy().tolist() == [
        ["sigma_s", "C1", "11", 0.5, 0.1],
        ["mean_of_sigma_s", "C1", "11", 0.6, 0.2],
        ["sigma_s", "C1", "22", 0.5, 0.1],
        ["mean_of_sigma_s", "C1", "22", 0.6, 0.2],
    ]
    means = evidence.query("quantity == 'mean_force' and rival == ''")
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
