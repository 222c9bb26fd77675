"""The stage report decides every claim on the runs there are, the same every time, and leaves
earlier pages where something is malformed.
"""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from case_tables import cases_beside

from pipeline.configuration import config
from pipeline.core.errors import ConfigError, ContractError
from pipeline.stages import report
from pipeline.verdicts.report_page import BLOCK
from pipeline.verdicts.run import read_run

cases = cases_beside(__file__)
ROOT = Path(__file__).parents[2]
OWN = "claims.csv report.md errata.md model_card.md recordings.md summary.json".split()
WRITTEN = [
    *(f"reports/youbot/{name}" for name in OWN),
    "reports/datasets.md",
    "reports/equations.md",
]
YOUBOT = Path("reports/datasets/youbot.json")
CLAIMS = Path("claims.yaml")
COPIED = (YOUBOT, "reports/youbot/captions.json", "data/raw/youbot/dataset.yaml")


@pytest.fixture(scope="module")
def reported(tmp_path_factory) -> Path:
    """A folder of the committed evidence of the youBot and the captions, with a freshly composed
    configuration, in which the stage has run; read only.
    """
    folder = tmp_path_factory.mktemp("report")
    (folder / "pipeline").symlink_to(ROOT / "pipeline")
    for name in (*COPIED, "dvc.yaml", "params.yaml", "README.md", "pyproject.toml"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    shutil.copy(ROOT / "pipeline/verdicts" / CLAIMS, folder)

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(report, "CLAIMS", CLAIMS)
        config.write_config(Path("params.yaml"))
        report.run()
    return folder


@pytest.fixture(autouse=True)
def project(reported, tmp_path, monkeypatch) -> None:
    """A copy of it, to edit, as the current folder."""
    folder = tmp_path / "project"
    shutil.copytree(reported, folder, symlinks=True)
    monkeypatch.chdir(folder)
    monkeypatch.setattr(report, "CLAIMS", CLAIMS)


def compose(**changes: str) -> None:
    """Compose the configuration anew with ``changes`` of params.yaml."""
    parameters = config.read_yaml(Path("params.yaml")) | changes
    Path("params.yaml").write_text(json.dumps(parameters))
    config.write_config(Path("params.yaml"))


def written() -> list[bytes]:
    return [Path(name).read_bytes() for name in WRITTEN]


def decided() -> pd.Series:
    """The verdicts in claims.csv by claim and dataset."""
    keys = ["claim", "dataset"]
    rows = pd.read_csv("reports/youbot/claims.csv").drop_duplicates(keys)
    return rows.set_index(keys)["verdict"]


def test_every_claim_has_its_verdict_in_both_forms():
    verdicts = decided()
    stated = config.read_yaml(CLAIMS)["claims"]
    assert {*verdicts.index.get_level_values("dataset")} == {"youbot", "no recording"}
    names = [claim["id"] for claim in stated]
    assert list(dict.fromkeys(verdicts.index.get_level_values("claim"))) == names

    page = Path("reports/youbot/report.md").read_text()
    assert all(c["statement"] in page or c["id"] in page for c in stated)
    assert len(page.splitlines()) <= 180 and len(page.split()) <= 3300

    # no verdict on a robot comes of recordings that no robot made
    others = [claim["id"] for claim in stated if claim["about"] != "method"]
    assert not {*verdicts[others]} & {"holds", "fails"}
    assert "| Eq. 14 (NormStd) |" in Path("reports/equations.md").read_text()
    assert len(json.loads(Path("reports/youbot/summary.json").read_text())) <= 8


def test_every_link_of_the_report_leads_to_a_file_that_a_run_has():
    page = Path("reports/youbot/report.md").read_text()
    links = {link.partition("#")[0] for link in re.findall(r"\]\((.*?)\)", page)}
    here = (ROOT / "reports/youbot", Path("reports/youbot"))
    missing = {
        link for link in links if not any((place / link).exists() for place in here)
    }
    # of a pipeline of their own
    assert all(link.startswith("../studies/") for link in missing)

    anchors = set(re.findall(r"errata\.md#([\w-]+)", page))
    errata = Path("reports/youbot/errata.md").read_text()
    assert anchors and all(f'<a id="{anchor}">' in errata for anchor in anchors)


@pytest.mark.slow
def test_the_results_in_the_readme_are_those_of_the_papers_scale_and_equal_runs_give_equal_bytes():
    before = (ROOT / "README.md").read_text()
    after = Path("README.md").read_text()
    assert "computations without a recording" in BLOCK.search(after)[0]
    assert BLOCK.sub("", after) == BLOCK.sub("", before)

    first = written()
    Path("README.md").write_text(before)
    report.run()
    assert written() == first and Path("README.md").read_text() == after


def test_a_trial_has_pages_of_its_own_without_verdicts_and_leaves_the_results():
    before = written()
    readme = Path("README.md").read_text()
    trial = replace(read_run(YOUBOT), scale="smoke")
    place = Path("reports/trials")
    for file in (place / "datasets/youbot.json", place / "youbot/captions.json"):
        file.parent.mkdir(parents=True)
        file.write_text("{}")
    (place / "datasets/youbot.json").write_text(trial.to_json())
    compose(scale="smoke")

    report.run()

    assert written() == before and Path("README.md").read_text() == readme
    page = (place / "youbot/report.md").read_text()
    assert page.startswith("# Trial run of dataset youbot")
    rows = pd.read_csv(place / "youbot/claims.csv")
    assert "youbot" not in {*rows["dataset"]}


def test_evidence_of_a_trial_is_not_counted_and_of_another_version_is_named():
    run = read_run(YOUBOT)
    trial = replace(run, dataset="ur5", scale="smoke")
    YOUBOT.with_name("ur5.json").write_text(trial.to_json())
    YOUBOT.write_text(replace(run, version="0.0.1").to_json())

    report.run()

    assert "ur5" not in {*decided().index.get_level_values("dataset")}
    page = Path("reports/datasets.md").read_text()
    assert "evidence of ur5 is a trial's" in page
    assert "evidence of youbot is of 0.0.1" in page


@pytest.mark.slow
def test_an_altered_number_a_dataset_of_the_paper_and_another_dataset_are_seen():
    first = written()
    run = read_run(YOUBOT)
    # a dataset named as the paper's own decides what is said of its robot
    names = "recordings_of_the_paper: []", "recordings_of_the_paper: [youbot]"
    CLAIMS.write_text(CLAIMS.read_text().replace(*names))
    run.tables["evidence"]["value"] /= 2
    run.metrics["fit_wishart"]["sigma_b_paper"] /= 2
    YOUBOT.write_text(run.to_json())
    joints = ["joint_2", "joint_3", "joint_4"]
    changes = {"dataset": "ur5", "synthetic": False, "joints": joints, "tables": {}}
    YOUBOT.with_name("ur5.json").write_text(
        replace(run, metrics={}, **changes).to_json(),
    )
    report.run()
    assert all(
        before != after for before, after in zip(first[:3], written(), strict=False)
    )

    verdicts = decided()
    assert {"youbot", "ur5"} < {*verdicts.index.get_level_values("dataset")}
    assert verdicts["sigma-omega", "youbot"] in ("holds", "fails")
    assert verdicts["u", "ur5"] == "no evidence"
    assert "UR5, real" in Path("reports/youbot/report.md").read_text()


@cases("malformed")
def test_malformed_claims_or_evidence_are_refused_and_earlier_pages_are_left(
    file,
    old,
    new,
    words,
):
    before = written()
    edited = Path(file)
    text = edited.read_text() if edited.exists() else ""
    if old is None:
        edited.unlink()
    else:
        edited.write_text(text.replace(old, new, 1))

    with pytest.raises((ConfigError, ContractError), match=words):
        report.run()
    assert written() == before
