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
FOUND_BY_PLACE = f"""
import numpy as np
from pipeline import formats
from pipeline.figures.drawing import figures_in
from pipeline.formats.format import formats_in
from pipeline.models.kinds import build_model, kinds

assert "{COPIED}" in kinds() and "{COPIED}" in figures_in()
names = [one.name for one in formats_in(formats)]
assert max(names.count(name) for name in names) == 2
print(build_model({{"kind": "{COPIED}", "noise_covariance": np.eye(3).tolist()}}))
"""


def section(title: str) -> str:
    return re.search(rf"^## {title}\n(.*?)(?=^## )", PAGE, re.MULTILINE | re.DOTALL)[1]


def copy_smallest(project: Path, kind: str) -> str:
    """Copy the module or package that the page names for ``kind`` under the name COPIED, imports of
    itself included; return its own name.
    """
    place = re.search(rf"\]\((pipeline/{KINDS[kind]}/[\w/.]+)\)", section(f"A {kind}"))[
        1
    ]
    source, target = (
        project / place,
        project / Path(place).with_name(COPIED + Path(place).suffix),
    )
    if source.is_file():
        # with the captions of a figure, which has the name of its module
        for file in {source, source.with_suffix(".yaml")} & {*source.parent.iterdir()}:
            text = file.read_text(encoding="utf-8")
            text = re.sub(rf"(?m)^(def )?{source.stem}\b", rf"\1{COPIED}", text)
            file.with_stem(COPIED).write_text(text, encoding="utf-8")
        return source.stem
    shutil.copytree(
        source, target, ignore=shutil.ignore_patterns("__pycache__", "dvc.lock")
    )
    name, own = source.name, place.replace("/", ".")
    for file in (
        file for file in target.rglob("*.*") if file.suffix in (".py", ".yaml")
    ):
        text = file.read_text(encoding="utf-8")
        for words in (own, place):
            text = text.replace(words, words.removesuffix(name) + COPIED)
        # the study's folders, stage and command, and the kind of a model
        text = re.sub(
            rf"(?m)(/studies/|^  |pipeline |\"kind\": \"){name}\b", rf"\1{COPIED}", text
        )
        file.write_text(text, encoding="utf-8")
    return name


@pytest.mark.slow
def test_a_copy_of_the_smallest_module_of_each_kind_is_found_by_its_place_and_works(
    tmp_path,
):
    project = tmp_path / "project"
    copy_project(project)
    model, *_ = (copy_smallest(project, kind) for kind in KINDS)
    options = project / f"pipeline/conf/model/{model}.yaml"
    text = options.read_text(encoding="utf-8").replace(
        f"kind: {model}", f"kind: {COPIED}"
    )
    options.with_stem(COPIED).write_text(text, encoding="utf-8")
    set_parameters(project, models=f"[additive, {COPIED}]")
    succeeds("python", "-m", "pipeline", "configure", cwd=project)
    assert f"kind: {COPIED}" in (project / "data/config.yaml").read_text()
    assert "AdditiveModel" in succeeds("python", "-c", FOUND_BY_PLACE, cwd=project)
    assert f" {COPIED}" in succeeds("python", "-m", "pipeline", "--help", cwd=project)
    stages = succeeds("dvc", "stage", "list", "--all", "--name-only", cwd=project)
    assert f"pipeline/studies/{COPIED}/dvc.yaml:{COPIED}" in stages


def test_the_way_of_a_take_names_files_and_functions_that_exist():
    way = section("The way of one take")
    files = [ROOT / name for name in re.findall(r"`(pipeline/[\w/]+\.py)`", way)]
    assert files and all(file.is_file() for file in files)
    code = "\n".join(file.read_text(encoding="utf-8") for file in files)
    functions = {
        name for name in re.findall(r"`([a-z_]+)`", way) if f"def {name}(" in code
    }
    assert {
        "read_take",
        "read_motive",
        "follower",
        "process_noise",
        "joint_std",
    } <= functions
    known = {*read_yaml(ROOT / "pipeline/tables.yaml")} | {file.stem for file in files}
    known |= {file.stem for file in ROOT.glob("pipeline/stages/*.py")}
    assert {*re.findall(r"`([a-z_]+)`", way)} - functions - known == set()


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
    stages = OmegaConf.to_container(OmegaConf.load(folder / "dvc.yaml"))["stages"]
    stages = {
        name: stages[name]
        for name in ("choose", "configure", "files", "ingest", "wrench")
    }
    stages["ingest"]["matrix"] = {"part": ["force"]}
    OmegaConf.save({"stages": stages}, folder / "dvc.yaml")
    for other in [
        *folder.glob("pipeline/**/dvc.yaml"),
        *folder.glob("data/raw/*/dvc.yaml"),
    ]:
        if other.parent.name != "youbot":
            other.unlink()

    # draws of the model for every measured sample of the force
    file = folder / "pipeline/wrench/measured_force.py"
    edited, found = re.subn(r"(?m)^DRAWS = 10\b", "DRAWS = 9", file.read_text())
    assert found == 1
    file.write_text(edited)
    succeeds(*GIT, "commit", "-qam", "edited", cwd=folder)
    done = run(
        "python", "-m", "pipeline", "audit", str(tmp_path / "edited"), cwd=folder
    )
    # and everything else is equal to the commit
    changed = {line[3:] for line in done.stdout.splitlines() if line.startswith(" M ")}
    assert changed == {"dvc.lock"}, done.stderr
    assert "differ from the commit" in error_line(done)
