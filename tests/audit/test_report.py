"""The stages collect a run's evidence and write verdicts, results and errata from it, the same every time, or leave them alone."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from smoke import set_parameters

from pipeline import config
from pipeline.audit.run import read_run
from pipeline.errors import ConfigError, ContractError
from pipeline.stages import evidence, report

ROOT = Path(__file__).parents[2]
WRITTEN = ("claims.json", "report.md", "errata.md")


@pytest.fixture
def project(tmp_path, monkeypatch):
    """The committed reports of the paper's models with a freshly composed configuration."""
    for name in ("reports/metrics", "reports/tables"):
        shutil.copytree(ROOT / name, tmp_path / name)
    (tmp_path / "pipeline/audit").mkdir(parents=True)
    for name in ("reports/claims.yaml", "pipeline/audit/errata.yaml", "pipeline/audit/paper.yaml", "dvc.yaml", "params.yaml"):
        shutil.copy(ROOT / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    set_parameters(tmp_path, models="[additive, wishart, gaussian]")
    config.write_config(tmp_path / "params.yaml")
    evidence.run()
    return tmp_path


def written(project: Path) -> list[bytes]:
    return [(project / "reports" / name).read_bytes() for name in WRITTEN]


def test_every_claim_has_its_verdict_in_both_forms(project):
    report.run()
    claims = json.loads((project / "reports/claims.json").read_text())
    assert [(of["dataset"], of["recordings"]) for of in claims["datasets"]] == [("youbot", "synthetic")]
    stated = config.read_yaml(project / "reports/claims.yaml")["claims"]
    assert [claim["id"] for claim in claims["claims"]] == [claim["id"] for claim in stated]
    page = (project / "reports/report.md").read_text()
    for claim in claims["claims"]:
        assert claim["statement"] in page and claim["evidence"] and claim["command"].startswith("dvc repro ")
    # no verdict on a robot comes of recordings that no robot made
    decided = {claim["datasets"]["youbot"]["verdict"] for claim in claims["claims"] if claim["about"] != "method"}
    assert not decided & {"reproduced", "not reproduced"}
    assert "# Errata" in (project / "reports/errata.md").read_text()
    assert "| Eq. 14 (NormStd) |" in (project / "reports/equations.md").read_text()


def test_the_same_numbers_give_the_same_bytes_and_an_altered_one_does_not(project):
    report.run()
    first = written(project)
    report.run()
    assert written(project) == first
    motion = project / "reports/metrics/motion.json"
    values = json.loads(motion.read_text())
    motion.write_text(json.dumps(values | {"wishart_greatest_mean_error_rad": values["wishart_greatest_mean_error_rad"] / 2}))
    evidence.run()
    report.run()
    assert all(before != after for before, after in zip(first, written(project), strict=True))


def test_a_dataset_named_as_the_papers_own_decides_what_is_said_of_its_robot(project):
    claims = project / "reports/claims.yaml"
    claims.write_text(claims.read_text().replace("recordings_of_the_paper: []", "recordings_of_the_paper: [youbot]"))
    report.run()
    claims = {claim["id"]: claim["datasets"] for claim in json.loads((project / "reports/claims.json").read_text())["claims"]}
    assert claims["u"]["youbot"]["verdict"] in ("reproduced", "not reproduced")


@pytest.mark.parametrize(
    ("old", "new"), [("rule: less", "rule: fewer"), ("recordings_of_the_paper", "datasets"), ("claims:", "claims: 3 #")]
)
def test_malformed_claims_are_refused_and_what_stood_is_left(project, old, new):
    report.run()
    before = written(project)
    claims = project / "reports/claims.yaml"
    claims.write_text(claims.read_text().replace(old, new, 1))
    with pytest.raises(ConfigError):
        report.run()
    assert written(project) == before


def test_the_verdicts_of_another_dataset_stand_beside_those_of_the_run(project):
    other = read_run(project / "reports/datasets/youbot.json")
    motion = {f"recorded_std_q{j}_variation": 1.0 for j in (1, 2, 3)}
    other = replace(other, dataset="ur5", synthetic=False, metrics={"motion": motion}, tables={})
    (project / "reports/datasets/ur5.json").write_text(other.to_json())
    report.run()
    claims = json.loads((project / "reports/claims.json").read_text())
    assert [(of["dataset"], of["recordings"]) for of in claims["datasets"]] == [("youbot", "synthetic"), ("ur5", "real")]
    verdicts = {claim["id"]: claim["datasets"]["ur5"]["verdict"] for claim in claims["claims"]}
    assert verdicts["u"] == "no evidence in this dataset" and verdicts["noise-is-dynamic"] == "reproduced"
    assert "### ur5" in (project / "reports/report.md").read_text()


def test_evidence_that_is_missing_or_damaged_is_refused_by_name(project):
    (project / "reports/datasets/ur5.json").write_text("{}")
    with pytest.raises(ContractError, match=r"ur5\.json"):
        report.run()
    (project / "reports/datasets/ur5.json").unlink()
    (project / "reports/datasets/youbot.json").unlink()
    with pytest.raises(ContractError, match="no evidence of the dataset youbot"):
        report.run()
