"""The stage report decides every claim on the runs there are, the same every time, and leaves what
stood where something is malformed.
"""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.core import config
from pipeline.core.errors import ConfigError, ContractError
from pipeline.stages import report
from pipeline.verdicts.run import read_run

ROOT = Path(__file__).parents[2]
OWN = ("claims.json", "report.md", "errata.md", "model_card.md", "recordings.md", "summary.json")
WRITTEN = (*(f"youbot/{name}" for name in OWN), "datasets.md", "equations.md")
YOUBOT = Path("reports/datasets/youbot.json")


@pytest.fixture
def project(tmp_path, monkeypatch):
    """The committed evidence of the youBot and the captions, with a freshly composed
    configuration.
    """
    (tmp_path / "pipeline").symlink_to(ROOT / "pipeline")
    for name in (
        "reports/claims.yaml",
        "reports/youbot/captions.json",
        YOUBOT,
        "data/raw/youbot/dataset.yaml",
        "dvc.yaml",
        "params.yaml",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    config.write_config(tmp_path / "params.yaml")
    return tmp_path


def written(project: Path) -> list[bytes]:
    return [(project / "reports" / name).read_bytes() for name in WRITTEN]


def test_every_claim_has_its_verdict_in_both_forms(project):
    report.run()
    claims = json.loads((project / "reports/youbot/claims.json").read_text())
    assert [(run["dataset"], run["recordings"]) for run in claims["datasets"]] == [
        ("youbot", "synthetic"),
    ]
    stated = config.read_yaml(project / "reports/claims.yaml")["claims"]
    assert [claim["id"] for claim in claims["claims"]] == [claim["id"] for claim in stated]
    page = (project / "reports/youbot/report.md").read_text()
    for claim in claims["claims"]:
        assert claim["statement"] in page and claim["evidence"]
        assert claim["command"].startswith("dvc repro ")
    assert len(page.splitlines()) <= 160 and len(page.split()) <= 3000
    # no verdict on a robot comes of recordings that no robot made
    decided = {
        claim["datasets"]["youbot"]["verdict"]
        for claim in claims["claims"]
        if claim["about"] != "method" and "youbot" in claim["datasets"]
    }
    assert not decided & {"reproduced", "not reproduced"}
    assert "# Errata" in (project / "reports/youbot/errata.md").read_text()
    assert "| Eq. 14 (NormStd) |" in (project / "reports/equations.md").read_text()


@pytest.mark.slow
def test_the_same_numbers_give_the_same_bytes_and_an_altered_one_does_not(project):
    report.run()
    first = written(project)
    report.run()
    assert written(project) == first
    run = read_run(YOUBOT)
    run.metrics["motion"]["wishart_greatest_mean_error_rad"] /= 2
    run.metrics["fit_wishart"]["sigma_b_paper"] /= 2
    YOUBOT.write_text(run.to_json())
    report.run()
    assert all(before != after for before, after in zip(first[:3], written(project), strict=False))


def test_a_dataset_named_as_the_papers_own_decides_what_is_said_of_its_robot(project):
    claims = project / "reports/claims.yaml"
    claims.write_text(
        claims.read_text().replace(
            "recordings_of_the_paper: []", "recordings_of_the_paper: [youbot]"
        )
    )
    report.run()
    claims = {
        claim["id"]: claim["datasets"]
        for claim in json.loads((project / "reports/youbot/claims.json").read_text())["claims"]
    }
    assert claims["sigma-omega"]["youbot"]["verdict"] in ("reproduced", "not reproduced")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("rule: less", "rule: fewer"),
        ("recordings_of_the_paper", "datasets"),
        ("claims:", "claims: 3 #"),
    ],
)
def test_malformed_claims_are_refused_and_what_stood_is_left(project, old, new):
    for name in WRITTEN:  # of an earlier run
        (project / "reports" / name).write_text("earlier")
    before = written(project)
    claims = project / "reports/claims.yaml"
    claims.write_text(claims.read_text().replace(old, new, 1))
    with pytest.raises(ConfigError):
        report.run()
    assert written(project) == before


def test_the_verdicts_of_another_dataset_stand_beside_those_of_the_run(project):
    other = read_run(project / "reports/datasets/youbot.json")
    joints = ["joint_2", "joint_3", "joint_4"]
    metrics = {"motion": {f"recorded_std_{name}_variation": 1.0 for name in joints}}
    metrics["motion"] |= {f"recorded_std_{n}_variation_of_constant_noise": 0.5 for n in joints}
    other = replace(
        other, dataset="ur5", synthetic=False, joints=joints, metrics=metrics, tables={}
    )
    (project / "reports/datasets/ur5.json").write_text(other.to_json())
    report.run()
    claims = json.loads((project / "reports/youbot/claims.json").read_text())
    assert [(run["dataset"], run["recordings"]) for run in claims["datasets"]] == [
        ("youbot", "synthetic"),
        ("ur5", "real"),
    ]
    verdicts = {
        claim["id"]: claim["datasets"]["ur5"]["verdict"]
        for claim in claims["claims"]
        if "ur5" in claim["datasets"]
    }
    assert (
        verdicts["u"] == "no evidence in this dataset"
        and verdicts["noise-is-dynamic"] == "reproduced"
    )
    assert "| youBot, synthetic | UR5, real |" in (project / "reports/youbot/report.md").read_text()


def test_evidence_that_is_missing_or_damaged_is_refused_by_name(project):
    (project / "reports/datasets/ur5.json").write_text("{}")
    with pytest.raises(ContractError, match=r"ur5\.json"):
        report.run()
    (project / "reports/datasets/ur5.json").unlink()
    (project / "reports/datasets/youbot.json").unlink()
    with pytest.raises(ContractError, match="no evidence of the dataset youbot"):
        report.run()


def test_every_link_of_the_report_leads_to_a_file_that_a_run_has(project):
    report.run()
    page = (project / "reports/youbot/report.md").read_text()
    links = {link.partition("#")[0] for link in re.findall(r"\]\((.*?)\)", page)}
    here = (ROOT / "reports/youbot", project / "reports/youbot")
    missing = {link for link in links if not any((place / link).exists() for place in here)}
    # the pages of the studies are written by a pipeline of their own
    assert {link for link in missing if not link.startswith("../studies/")} == set()
    anchors = set(re.findall(r"errata\.md#([\w-]+)", page))
    errata = (project / "reports/youbot/errata.md").read_text()
    assert anchors and all(f'<a id="{anchor}">' in errata for anchor in anchors)
