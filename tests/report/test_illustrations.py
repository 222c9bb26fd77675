"""A figure comes with its picture, its script, its stages and the very tables behind it."""

from __future__ import annotations

import base64
import gzip
import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.errors import ContractError
from pipeline.report.graph import Stage
from pipeline.report.illustrations import LONGEST, PLAIN, download, download_behind, illustrations, picture

CAPTION = {
    "title": "Spread",
    "caption": "Red is recorded. Blue is modelled. To look at: whether blue follows red.",
    "numbers": {"rms": 0.1},
    "sources": ["data/score/deviation.parquet", "reports/metrics/motion.json"],
    "script": "pipeline/figures/joint_std.py",
}
STAGES = [
    Stage("fit", "", [], ["data/fit/*", "reports/metrics/fit_*.json"], []),
    Stage("score", "", [], ["data/score", "reports/metrics/motion.json"], ["fit"]),
    Stage("wrench", "", [], ["data/wrench"], []),
]


def content(address: str) -> bytes:
    data = base64.b64decode(address.partition(";base64,")[2])
    return gzip.decompress(data) if address.startswith("data:application/gzip") else data


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for folder in ("data/score", "reports/figures", "reports/tables"):
        Path(folder).mkdir(parents=True)
    Path("reports/figures/spread.svg").write_text("<svg/>")
    Path("reports/figures/spread.png").write_bytes(b"a picture of more bytes")
    return tmp_path


def written(name: str, rows: pd.DataFrame) -> Path:
    file = Path(f"data/score/{name}.parquet")
    rows.to_parquet(file)
    return file


def test_a_figure_has_its_caption_apart_from_what_to_look_at_and_names_what_made_it(project):
    written("deviation", pd.DataFrame({"k": [0, 1], "s1": [0.0, 1 / 3]}))
    (found,) = illustrations({"spread": CAPTION}, Path("reports/figures"), Path("reports/tables"), STAGES, ["additive"])
    assert found.caption == "Red is recorded. Blue is modelled." and found.look == "Whether blue follows red."
    assert found.alternative == "Spread. Red is recorded."
    assert found.stages == ["score", "figures"] and found.script == CAPTION["script"] and found.numbers == {"rms": 0.1}
    (table,) = found.downloads
    assert (table.name, table.source, table.rows) == ("deviation.csv", "data/score/deviation.parquet", 2)
    assert content(table.address) == b"k,s1\n0,0\n1,0.33333\n"


def test_the_smaller_picture_is_taken(project):
    folder = Path("reports/figures")
    assert picture(folder, "spread").startswith("data:image/svg+xml;")
    (folder / "spread.png").write_bytes(b"png")
    assert picture(folder, "spread") == "data:image/png;base64,cG5n"


def test_a_table_of_the_reports_is_offered_as_it_is_and_only_there(project):
    text = "k,s1\n0,0.1234567890123\n"
    Path("reports/tables/deviation.csv").write_text(text)
    whole = download(Path("reports/tables/deviation.csv"))
    assert content(whole.address).decode() == text and whole.rows == 1
    behind = download_behind(Path("data/score/deviation.parquet"), Path("reports/tables"), [])
    assert behind.address == "" and behind.name == whole.name


def test_a_long_table_is_compressed_and_whole(project):
    rows = pd.DataFrame({"value": np.arange(PLAIN // 5)})
    found = download_behind(written("long", rows), Path("reports/tables"), [])
    assert found.name == "long.csv.gz" and found.bytes < PLAIN / 2
    pd.testing.assert_frame_equal(pd.read_csv(io.BytesIO(content(found.address))), rows)


def test_of_a_very_long_table_the_models_that_are_drawn_are_taken_and_that_is_said(project):
    rows = pd.DataFrame({"model": np.repeat(["additive", "scaled"], LONGEST), "value": 1})
    found = download_behind(written("filter_error", rows), Path("reports/tables"), ["additive"])
    assert found.rows == LONGEST and "additive alone" in found.lacks
    assert b"scaled" not in content(found.address)


def test_a_table_that_is_gone_is_named(project):
    with pytest.raises(ContractError, match=r"gone\.parquet"):
        download_behind(Path("data/score/gone.parquet"), Path("reports/tables"), [])
