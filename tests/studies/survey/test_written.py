"""The table of a survey is written as its points come, and is the one they would be joined at
once.
"""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd
import pytest
from pyarrow.parquet import ParquetFile

from pipeline.core import contracts
from pipeline.studies.survey import written
from pipeline.studies.survey.conditions import WrenchCondition
from pipeline.studies.survey.points import TABLES, point


@pytest.fixture(scope="module")
def points(study, tmp_path_factory) -> list[pd.DataFrame]:
    """Points as they are read back, of which the second has no evidence."""
    folder = tmp_path_factory.mktemp("point")
    contracts.write(
        point(WrenchCondition(1, (2,)), study).assign(point="a"), "survey", folder, TABLES
    )
    one = contracts.read("survey", folder, TABLES)
    empty = one.assign(
        point="b",
        value=float("nan"),
        than=float("nan"),
        low=float("nan"),
        high=float("nan"),
        holds="no evidence",
    )
    return [one, empty, one.assign(point="c")]


@pytest.mark.parametrize("group", [1, 30, 100_000])
def test_points_written_one_after_the_other_are_the_joined_table(
    points, tmp_path, monkeypatch, group
):
    monkeypatch.setattr(written, "GROUP", group)
    for number in range(2):
        (tmp_path / str(number)).mkdir()
        written.write(iter(points), tmp_path / str(number))
    assert contracts.read("survey", tmp_path / "0", TABLES).equals(
        pd.concat(points, ignore_index=True)
    )
    one, other = (tmp_path / name / "survey.parquet" for name in "01")
    assert one.read_bytes() == other.read_bytes()
    assert ParquetFile(one).num_row_groups == {1: 3, 100_000: 1}.get(group, 2)


def test_no_more_than_a_group_of_points_is_held(points, tmp_path, monkeypatch):
    monkeypatch.setattr(written, "GROUP", 3 * len(points[0]))
    held: list[int] = []
    original = pd.concat

    def counted(tables: list[pd.DataFrame], **options: object) -> pd.DataFrame:
        held.append(len(tables))
        return original(tables, **options)

    def many() -> Iterator[pd.DataFrame]:
        for _ in range(5):
            yield from points

    monkeypatch.setattr(written.pd, "concat", counted)
    written.write(many(), tmp_path)
    assert held == [3] * 5 and ParquetFile(
        tmp_path / "survey.parquet"
    ).metadata.num_rows == 15 * len(points[0])
