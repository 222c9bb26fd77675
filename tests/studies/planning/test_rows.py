"""The tables say which motion is the least, how surely, and whose prediction has the order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.core import contracts
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.studies.planning.rows import (
    course_rows,
    order_rows,
    prediction_rows,
    realised,
    spread_rows,
)
from pipeline.studies.planning.spread import KINDS, PARTS
from pipeline.studies.planning.stage import HERE

NAMES = ("minimum_norm", "recorded", "best_conditioned")
MODELS = {
    "additive": AdditiveModel(1e-6 * np.eye(3)),
    "wishart_qr_transposed": WishartModel(0.2, Decomposition("qr_transposed")),
}


def sums_of(*values: list[float]) -> dict:
    """Of NAMES the sum over all takes, then over each resampling."""
    by_motion = dict(zip(NAMES, np.transpose(values), strict=True))
    return {(part, kind): by_motion for part in PARTS for kind in KINDS}


def test_the_least_motion_is_so_sure_as_the_resamplings_have_it():
    sums = sums_of([2.0, 1.0, 4.0], *[[2.0, 1.0, 4.0]] * 3, [2.0, 3.0, 5.0])
    rows = spread_rows(sums, NAMES).query("part == 'tip' and kind == 'pose'").set_index("motion")
    assert rows["least"].to_dict() == dict(zip(NAMES, (0.25, 0.75, 0.0), strict=True))
    assert rows["ratio"].to_dict() == dict(zip(NAMES, (1.0, 0.5, 2.0), strict=True))
    assert rows.loc["recorded", "ratio_low"] == 0.5 < rows.loc["recorded", "ratio_high"] <= 1.5


def test_an_order_agrees_where_the_takes_have_it_and_a_motion_without_takes_is_a_gap():
    sums = sums_of([2.0, 1.0, 4.0], [2.0, 1.0, 4.0], [2.0, 3.0, 4.0])
    said = pd.DataFrame({"motion": NAMES, "joints": [2.0, 1.0, 3.0], "tip": [1.0, 1.0, 1.0]})
    said = pd.concat([said.assign(model="a"), said.assign(model="b", joints=[3.0, 4.0, 1.0])])
    rows = order_rows(sums, said).set_index(["model", "part", "kind"])
    first = rows.loc["a", "joints", "step"]
    assert first["tau"] == 1.0 and first["tau_low"] == pytest.approx(1 / 3, abs=0.05)
    assert rows.loc["b", "joints", "step"]["tau"] == -1.0
    assert rows.loc[(slice(None), "tip"), "tau"].isna().all()
    lost = {key: {name: each[name] for name in NAMES[:2]} for key, each in sums.items()}
    left = spread_rows(lost, NAMES).query("motion == 'best_conditioned'")
    assert left[["sum", "ratio", "least"]].isna().all(axis=None)


def test_tables_of_performed_motions_keep_their_contracts(bench, rig, tmp_path):
    slow = replace(rig, takes=3)
    path = bench.recorded
    moved = path + 0.05 * np.sin(np.linspace(0.0, np.pi, len(path)))[:, None]
    motions = {"minimum_norm": path, "wishart_qr_transposed": moved, "recorded": path}
    sums, course = realised(slow, motions, np.random.default_rng(1))
    predictions = prediction_rows(slow, MODELS, motions)
    courses = course_rows(slow, MODELS, motions, course)
    for name, rows in {
        "planning_spreads": spread_rows(sums, motions),
        "planning_predictions": predictions,
        "planning_orders": order_rows(sums, predictions),
        "planning_courses": courses,
    }.items():
        rows = rows.assign(arm="youbot", physics="base condition")
        rows = rows.drop(columns="physics") if name == "planning_courses" else rows
        contracts.write(rows, name, tmp_path, HERE / "tables.yaml")
    total = sums["joints", "step"]
    assert np.array_equal(total["recorded"], total["minimum_norm"])
    own = courses[courses["motion"] == "recorded"]
    assert np.sum(own["realised"] ** 2) == pytest.approx(total["recorded"][0], rel=1e-9)
    # a motion that no model planned has no prediction of its own
    assert own["predicted"].isna().all()
    assert courses.loc[courses["motion"] == "wishart_qr_transposed", "predicted"].notna().all()
