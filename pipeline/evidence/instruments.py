"""Evidence on the depth camera's noise, and on the wrench: the numerical study, Σ_S, and measured
against modelled forces.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd

from pipeline.core.columns import matrices, members, values
from pipeline.evidence.table import (
    RECORDED,
    Row,
    difference_row,
    evidence_row,
    evidence_table,
)
from pipeline.statistics.curves import variation
from pipeline.statistics.takes import (
    NORMAL_QUANTILE,
    equal_covariances_p_value,
    jackknife_difference,
    part_means,
    wrench_summary,
    zero_mean_p_value,
)

ENTRIES = ("11", "22")  # of Σ_S that are published
MEAN_ERROR = "mean_error_of_variances"
# quantity, and the columns of the table ``sigma_s`` with its value and standard error
SIGMA_S = (
    ("sigma_s", "expectation", "expectation_error"),
    ("mean_of_sigma_s", "mean", "expected_standard_error"),
)
COMPONENTS = ("fx", "fy")


def camera_evidence(
    noise: pd.DataFrame,
    slopes: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """Return bias and variation over time of the noise in the table ``kinect_noise``, and the
    ``slopes`` of :func:`pipeline.perception.depth_noise.error_slopes` near a sample.

    The p-values of the bias and of its change are of Hotelling's tests over the takes, of zero and
    of equal means in the parts of the motion (:func:`pipeline.statistics.takes.part_means`). The
    interval of the variation of the standard deviation is the jackknife's over takes.
    """
    rows = []
    tables = {take: table for take, table in noise.groupby("take", sort=False)}
    # a frame that only one take has is missing without this take
    frames = set.intersection(*(set(table["frame"]) for table in tables.values()))
    tables = {n: table[table["frame"].isin(frames)] for n, table in tables.items()}
    of_all = tables.pop("none")
    by_take = [*tables.values()]
    joints = members(of_all, "b")
    variances = []
    for table in (of_all, *by_take):
        variances.append(np.diagonal(matrices(table, "r", joints), axis1=1, axis2=2))
    mean = values(of_all, "b")
    without = np.stack([values(table, "b") for table in by_take])
    errors = errors_of_takes(mean, without)
    for j, joint in enumerate(joints):
        means = part_means(errors[..., j])
        bias = zero_mean_p_value(means)
        change = zero_mean_p_value(np.diff(means, axis=1))
        variations = np.array([variation(np.sqrt(table[:, j])) for table in variances])
        rows.append(evidence_row("camera_bias_p_value", bias, joint=joint))
        rows.append(evidence_row("camera_bias_change_p_value", change, joint=joint))
        spread = jackknife_difference(variations)
        rows.append(difference_row("camera_std_variation", spread, joint=joint))
    if slopes is not None:
        for fit in slopes.itertuples():
            error = {"standard_error": fit.standard_error, "joint": fit.joint}
            rows.append(evidence_row("depth_error_slope", fit.slope, **error))
    return evidence_table(rows)


def errors_of_takes(mean: np.ndarray, without: np.ndarray) -> np.ndarray:
    """Return the errors (takes, F, n) of single takes, NaN at frames that a take lacks, from the
    ``mean`` error (F, n) of the takes that have a frame, and the mean ``without`` each of the takes
    (takes, F, n). The mean without a take that lacks the frame is the mean itself.
    """
    lacking = np.all(without == mean, axis=-1)
    having = np.count_nonzero(~lacking, axis=0)[:, None]
    sums = having * mean
    sums_without = (having - 1) * without
    errors = sums - sums_without
    errors[lacking] = np.nan
    return errors


def wrench_evidence(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the evidence of the tables of the stage wrench by name; any but ``wrench_errors`` and
    ``wrench_spread`` may be missing. The estimator "none" of a mean error is the control with Σ_S
    = 0. The standard error of a mean error is its deviation over the repeats, of a mean force the
    one of the independent samples of its record.
    """
    rows = _study_rows(tables["wrench_errors"], tables["wrench_spread"])
    for entry in _records(tables, "sigma_s"):
        if entry["system_class"] == "study" or entry["form"] != "diagonal":
            continue
        if entry["entry"] not in ENTRIES:
            continue
        keys = {"configuration": entry["system_class"], "entry": entry["entry"]}
        keys["estimator"] = entry["form"]
        for quantity, value, error in SIGMA_S:
            of_value = {"value": entry[value], "standard_error": entry[error]}
            rows.append(evidence_row(quantity, **of_value, **keys))

    tests = _records(tables, "force_test")
    independent = {test["configuration"]: test["effective_samples"] for test in tests}
    rows += _force_rows(_records(tables, "force_moments"), independent)
    for test in tests:
        keys = {"configuration": test["configuration"], "estimator": test["form"]}
        p_value = test["two_sample_p_value"]
        rows.append(evidence_row("two_sample_p_value", p_value, **keys))
        share = test["matrix_share_fx"]
        rows.append(
            evidence_row("share_of_sigma_s_in_the_variance", share, entry="fx", **keys),
        )
    return evidence_table(rows)


