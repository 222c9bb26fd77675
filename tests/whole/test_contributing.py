"""Promises of CONTRIBUTING.md: the smallest module of each kind works under a new name without an
edit of any other file; the way of a take names files that exist; the audit finds an edited
constant.
"""

import re
import shutil
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from project_copy import (
    GIT,
    ROOT,
    copy_project,
    copy_reproduced,
    error_line,
    run,
    set_parameters,
    succeeds,
)

from pipeline.core.errors import PipelineError
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.audit.command import clone_commit
from pipeline.tools.audit.command import run as audit

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
KINDS = {
    "model": "models",
    "figure": "figures",
    "format": "formats",
    "study": "studies",
}
COPIED = "copied"  # name of every copy
# tests that loop over what is found by its place
CONTRACTS = [
    "tests/test_repository.py",
    "tests/test_stage_deps.py",
    "tests/test_main.py::test_help_lists_the_names_and_names_each_stage_study_and_tool",
    "tests/configuration/test_config.py",
    "tests/core/test_tables.py",
    "tests/figures/test_contents.py",
    "tests/formats/test_format.py",
    "tests/models/test_kinds.py",
    "tests/studies/test_studies.py",
    "tests/verdicts/test_claims.py",
    "tests/verdicts/test_paper.py",
]
FOUND_BY_PLACE = f"""
import numpy as np
from pipeline import formats
from pipeline.figures.drawing import figures_in
from pipeline.formats.format import formats_in
from pipeline.models.kinds import build_model, kinds

assert "{COPIED}" in kinds() and "{COPIED}" in figures_in()
names = [file_format.name for file_format in formats_in(formats)]
assert max(names.count(name) for name in names) == 2
print(build_model({{"kind": "{COPIED}", "noise_covariance": np.eye(3).tolist()}}))
"""


def section(title: str) -> str:
    return re.search(rf"^## {title}\n(.*?)(?=^## )", PAGE, re.MULTILINE | re.DOTALL)[1]


def smallest(kind: str) -> str:
    """Return the path of the module or package that the page names for ``kind``."""
    link = rf"\]\((pipeline/{KINDS[kind]}/[\w/.]+)\)"
    return re.search(link, section(f"A {kind}"))[1]


def copy_module(source: Path) -> None:
    """Copy a module under the name COPIED, and the captions of a figure, which have its name."""
    for file in (source, source.with_suffix(".yaml")):
        if not file.is_file():
            continue
        text = file.read_text(encoding="utf-8")
        text = re.sub(rf"(?m)^(def )?{source.stem}\b", rf"\1{COPIED}", text)
        file.with_stem(COPIED).write_text(text, encoding="utf-8")


def copy_package(project: Path, place: str) -> None:
    """Copy a package under the name COPIED, imports of itself included."""
    source = project / place
    target = source.with_name(COPIED)
    ignored = shutil.ignore_patterns("__pycache__", "dvc.lock")
    shutil.copytree(source, target, ignore=ignored)

    # the first word of a study's docstring, its folders, stage and command; the kind of a model
    before = r"^\"\"\"|/studies/|^  |pipeline |\"kind\": \""
    name = re.compile(rf"(?m)({before}){source.name}\b")
    for file in [*target.rglob("*.py"), *target.rglob("*.yaml")]:
        text = file.read_text(encoding="utf-8")
        for path in (place, place.replace("/", ".")):
            text = text.replace(path, path.removesuffix(source.name) + COPIED)
        file.write_text(name.sub(rf"\1{COPIED}", text), encoding="utf-8")


def copy_option_file(project: Path, model: str) -> None:
    """Copy the option file of a model for the kind COPIED."""
    options = project / f"pipeline/conf/model/{model}.yaml"
    text = options.read_text(encoding="utf-8")
    text = text.replace(f"kind: {model}", f"kind: {COPIED}")
    options.with_stem(COPIED).write_text(text, encoding="utf-8")


def copy_claim(project: Path) -> None:
    """Copy the first claim that states its numbers itself under the name COPIED."""
    file = project / "pipeline/verdicts/claims.yaml"
    text = file.read_text(encoding="utf-8")
    claims = re.findall(r"(?ms)^  - id: .*?(?=^  - id: )", text)
    claim = next(claim for claim in claims if "published.yaml" not in claim)
    copy = re.sub(r"id: .*", f"id: {COPIED}", claim, count=1)
    file.write_text(text.replace(claim, claim + copy), encoding="utf-8")


@pytest.fixture
def extended(tmp_path: Path) -> Path:
    """A copy of the project with a copy of the smallest module of each kind, and of a claim."""
    project = tmp_path / "project"
    copy_project(project)
    copy_package(project, smallest("model"))
    copy_module(project / smallest("figure"))
    copy_module(project / smallest("format"))
    copy_package(project, smallest("study"))
    copy_option_file(project, Path(smallest("model")).name)
    copy_claim(project)
    return project


@pytest.mark.slow
def test_a_copy_of_the_smallest_module_of_each_kind_is_found_by_its_place_and_works(
    extended,
):
    project = extended
    set_parameters(project, models=f"[additive, {COPIED}]")
    succeeds("python", "-m", "pipeline", "configure", cwd=project)
    assert f"kind: {COPIED}" in (project / "data/config.yaml").read_text()
    assert "AdditiveModel" in succeeds("python", "-c", FOUND_BY_PLACE, cwd=project)
    assert f" {COPIED}" in succeeds("python", "-m", "pipeline", "--help", cwd=project)

    stages = succeeds("dvc", "stage", "list", "--all", "--name-only", cwd=project)
    assert f"pipeline/studies/{COPIED}/dvc.yaml:{COPIED}" in stages


