"""What the page says follows the numbers."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pipeline.studies.planning import words
from pipeline.studies.planning.figures import planning as figure
from pipeline.studies.planning.spread import KINDS, PARTS

MOTIONS = ("minimum_norm", "recorded", "wishart_qr_transposed", "gaussian")
PHYSICS = ("base condition", "clearance 2")


def spreads(base: list[float], other: list[float], sure: bool = True) -> pd.DataFrame:
    """Sums of MOTIONS in both PHYSICS; the least is ``sure`` to be that."""
    rows = []
    for name, sums in zip(PHYSICS, (base, other), strict=True):
        for part in PARTS:
            for kind in KINDS:
                for motion, value in zip(MOTIONS, sums, strict=True):
                    best = value == np.nanmin(sums)
                    least = (1.0 if sure else 0.6) * best
                    ends = {f"{n}{e}": value for n in ("sum", "ratio") for e in ("_low", "_high")}
                    row = {"sum": value, "ratio": value / sums[0], "least": least} | ends
                    rows.append(
                        row | {"physics": name, "part": part, "kind": kind, "motion": motion}
                    )
    return pd.DataFrame(rows).assign(arm="youbot")


def orders(**taus: float) -> pd.DataFrame:
    """τ of each model, the same of everything."""
    rows = [
        {"model": model, "part": part, "kind": kind, "physics": name}
        | {"tau": tau, "tau_low": tau - 0.1, "tau_high": tau + 0.1}
        for model, tau in taus.items()
        for part in PARTS
        for kind in KINDS
        for name in PHYSICS
    ]
    return pd.DataFrame(rows).assign(arm="youbot")


def said(base: list[float], other: list[float], sure: bool = True, **taus: float) -> str:
    taus = taus or {"gaussian": 0.5}
    return "\n".join(words.answer(spreads(base, other, sure), orders(**taus)))


def test_the_least_motion_and_the_best_plan_are_named():
    text = said([1.0, 3.0, 2.0, 0.5], [1.0, 3.0, 2.0, 0.5])
    assert (
        "the least uncertain is the plan of Gaussian, 0.5 of the minimum-norm motion, surely"
        in text
    )
    assert "below the best motion without a model, the minimum-norm motion" in text
    assert "the worst plan is that of Wishart, QR of Jᵀ" in text
    assert "is surely the least: youbot: nowhere" in text
    assert "Of the plans alone it is that of Gaussian in 2." in text
    text = said([1.0, 3.0, 2.0, 5.0], [1.0, 3.0, 0.5, 5.0], sure=False)
    assert "the least uncertain is the minimum-norm motion, in 60% of the resamplings" in text
    assert "above the best motion without a model" in text
    assert "motion in 1 (0 surely) and the plan of Wishart, QR of Jᵀ in 1 (0 surely)" in text


def test_where_it_turns_is_named_where_it_is_sure():
    sums = [1.0, 3.0, 2.0, 5.0], [4.0, 3.0, 5.0, 6.0]
    assert "the recorded motion with clearance 2" in said(*sums)
    assert "youbot: nowhere" in said(*sums, sure=False)


@pytest.mark.parametrize(
    ("tau", "verdict"),
    [
        (0.5, "goes with the realised one in most physics: youbot τ 0.5 in the median, surely"),
        (-0.5, "runs against the realised one in most physics"),
        (0.0, "in some physics and not in others"),
        (np.nan, "predicts no order"),
    ],
)
def test_whose_order_holds_is_said_by_its_intervals(tau, verdict):
    assert verdict in said([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 4.0], gaussian=tau)


def test_what_was_not_planned_or_not_performed_is_counted():
    lost = spreads([1.0, 2.0, 3.0, np.nan], [1.0, 2.0, 3.0, 4.0])
    refused = pd.DataFrame({"model": ["additive"] * 2, "reason": ["it says so"] * 2})
    (text,) = words.refusals(refused, lost)
    assert "additive has no plan in 2 of 2 pairs of arm and physics: it says so." in text
    assert "1 times the arm could not perform a motion (plan of Gaussian)" in text
    whole = spreads([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 4.0])
    assert list(words.refusals(refused[:0], whole)) == []


def test_the_tables_hold_realised_and_predicted_over_the_minimum_norm_motion():
    table = spreads([1.0, 3.0, 2.0, 5.0], [4.0, 2.0, 3.0, 5.0])
    predictions = pd.DataFrame(
        {"model": "gaussian", "motion": MOTIONS, "joints": [2.0, 1.0, 3.0, 4.0], "tip": 1.0}
    ).assign(arm="youbot", physics="base condition")
    size, text = words.base_tables(table, predictions)
    assert "Gaussian 0.333" in size and "Of the 3 rad²" in size
    row = next(line for line in text.splitlines() if "recorded motion" in line)
    assert row.split("|")[2].strip() == "3" and row.split("|")[-2].strip() == "0.5"
    (text,) = words.physics_tables(table, orders(gaussian=0.5, additive=np.nan))
    row = next(line for line in text.splitlines() if "clearance 2" in line)
    assert "recorded motion" in row and row.split("|")[-2].strip() == "0.5"
    assert "additive" not in text


def test_the_figure_shows_each_motion_and_each_prediction():
    t = np.arange(20) / 100
    courses = pd.concat(
        [
            pd.DataFrame(
                {"t": t, "angle": t + n, "realised": 1e-3 * (n + 1), "predicted": 1e-3}
            ).assign(arm="youbot", motion=motion, joint="arm_joint_4")
            for n, motion in enumerate(MOTIONS)
        ]
    )
    table = spreads([1.0, 3.0, 2.0, 5.0], [1.0, 3.0, 2.0, 5.0])
    predictions = pd.DataFrame(
        {"model": "gaussian", "motion": MOTIONS, "joints": [2.0, 1.0, 3.0, 4.0], "tip": 1.0}
    ).assign(arm="youbot", physics="base condition")
    drawn = figure.draw(courses, table, predictions)
    angles, noise, against = drawn.axes
    assert len(angles.lines) == len(MOTIONS) and "arm joint 4" in angles.get_ylabel()
    np.testing.assert_allclose(angles.lines[2].get_ydata(), t[2::5] + 2)
    np.testing.assert_allclose(noise.lines[2].get_ydata(), 2e-3)
    shown = {tuple(np.round(line.get_xydata()[0], 9)) for line in against.lines}
    assert {(1.0, 1.0), (0.5, 3.0), (1.5, 2.0), (2.0, 5.0)} <= shown
