"""Every output gets the verdict that its hashes and contents call for, and the whole that of the
worst.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from pipeline.tools.audit.listing import as_json, as_table
from pipeline.tools.audit.verdict import Audit, judge

STAGES = {
    "dvc.lock": {
        "fit@a": {
            "cmd": "fit a",
            "deps": {"code": "1", "data/raw/lab": "6"},
            "outs": {"data/fit/a": "2", "reports/fit_a.json": "3"},
        },
        "fit@dropped": {
            "cmd": "fit dropped",
            "deps": {"code": "1"},
            "outs": {"data/fit/dropped": "4"},
        },
    },
    "data/raw/lab/dvc.lock": {
        "record": {"cmd": "record", "deps": {}, "outs": {"data/raw/lab/log.csv": "5"}}
    },
}
RAN = ["data/raw/lab/dvc.yaml:record", "fit@a"]


class Clones:
    """A committed and a rerun clone: lock files, and the reports with a number that can be set."""

    def __init__(self, folder: Path) -> None:
        self.places = folder / "committed", folder / "rerun"
        for place in self.places:
            self.write(place, STAGES, 0.5)

    def write(self, place: Path, stages: dict, value: float) -> None:
        for file, parts in stages.items():
            (place / file).parent.mkdir(parents=True, exist_ok=True)
            entries = {
                name: {
                    kind: [{"path": path, "md5": md5} for path, md5 in stage[kind].items()]
                    for kind in ("deps", "outs")
                }
                | {
                    "cmd": stage["cmd"],
                    "params": {"data/config.yaml": {"seed": stage.get("seed", 1)}},
                }
                for name, stage in parts.items()
            }
            OmegaConf.save({"schema": "2.0", "stages": entries}, place / file)
        (place / "reports").mkdir(exist_ok=True)
        (place / "reports/fit_a.json").write_text(json.dumps({"sigma": value}))

    def altered(self, value: float = 0.5, **fit: object) -> Audit:
        """The audit after a rerun whose lock has these entries of fit@a."""
        stage = STAGES["dvc.lock"]["fit@a"] | fit
        self.write(
            self.places[1], STAGES | {"dvc.lock": STAGES["dvc.lock"] | {"fit@a": stage}}, value
        )
        self.fetched = []
        return judge(*self.places, RAN, self.fetched.extend)


@pytest.fixture
def clones(tmp_path) -> Clones:
    return Clones(tmp_path)


def verdicts(audit: Audit) -> dict[str, str]:
    return {
        output.path: output.verdict for output in audit.outputs if output.verdict != "identical"
    }


def test_equal_locks_are_identical_whatever_they_hold_of_models_no_longer_chosen(clones):
    audit = clones.altered()
    assert (
        audit.verdict == "identical"
        and verdicts(audit) == {"data/fit/dropped": "not run"}
        and clones.fetched == []
    )
    assert audit.locks == {"data/raw/lab/dvc.lock": True, "dvc.lock": True} and audit.outdated == {}


@pytest.mark.parametrize(
    ("value", "verdict"), [(0.5 * (1 + 1e-12), "within tolerance"), (0.51, "different")]
)
def test_what_is_committed_is_compared_and_the_rest_is_looked_for_and_known_by_its_hash(
    clones, value, verdict
):
    audit = clones.altered(value, outs={"data/fit/a": "20", "reports/fit_a.json": "30"})
    assert clones.fetched == ["data/fit/a", "reports/fit_a.json"]
    assert verdicts(audit) == {
        "data/fit/a": "only its hash is known",
        "reports/fit_a.json": verdict,
        "data/fit/dropped": "not run",
    }
    assert audit.verdict == verdict and audit.locks == {
        "data/raw/lab/dvc.lock": True,
        "dvc.lock": False,
    }
    table = as_table(audit)
    assert (
        f"audit: {verdict}; of 4 outputs 1 identical, 1 only its hash is known, 1 {verdict}, 1 "
        "not run" in table
    )
    assert "No real difference is:" in table and json.loads(as_json(audit))["verdict"] == verdict


@pytest.mark.parametrize(
    "outs", [{"data/fit/a": "2"}, {"data/fit/a": "2", "reports/fit_a.json": "3", "data/more": "9"}]
)
def test_an_output_of_one_run_alone_is_a_difference(clones, outs):
    assert clones.altered(outs=outs).verdict == "different"


@pytest.mark.parametrize(
    ("entry", "named"),
    [
        ({"cmd": "fit b"}, "the command"),
        ({"deps": {"code": "7", "data/raw/lab": "8"}}, "code"),
        ({"seed": 2}, "data/config.yaml: seed"),
    ],
)
def test_a_lock_of_other_inputs_is_named_though_its_outputs_are_the_same(clones, entry, named):
    audit = clones.altered(**entry)
    assert (
        audit.verdict == "identical"
        and audit.outdated == {"fit@a": [named]}
        and not audit.locks["dvc.lock"]
    )
    assert f"fit@a: its lock is of other inputs than the commit's: {named}" in as_table(audit)
