"""The section of verdicts shows every claim with its numbers, and marks what fails; the plain data are JSON."""

from __future__ import annotations

import json

from pipeline.audit.claims import decide, parse_claims
from pipeline.audit.run import Run
from pipeline.audit.verdicts import GROUPS, Decided, decide_each, side_by_side, verdict_data, verdict_section

TEXTS = {key: f"the {key}" for key in ("where", "statement", "quantity", "reason")} | {"stage": "score"}
ENTRY = {"file": "tables", "key": "{entry}"}
CLAIMS = parse_claims(
    [
        TEXTS
        | {"id": "spread", "about": "method", "rule": "less", "each": {"joint": [1, 2]}, "unit": "rad"}
        | {"value": {"file": "m", "key": "a{joint}"}, "than": {"file": "m", "key": "b"}},
        TEXTS
        | {"id": "sigma", "about": "method", "rule": "standard_errors", "limit": 2.5, "published": 7.0}
        | {"value": {"file": "m", "key": "e"}, "standard_error": {"file": "m", "key": "se"}},
        TEXTS | {"id": "robot", "about": "robots", "rule": "above", "limit": 0.5, "value": {"file": "m", "key": "lost"}},
    ]
)
EVIDENCE = {"m": {"a1": 0.12345, "a2": 0.6789, "b": 0.5, "e": 6.0, "se": 0.25}}


def decided(recordings: str = "synthetic", dataset: str = "youbot", evidence: dict = EVIDENCE) -> Decided:
    return Decided(dataset, recordings, decide(CLAIMS, evidence, recordings))


def test_values_comparisons_intervals_and_failures_are_shown():
    page = verdict_section([decided()])
    assert "joint 1: 0.1235 against 0.5<br>joint 2: 0.6789 against 0.5 ✗" in page
    assert "| – | the quantity in rad: less than" in page
    assert "| 7 | the quantity: less than" in page and "6 [5.51, 6.49] ✗" in page
    assert page.count("**not reproduced**") == 2 and page.count("**no evidence in this dataset**") == 1
    assert "`dvc repro score`" in page
    assert "2 not reproduced, 1 no evidence in this dataset" in page


def test_distances_in_standard_errors_have_a_table_of_their_own_where_there_are_any():
    assert "| the where |  | 7 | 6 | +4.00 |" in verdict_section([decided()])
    without = Decided("ur5", "real", decide(CLAIMS[:1], EVIDENCE, "real"))
    assert "standard errors of such" not in verdict_section([without])


def test_the_page_says_whose_recordings_decide():
    said = {recordings: verdict_section([decided(recordings)]) for recordings in ("synthetic", "real", "paper")}
    assert "**youbot** (synthetic recordings)" in said["synthetic"] and "**youbot** (synthetic" not in said["real"]
    assert len(set(said.values())) == 3


def test_what_each_kind_of_recordings_can_decide_is_kept_apart():
    page = verdict_section([decided()])
    (method, _), (robots, _) = GROUPS["method"], GROUPS["robots"]
    assert page.index(f"### {method}") < page.index("the quantity in rad") < page.index(f"### {robots}") < page.index("above 0.5")
    assert GROUPS["specimen"][0] not in page


def test_datasets_stand_side_by_side_with_their_own_numbers():
    both = [decided(), decided("real", "ur5", {"m": {"a1": 0.25, "a2": 0.3, "b": 0.5, "lost": 0.75}})]
    page = verdict_section(both)
    assert "| claim | published | test | youbot | ur5 | recompute |" in page
    (row,) = [line for line in page.splitlines() if "joint 1" in line]
    assert row.index("**not reproduced**<br>joint 1: 0.1235") < row.index("**reproduced**<br>joint 1: 0.25")
    ((_, verdicts),) = side_by_side(both, "robots")
    assert [of.verdict for of in verdicts] == ["no evidence in this dataset", "reproduced"]


def test_runs_are_decided_by_whose_recordings_they_are():
    runs = [Run(name, "paper", synthetic, {}, EVIDENCE, {}) for name, synthetic in (("youbot", True), ("ur5", False), ("lab", False))]
    assert [of.recordings for of in decide_each(CLAIMS, runs, ["lab"])] == ["synthetic", "real", "paper"]


def test_the_data_hold_every_claim_with_its_evidence_and_are_strict_json():
    data = verdict_data([decided(), decided("real", "ur5", {})])
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert [entry["id"] for entry in data] == ["spread", "sigma", "robot"]
    assert data[0]["evidence"] == ["reports/m.json: a1", "reports/m.json: b", "reports/m.json: a2", "reports/m.json: b"]
    here = data[0]["datasets"]["youbot"]
    assert here["cases"][1] | {"than": 0.5, "holds": False} == here["cases"][1]
    assert data[2]["datasets"]["ur5"] == {"verdict": "no evidence in this dataset", "cases": data[2]["datasets"]["ur5"]["cases"]}
    assert data[2]["datasets"]["ur5"]["cases"][0]["value"] is None
