"""Evidence on the wrench: the numerical study, Σ_S, and measured against modelled forces."""

from collections.abc import Mapping

import pandas as pd

from pipeline.evidence.table import evidence_row, evidence_table
from pipeline.statistics.takes import wrench_summary

ENTRIES = ("11", "22")  # of Σ_S that are published
COMPONENTS = ("fx", "fy")


def wrench_evidence(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the evidence of the tables of the stage wrench by name; any but ``wrench_errors`` and
    ``wrench_spread`` may be missing.
    """
    rows, maxima = [], tables["wrench_spread"].groupby("agents")["maximum"]
    maxima = maxima.agg(["median", "mean", "std"])
    for own in wrench_summary(tables["wrench_errors"], tables["wrench_spread"]).itertuples():
        keys, ends = {"configuration": own.agents}, (own.max_low, own.max_high)
        repeats = maxima.loc[own.agents]
        rows += [
            evidence_row("mean_error_of_variances", own.mean, **keys),
            evidence_row("greatest_error_of_variances", own.max, *ends, **keys),
            evidence_row("median_of_greatest_errors", repeats["median"], **keys),
            evidence_row(
                "greatest_error_of_a_repeat", repeats["mean"], standard_error=repeats["std"], **keys
            ),
        ]
    for own in _records(tables, "sigma_s"):
        published = own["system_class"] != "study" and own["form"] == "diagonal"
        if published and own["entry"] in ENTRIES:
            place = {"configuration": own["system_class"], "entry": own["entry"]}
            for name, value, error in (
                ("sigma_s", "expectation", "expectation_error"),
                ("mean_of_sigma_s", "mean", "expected_standard_error"),
            ):
                number = own[value]
                keys = place | {"estimator": own["form"], "standard_error": own[error]}
                rows.append(evidence_row(name, number, **keys))
    for own in _records(tables, "force_moments"):
        if own["source"] == "measured":
            place = {"configuration": own["configuration"]}
            rows += [evidence_row("mean_force", own[c], entry=c, **place) for c in COMPONENTS]
    for own in _records(tables, "force_test"):
        keys = {"configuration": own["configuration"], "estimator": own["form"]}
        rows.append(evidence_row("two_sample_p_value", own["two_sample_p_value"], **keys))
        share = own["matrix_share_fx"]
        rows.append(evidence_row("share_of_sigma_s_in_the_variance", share, entry="fx", **keys))
    return evidence_table(rows)


def _records(tables: Mapping[str, pd.DataFrame], name: str) -> list[dict]:
    return tables[name].to_dict("records") if name in tables else []
