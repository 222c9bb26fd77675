"""The smallest module of each kind that CONTRIBUTING.md names works under a new name, without an
edit of any other file.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from project_copy import ROOT, copy_project, run

from pipeline.core.typed_yaml import read_yaml

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
KINDS = {"model": "models", "figure": "figures", "format": "formats", "study": "studies"}
COPIED = "copied"  # name of every copy


def smallest(kind: str) -> Path:
    """The path below the project of the module that the page names for ``kind``."""
    section = re.search(rf"^## A {kind}\n(.*?)(?=^## )", PAGE, re.MULTILINE | re.DOTALL)[1]
    return Path(re.search(rf"\]\((pipeline/{KINDS[kind]}/[\w/.]+)\)", section)[1])


def copied(project: Path, place: Path) -> Path:
    """Copy the module or package at ``place`` under the name COPIED, imports of itself included."""
    target = place.with_name(COPIED + place.suffix)
    if place.suffix:
        shutil.copy(project / place, project / target)
        return target
    ignored = shutil.ignore_patterns("__pycache__", "dvc.lock")
    shutil.copytree(project / place, project / target, ignore=ignored)
    for file in (project / target).rglob("*.*"):
        if file.suffix in (".py", ".yaml"):
            text = file.read_text(encoding="utf-8")
            package = str(place).replace("/", ".")
            text = text.replace(package, str(target).replace("/", "."))
            text = text.replace(str(place), str(target))
            text = re.sub(
                rf"\b(reports|data)/studies/{place.name}\b", rf"\1/studies/{COPIED}", text
            )
            text = re.sub(rf"^  {place.name}:", f"  {COPIED}:", text, flags=re.MULTILINE)
            text = text.replace(f"pipeline {place.name}", f"pipeline {COPIED}")
            text = text.replace(f'"kind": "{place.name}"', f'"kind": "{COPIED}"')
            file.write_text(text, encoding="utf-8")
    return target


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A copy of the project with a copy of the smallest module of every kind."""
    folder = tmp_path_factory.mktemp("contributing") / "project"
    copy_project(folder)
    for kind in KINDS:
        copied(folder, smallest(kind))
    model = smallest("model").name
    text = (folder / f"pipeline/conf/model/{model}.yaml").read_text(encoding="utf-8")
    text = text.replace(f"kind: {model}", f"kind: {COPIED}")
    (folder / f"pipeline/conf/model/{COPIED}.yaml").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.slow
def test_a_copied_model_is_configured_and_fits(project):
    parameters = (project / "params.yaml").read_text()
    chosen = re.sub(r"(?m)^models: \[.*?\]", f"models: [additive, {COPIED}]", parameters)
    (project / "params.yaml").write_text(chosen)
    done = run("python", "-m", "pipeline", "configure", cwd=project)
    assert done.returncode == 0, done.stderr
    assert f"kind: {COPIED}" in (project / "data/config.yaml").read_text()
    code = (
        "import numpy as np; from pipeline.models.kinds import build_model, kinds; "
        f"assert '{COPIED}' in kinds(); "
        f"print(build_model({{'kind': '{COPIED}', 'noise_covariance': np.eye(3).tolist()}}))"
    )
    built = run("python", "-c", code, cwd=project)
    assert built.returncode == 0 and "ScaledModel" in built.stdout, built.stderr


@pytest.mark.slow
def test_a_copied_figure_and_a_copied_format_are_found_by_their_place(project):
    code = (
        "from pipeline import formats; from pipeline.figures.drawing import figures_in; "
        "from pipeline.formats.format import formats_in; "
        f"assert '{COPIED}' in figures_in(); "
        "names = [one.name for one in formats_in(formats)]; "
        "print(max(names.count(name) for name in names))"
    )
    done = run("python", "-c", code, cwd=project)
    assert (done.returncode, done.stdout.strip()) == (0, "2"), done.stderr


@pytest.mark.slow
def test_a_copied_study_is_a_command_and_a_stage(project):
    assert f" {COPIED}" in run("python", "-m", "pipeline", "--help", cwd=project).stdout
    stages = run("dvc", "stage", "list", "--all", "--name-only", cwd=project)
    assert f"pipeline/studies/{COPIED}/dvc.yaml:{COPIED}" in stages.stdout, stages.stderr


def test_the_way_of_a_take_names_files_and_functions_that_exist():
    way = re.search(r"^## The way of one take\n(.*?)(?=^## )", PAGE, re.MULTILINE | re.DOTALL)[1]
    files = [ROOT / name for name in re.findall(r"`(pipeline/[\w/]+\.py)`", way)]
    assert files and all(file.is_file() for file in files)
    code = "\n".join(file.read_text(encoding="utf-8") for file in files)
    functions = {name for name in re.findall(r"`([a-z_]+)`", way) if f"def {name}(" in code}
    assert {"read_take", "read_motive", "track_rows", "process_noise", "draw"} <= functions
    tables = read_yaml(ROOT / "pipeline/core/tables.yaml")
    assert {*re.findall(r"`([a-z_]+)`", way)} - functions - {*tables} == {"joint_std"}