def _study_rows(errors: pd.DataFrame, spread: pd.DataFrame) -> list[Row]:
    """Return the evidence of the numerical study by number of cables."""
    repeats = spread.groupby("agents")
    medians = repeats["maximum"].median()
    mean_errors = repeats["mean"].std()
    without = repeats["mean_without_matrix"].agg(["first", "std"])
    rows = []
    for study in wrench_summary(errors, spread).itertuples():
        cables = study.agents
        keys = {"configuration": cables}
        error = {"standard_error": mean_errors[cables]}
        rows.append(evidence_row(MEAN_ERROR, study.mean, **error, **keys))
        value, error = without.loc[cables]
        control = {"value": value, "standard_error": error, "estimator": "none"}
        rows.append(evidence_row(MEAN_ERROR, **control, **keys))
        ends = study.max_low, study.max_high
        rows.append(
            evidence_row("greatest_error_of_variances", study.max, *ends, **keys),
        )
        rows.append(evidence_row("median_of_greatest_errors", medians[cables], **keys))
    return rows


def _records(tables: Mapping[str, pd.DataFrame], name: str) -> list[dict]:
    return tables[name].to_dict("records") if name in tables else []


def _force_rows(
    moments: Sequence[Mapping[str, float | str]],
    independent: Mapping[str, float],
) -> list[Row]:
    """Return the measured mean forces and variances, the modelled minus the measured ones, and the
    p-values of equal covariances of two configurations, from the table ``force_moments`` and the
    numbers of ``independent`` samples by configuration.
    """
    rows = []
    measured = {
        row["configuration"]: row for row in moments if row["source"] == "measured"
    }
    modelled = {
        row["configuration"]: row for row in moments if row["source"] == "modelled"
    }
    for name, record in measured.items():
        for component in COMPONENTS:
            keys = {"entry": component, "configuration": name}
            variance = record[f"var_{component}"]
            error = np.sqrt(variance / independent[name])
            relative = np.sqrt(2 / (independent[name] - 1))
            mean = {"value": record[component], "standard_error": error}
            rows.append(evidence_row("mean_force", **mean, **keys))
            rows.append(
                evidence_row("force_variance", variance, model=RECORDED, **keys),
            )
            if name not in modelled:
                continue
            keys["rival"] = RECORDED
            off = modelled[name][component] - record[component]
            wider = modelled[name][f"var_{component}"] - variance
            for quantity, value, std in (
                ("mean_force", off, error),
                ("force_variance", wider, relative * variance),
            ):
                ends = value + NORMAL_QUANTILE * std * np.array([-1.0, 1.0])
                rows.append(evidence_row(quantity, value, *ends, std, **keys))
    for first, second in combinations(measured, 2):
        covariances = [_covariance(measured[name]) for name in (first, second)]
        counts = [independent[name] for name in (first, second)]
        p_value = equal_covariances_p_value(covariances, counts)
        keys = {"configuration": f"{first}, {second}"}
        rows.append(evidence_row("p_value_between_configurations", p_value, **keys))
    return rows


def _covariance(record: Mapping[str, float | str]) -> np.ndarray:
    """Return the covariance (2, 2) in N² of the planar force of a row of ``force_moments``."""
    shared = record["cov"]
    return np.array([[record["var_fx"], shared], [shared, record["var_fy"]]])
