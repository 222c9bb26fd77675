"""A run of what is committed is identical, within the tolerance or different, and the exit code
says which.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest
from project_copy import GIT, run

from pipeline.__main__ import main

pytestmark = pytest.mark.slow

STAGES = """\
stages:
  measure:
    cmd: python measure.py
    deps: [measure.py, ../exports]
    outs: [data/values.csv: {persist: true}]
  report:
    cmd: python report.py
    deps: [report.py, data/values.csv]
    metrics: [reports/numbers.json: {cache: false, persist: true}]
"""
MEASURE = """\
from pathlib import Path

FACTOR = 0.1
logged = [int(x) for x in Path("../exports/log.txt").read_text().split()]
Path("data").mkdir(exist_ok=True)
Path("data/values.csv").write_text("x\\n" + "".join(f"{FACTOR * x!r}\\n" for x in logged))
"""
REPORT = """\
import json
from pathlib import Path

values = [float(x) for x in Path("data/values.csv").read_text().split()[1:]]
Path("reports").mkdir(exist_ok=True)
summary = {"count": len(values), "mean": sum(values) / len(values)}
Path("reports/numbers.json").write_text(json.dumps(summary))
"""
LAST_BIT = "0.1 * (1 + 2**-50)"


def commit(project: Path) -> None:
    for command in (["add", "-A"], ["commit", "-qm", "as it is"]):
        done = run(*GIT, *command, cwd=project)
        assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project of two stages under git and DVC, as it was run and committed; its recordings lie
    beside it.
    """
    project = tmp_path_factory.mktemp("made") / "project"
    files = {
        "dvc.yaml": STAGES,
        "measure.py": MEASURE,
        "report.py": REPORT,
        "data/raw/lab/dataset.yaml": "recordings: ../exports\n",
    }
    for name, text in (files | {"../exports/log.txt": "1 2 3 4 5 6 7 8"}).items():
        (project / name).parent.mkdir(parents=True, exist_ok=True)
        (project / name).write_text(text)
    for command in ([*GIT, "init", "-q"], ["dvc", "init", "-q"], ["dvc", "repro", "-q"]):
        done = run(*command, cwd=project)
        assert done.returncode == 0, done.stderr
    commit(project)
    return project


@pytest.fixture
def project(made: Path, tmp_path: Path) -> Path:
    """That project, to be altered."""
    shutil.copytree(made.parent, tmp_path, symlinks=True, dirs_exist_ok=True)
    return tmp_path / "project"


@pytest.fixture
def audited(monkeypatch, capfd, tmp_path):
    """Exit code, what is printed, the message and the JSON of an audit of a project."""

    def call(project: Path) -> tuple[int, str, str, dict]:
        monkeypatch.chdir(project)
        result = tmp_path / "audit.json"
        monkeypatch.setattr(
            sys, "argv", ["pipeline", "audit", str(tmp_path / "audit"), "--json", str(result)]
        )
        code = main()
        said = capfd.readouterr()
        return code, said.out, said.err, json.loads(result.read_text()) if result.exists() else {}

    return call


def verdicts(result: dict) -> dict[str, str]:
    return {output["path"]: output["verdict"] for output in result["outputs"]}


def alter(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))


def test_what_its_code_gives_is_identical(audited, project):
    (project / "measure.py").write_text("not committed, so not run")
    code, said, _, result = audited(project)
    assert (code, result["verdict"], result["locks"]) == (0, "identical", {"dvc.lock": True})
    assert verdicts(result) == {"data/values.csv": "identical", "reports/numbers.json": "identical"}
    assert (
        "dvc.lock: the same to the byte" in said
        and "not as committed, and left out: measure.py" in said
    )


def test_an_altered_constant_is_caught_with_all_that_it_alters(audited, project):
    alter(project / "measure.py", "0.1", "0.10001")
    commit(project)
    code, said, message, result = audited(project)
    assert (code, result["verdict"], result["locks"]) == (1, "different", {"dvc.lock": False})
    assert verdicts(result) == {"data/values.csv": "different", "reports/numbers.json": "different"}
    assert result["outdated"] == {"measure": ["measure.py"]}
    values, numbers = (
        {part["where"]: part["relative"] for part in output["differences"]}
        for output in result["outputs"]
    )
    assert values == {"column x": pytest.approx(1e-4, rel=1e-3)} and numbers == {
        "mean": pytest.approx(1e-4, rel=1e-3)
    }
    assert re.search(
        r"different +report +reports/numbers\.json +mean: 0\.45\d* before, 0\.45004\d* now, "
        r"relative 0\.0001",
        said,
    )
    assert message.splitlines()[-1].startswith(
        "error: audit: what is committed is not what its code gives"
    )


def test_a_clean_clone_tolerates_another_rounding_and_knows_what_git_lacks_by_its_hash(
    audited, project, tmp_path
):
    alter(project / "measure.py", "0.1", LAST_BIT)
    commit(project)
    clean = tmp_path / "clean"
    assert run("git", "clone", "-q", str(project), str(clean), cwd=tmp_path).returncode == 0
    code, said, _, result = audited(clean)
    assert (code, result["verdict"]) == (0, "within tolerance")
    assert verdicts(result) == {
        "data/values.csv": "only its hash is known",
        "reports/numbers.json": "within tolerance",
    }
    (mean,) = result["outputs"][1]["differences"]
    assert mean["where"] == "mean" and 0 < mean["relative"] < 1e-14
    assert all(f"- in {kind}: " in said for kind in result["tolerances"])


def test_what_an_earlier_run_left_is_not_taken_for_what_this_one_wrote(audited, project):
    (project / "report.py").write_text("")
    commit(project)
    assert (project / "reports/numbers.json").exists()
    code, _, message, result = audited(project)
    assert (
        code == 1
        and result == {}
        and "error: audit: the run of the clone ended with an error" in message
    )


def test_without_a_commit_or_a_lock_there_is_nothing_to_audit(audited, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    assert run(*GIT, "init", "-q", cwd=empty).returncode == 0
    code, _, message, _ = audited(empty)
    assert code == 1 and "an audit needs a repository with a commit" in message
    (empty / "dvc.yaml").write_text(STAGES)
    commit(empty)
    code, _, message, _ = audited(empty)
    assert code == 1 and "no lock file is committed" in message
