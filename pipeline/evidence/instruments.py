"""Evidence on the depth camera's noise, and on the wrench: the numerical study, Σ_S, and measured
against modelled forces.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pipeline.core.columns import matrices, members, values
from pipeline.evidence.table import difference_row, evidence_row, evidence_table
from pipeline.statistics.curves import root_mean_square, variation
from pipeline.statistics.takes import jackknife_difference, wrench_summary

ENTRIES = ("11", "22")  # of Σ_S that are published
COMPONENTS = ("fx", "fy")


def camera_evidence(
    noise: pd.DataFrame, slopes: pd.DataFrame | None = None
) -> pd.DataFrame:
    """Return size and variation over time of the noise in the table ``kinect_noise``, and the
    ``slopes`` of :func:`pipeline.perception.depth_noise.error_slopes` near a sample.

    The bias is in standard errors: a zero bias has a size of about 1, a constant one a variation of
    about 1. The interval of the variation of the standard deviation is the jackknife's over takes.
    """
    of_all, rows = noise[noise["take"] == "none"], []
    left_out = [
        own for take, own in noise.groupby("take", sort=False) if take != "none"
    ]
    joints, parts = members(of_all, "b"), []
    for own in (of_all, *left_out):
        parts.append(np.diagonal(matrices(own, "r", joints), axis1=1, axis2=2).T)
    for j, (joint, bias) in enumerate(zip(joints, values(of_all, "b").T, strict=True)):
        error = np.sqrt(parts[0][j].mean() / len(left_out))
        variations = np.array([variation(np.sqrt(part[j])) for part in parts])
        spread = jackknife_difference(variations)
        rows += [
            evidence_row("camera_bias", root_mean_square(bias) / error, joint=joint),
            evidence_row("camera_bias_variation", bias.std() / error, joint=joint),
            difference_row("camera_std_variation", spread, joint=joint),
        ]
    for own in () if slopes is None else slopes.itertuples():
        error = {"standard_error": own.standard_error, "joint": own.joint}
        rows.append(evidence_row("depth_error_slope", own.slope, **error))
    return evidence_table(rows)


def wrench_evidence(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the evidence of the tables of the stage wrench by name; any but ``wrench_errors`` and
    ``wrench_spread`` may be missing. The estimator "none" of a mean error is the control with Σ_S
    = 0. The standard error of a mean error is its deviation over the repeats, of a mean force the
    one of the independent samples of its record.
    """
    rows, spreads = [], tables["wrench_spread"].groupby("agents")
    maxima, means = (
        spreads["maximum"].agg(["median", "mean", "std"]),
        spreads["mean"].std(),
    )
    without = spreads["mean_without_matrix"].agg(["first", "std"])
    for own in wrench_summary(
        tables["wrench_errors"], tables["wrench_spread"]
    ).itertuples():
        keys, ends = {"configuration": own.agents}, (own.max_low, own.max_high)
        repeats = maxima.loc[own.agents]
        spread = keys | {"standard_error": repeats["std"]}
        rows += [
            evidence_row(
                "mean_error_of_variances",
                own.mean,
                standard_error=means[own.agents],
                **keys,
            ),
            evidence_row(
                "mean_error_of_variances",
                without.loc[own.agents, "first"],
                estimator="none",
                standard_error=without.loc[own.agents, "std"],
                **keys,
            ),
            evidence_row("greatest_error_of_variances", own.max, *ends, **keys),
            evidence_row("median_of_greatest_errors", repeats["median"], **keys),
            evidence_row("greatest_error_of_a_repeat", repeats["mean"], **spread),
        ]
    for own in _records(tables, "sigma_s"):
        published = own["system_class"] != "study" and own["form"] == "diagonal"
        if published and own["entry"] in ENTRIES:
            place = {"configuration": own["system_class"], "entry": own["entry"]}
            for name, value, error in (
                ("sigma_s", "expectation", "expectation_error"),
                ("mean_of_sigma_s", "mean", "expected_standard_error"),
            ):
                keys = place | {"estimator": own["form"], "standard_error": own[error]}
                rows.append(evidence_row(name, own[value], **keys))
    tests = _records(tables, "force_test")
    independent = {own["configuration"]: own["effective_samples"] for own in tests}
    for own in _records(tables, "force_moments"):
        for c in COMPONENTS if own["source"] == "measured" else ():
            error = np.sqrt(own[f"var_{c}"] / independent[own["configuration"]])
            keys = {
                "entry": c,
                "configuration": own["configuration"],
                "standard_error": error,
            }
            rows.append(evidence_row("mean_force", own[c], **keys))
    for own in tests:
        keys = {"configuration": own["configuration"], "estimator": own["form"]}
        rows.append(
            evidence_row("two_sample_p_value", own["two_sample_p_value"], **keys)
        )
        share = own["matrix_share_fx"]
        rows.append(
            evidence_row("share_of_sigma_s_in_the_variance", share, entry="fx", **keys)
        )
    return evidence_table(rows)


def _records(tables: Mapping[str, pd.DataFrame], name: str) -> list[dict]:
    return tables[name].to_dict("records") if name in tables else []
