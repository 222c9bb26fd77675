"""The smallest module of each kind that CONTRIBUTING.md names works under a new name, without an
edit of any other file.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from project_copy import ROOT, copy_project, set_parameters, succeeds

from pipeline.core.typed_yaml import read_yaml

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
KINDS = {"model": "models", "figure": "figures", "format": "formats", "study": "studies"}
COPIED = "copied"  # name of every copy


def section(title: str) -> str:
    return re.search(rf"^## {title}\n(.*?)(?=^## )", PAGE, re.MULTILINE | re.DOTALL)[1]


def copy_smallest(project: Path, kind: str) -> str:
    """Copy the module or package that the page names for ``kind`` under the name COPIED, imports of
    itself included; return its own name.
    """
    place = re.search(rf"\]\((pipeline/{KINDS[kind]}/[\w/.]+)\)", section(f"A {kind}"))[1]
    source, target = project / place, project / Path(place).with_name(COPIED + Path(place).suffix)
    if source.is_file():
        shutil.copy(source, target)
        return source.stem
    shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "dvc.lock"))
    name, own = source.name, place.replace("/", ".")
    for file in (file for file in target.rglob("*.*") if file.suffix in (".py", ".yaml")):
        text = file.read_text(encoding="utf-8")
        for words in (own, place):
            text = text.replace(words, words.removesuffix(name) + COPIED)
        # the study's folders, stage and command, and the kind of a model
        text = re.sub(rf"(?m)(/studies/|^  |pipeline |\"kind\": \"){name}\b", rf"\1{COPIED}", text)
        file.write_text(text, encoding="utf-8")
    return name


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A copy of the project with a copy of the smallest module of every kind."""
    folder = tmp_path_factory.mktemp("contributing") / "project"
    copy_project(folder)
    model, *_ = (copy_smallest(folder, kind) for kind in KINDS)
    options = folder / f"pipeline/conf/model/{model}.yaml"
    text = options.read_text(encoding="utf-8").replace(f"kind: {model}", f"kind: {COPIED}")
    options.with_stem(COPIED).write_text(text, encoding="utf-8")
    return folder


@pytest.mark.slow
def test_a_copied_model_is_configured_and_fits(project):
    set_parameters(project, models=f"[additive, {COPIED}]")
    succeeds("python", "-m", "pipeline", "configure", cwd=project)
    assert f"kind: {COPIED}" in (project / "data/config.yaml").read_text()
    code = (
        "import numpy as np; from pipeline.models.kinds import build_model, kinds; "
        f"assert '{COPIED}' in kinds(); "
        f"print(build_model({{'kind': '{COPIED}', 'noise_covariance': np.eye(3).tolist()}}))"
    )
    assert "ScaledModel" in succeeds("python", "-c", code, cwd=project)


@pytest.mark.slow
def test_a_copied_figure_format_and_study_are_found_by_their_place(project):
    code = (
        "from pipeline import formats; from pipeline.figures.drawing import figures_in; "
        "from pipeline.formats.format import formats_in; "
        f"assert '{COPIED}' in figures_in(); "
        "names = [one.name for one in formats_in(formats)]; "
        "print(max(names.count(name) for name in names))"
    )
    assert succeeds("python", "-c", code, cwd=project).strip() == "2"
    assert f" {COPIED}" in succeeds("python", "-m", "pipeline", "--help", cwd=project)
    stages = succeeds("dvc", "stage", "list", "--all", "--name-only", cwd=project)
    assert f"pipeline/studies/{COPIED}/dvc.yaml:{COPIED}" in stages


def test_the_way_of_a_take_names_files_and_functions_that_exist():
    way = section("The way of one take")
    files = [ROOT / name for name in re.findall(r"`(pipeline/[\w/]+\.py)`", way)]
    assert files and all(file.is_file() for file in files)
    code = "\n".join(file.read_text(encoding="utf-8") for file in files)
    functions = {name for name in re.findall(r"`([a-z_]+)`", way) if f"def {name}(" in code}
    assert {"read_take", "read_motive", "follower", "process_noise", "draw"} <= functions
    tables = read_yaml(ROOT / "pipeline/core/tables.yaml")
    assert {*re.findall(r"`([a-z_]+)`", way)} - functions - {*tables} == {"joint_std"}