@pytest.mark.slow
def test_an_addition_breaks_no_test(extended):
    evidence = "reports/datasets"  # of the committed results
    shutil.copytree(ROOT / evidence, extended / evidence)
    # figures and studies that are drawn and run again: the copied ones only
    chosen = "-m", "not slow", "-k", f"{COPIED} or not (same_bytes or equal_bytes)"
    command = "python -m pytest -q -n 0 -p no:cacheprovider".split()
    done = run(*command, *chosen, *CONTRACTS, cwd=extended)
    assert done.returncode == 0, done.stdout

    # the control: an import against the order of the layers
    (extended / f"pipeline/models/{COPIED}/fit.py").write_text(
        "import pipeline.tools\n",
    )
    done = run(*command, "tests/test_repository.py", cwd=extended)
    assert "test_imports_run_one_way[models]" in done.stdout


def test_the_way_of_a_take_names_files_and_functions_that_exist():
    way = section("The way of one take")
    files = [ROOT / name for name in re.findall(r"`(pipeline/[\w/]+\.py)`", way)]
    assert files and all(file.is_file() for file in files)

    code = "\n".join(file.read_text(encoding="utf-8") for file in files)
    names = {*re.findall(r"`([a-z_]+)`", way)}
    functions = {name for name in names if f"def {name}(" in code}
    assert {"read_take", "read_motive", "follower", "process_noise"} <= functions

    tables = {*read_yaml(ROOT / "pipeline/tables.yaml")}
    modules = {file.stem for file in [*files, *ROOT.glob("pipeline/stages/*.py")]}
    assert names - functions - tables - modules == set()


def test_recordings_beside_the_project_lie_beside_the_clone(tmp_path):
    with pytest.raises(PipelineError, match="needs a repository with a commit"):
        clone_commit(tmp_path, tmp_path / "audit")

    project = tmp_path / "project"
    sheet = project / "data/raw/arm/dataset.yaml"
    sheet.parent.mkdir(parents=True)
    sheet.write_text("recordings: ../logs/arm\n")
    (tmp_path / "logs/arm").mkdir(parents=True)
    succeeds(*GIT, "init", "-q", cwd=project)
    succeeds(*GIT, "add", ".", cwd=project)
    succeeds(*GIT, "commit", "-qm", "arm", cwd=project)
    with pytest.raises(PipelineError, match=r"dvc\.lock is not committed"):
        clone_commit(project, tmp_path / "audit")

    (project / "dvc.lock").write_text("schema: '2.0'\nstages: {}\n")
    succeeds(*GIT, "add", ".", cwd=project)
    succeeds(*GIT, "commit", "-qm", "lock", cwd=project)
    assert (clone_commit(project, tmp_path / "audit") / "../logs/arm").is_dir()


@pytest.mark.slow
def test_outputs_are_deleted_before_the_run(tmp_path, monkeypatch, capfd):
    """Also those that DVC would leave to the stage (persist)."""
    project = tmp_path / "project"
    project.mkdir()
    command = "cmd: test ! -e n.txt && echo 1 > n.txt"
    stage = f"{command}\n    outs: [n.txt: {{cache: false, persist: true}}]"
    (project / "dvc.yaml").write_text(f"stages:\n  count:\n    {stage}\n")
    for words in (
        [*GIT, "init", "-q"],
        ["dvc", "init", "-q"],
        ["dvc", "repro", "-q"],
        [*GIT, "add", "."],
        [*GIT, "commit", "-qm", "counted"],
    ):
        succeeds(*words, cwd=project)
    monkeypatch.chdir(project)
    audit(tmp_path / "audit")

    assert "audit: 1 stages run again, every file equal" in capfd.readouterr().out


@pytest.mark.slow
def test_a_constant_that_was_edited_without_a_run_is_found(reproduced, tmp_path):
    folder = copy_reproduced(reproduced, tmp_path / "altered")
    stages = read_yaml(folder / "dvc.yaml")["stages"]
    chosen = {name: stages[name] for name in ("choose", "configure", "files", "wrench")}
    chosen["ingest"] = stages["ingest"] | {"matrix": {"part": ["force"]}}
    OmegaConf.save({"stages": chosen}, folder / "dvc.yaml")
    for pattern in ("pipeline/**/dvc.yaml", "data/raw/*/dvc.yaml"):
        for file in folder.glob(pattern):
            if file.parent.name != "youbot":
                file.unlink()

    # draws of the model for every measured sample of the force
    file = folder / "pipeline/wrench/measured_force.py"
    edited, count = re.subn(r"(?m)^DRAWS = 10\b", "DRAWS = 9", file.read_text())
    assert count == 1
    file.write_text(edited)
    succeeds(*GIT, "commit", "-qam", "edited", cwd=folder)
    done = run(
        "python",
        "-m",
        "pipeline",
        "audit",
        str(tmp_path / "edited"),
        cwd=folder,
    )
    # and everything else is equal to the commit
    changed = {line[3:] for line in done.stdout.splitlines() if line.startswith(" M ")}
    assert changed == {"dvc.lock"}, done.stderr
    assert "differ from the commit" in error_line(done)
