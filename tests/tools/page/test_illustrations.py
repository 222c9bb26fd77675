"""A figure comes with its picture, its script, its stages and the very tables behind it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pipeline.core.errors import ContractError
from pipeline.tools.page.illustrations import SHOWN, illustrations, table, table_behind
from pipeline.tools.page.pictures import picture
from pipeline.tools.page.stages import StageRun

CAPTION = {
    "title": "Spread",
    "caption": "Red is recorded. Blue is modelled. To look at: whether blue follows red.",
    "numbers": {"rms": 0.1},
    "sources": ["data/score/deviation.parquet", "reports/metrics/motion.json"],
    "script": "pipeline/figures/joint_std.py",
}
RUNS = [
    StageRun("fit@a", "fit", "", "", {}, {"data/fit/a": "", "reports/metrics/fit_a.json": ""}),
    StageRun("score", "score", "", "", {}, {"data/score": "", "reports/metrics/motion.json": ""}),
    StageRun("wrench", "wrench", "", "", {}, {"data/wrench": ""}),
]
FIGURES, TABLES = Path("reports/figures"), Path("reports/tables")


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for folder in (Path("data/score"), FIGURES, TABLES):
        folder.mkdir(parents=True)
    shades = np.random.default_rng(1).integers(200, 256, (40, 60, 3), dtype=np.uint8)
    Image.fromarray(shades).save(FIGURES / "spread.png")
    pd.DataFrame({"k": [0, 1], "s": [0.0, 1 / 3]}).to_parquet("data/score/deviation.parquet")
    return tmp_path


def test_a_figure_has_its_caption_apart_from_what_to_look_at_and_names_what_made_it(project):
    (figure,) = illustrations({"spread": CAPTION}, FIGURES, TABLES, RUNS)
    assert figure.caption == "Red is recorded. Blue is modelled."
    assert figure.look == "Whether blue follows red."
    assert figure.alternative == "Spread. Red is recorded."
    assert figure.stages == ["score", "figures"]
    assert (figure.script, figure.numbers) == (CAPTION["script"], {"rms": 0.1})
    (behind,) = figure.tables
    assert (behind.file, behind.count) == (Path("data/score/deviation.parquet"), 2)


def test_a_picture_is_the_file_beside_the_page_and_one_that_is_gone_is_named(project):
    shown = picture(FIGURES / "spread.png")
    assert (shown.file, shown.width, shown.height) == (FIGURES / "spread.png", 60, 40)
    with pytest.raises(ContractError, match=r"gone\.png"):
        picture(FIGURES / "gone.png")


def test_a_table_of_the_reports_stands_for_the_one_behind(project):
    (TABLES / "deviation.csv").write_text("k,s\n0,0.1234567890123\n")
    behind = table_behind(Path("data/score/deviation.parquet"), TABLES)
    assert (behind.file, behind.count) == (TABLES / "deviation.csv", 1)


def test_a_table_shows_its_first_rows_rounded(project):
    rows = pd.DataFrame({"a_name": ["x"] * 40, "value": np.arange(40) + 1 / 3, "on": True})
    rows.to_csv(TABLES / "long.csv", index=False)
    shown = table(TABLES / "long.csv")
    assert shown.count == 40 and len(shown.rows) == SHOWN and shown.header[0] == "a name"
    assert shown.rows[2] == ["x", "2.333", "True"]


def test_a_table_that_is_gone_is_named(project):
    with pytest.raises(ContractError, match=r"gone\.parquet"):
        table_behind(Path("data/score/gone.parquet"), TABLES)
