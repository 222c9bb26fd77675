"""A project with the page of results, from a whole run and a page of a study."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from project_copy import run

from pipeline.verdicts.run import read_run

STUDY = """# What a study finds

![A figure](drawn/figures/drawn.png)

## Rows

| a | wide | table | of | many | columns |
|---|---|---|---|---|---|
| 1 | 22222222222222222222 | 33333333333333333333 | 44444444444444444444 | 555555555555555 | 66 |
"""


@pytest.fixture(scope="session")
def results(reproduced: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reproduced project with the numbers of a second dataset, a real robot's without test
    takes, a page of a study, and the page of all.
    """
    folder = tmp_path_factory.mktemp("results") / "project"
    shutil.copytree(reproduced, folder, symlinks=True)
    here = read_run(folder / "reports/datasets/youbot.json")
    metrics = {
        name: values
        for name, values in here.metrics.items()
        if name.startswith(("motion", "fit", "simulate"))
    }
    other = replace(here, dataset="another", synthetic=False, metrics=metrics, tables={})
    (folder / "reports/datasets/another.json").write_text(other.to_json(), encoding="utf-8")
    figures = folder / "reports/studies/drawn/figures"
    figures.mkdir(parents=True)
    Image.new("RGB", (300, 200), "white").save(figures / "drawn.png")
    (folder / "reports/studies/drawn.md").write_text(STUDY, encoding="utf-8")
    for command in (("dvc", "repro"), ("python", "-m", "pipeline", "page")):
        done = run(*command, cwd=folder)
        assert done.returncode == 0, done.stdout + done.stderr
    return folder
