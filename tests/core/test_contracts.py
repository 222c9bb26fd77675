"""The tables between stages: every declared column refuses what it should, and writing is exact."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pytest

from pipeline.core import columns, contracts
from pipeline.core.contracts import PAPER, Column, declared, expanded
from pipeline.core.errors import ContractError

PIPELINE = PAPER.parents[1]


# every file of declarations, by the folder it lies in: core or a study
FILES = {file.parent.name: file for file in sorted(PIPELINE.glob("**/tables.yaml"))}


TABLES = [(place, name) for place, file in FILES.items() for name in declared(file)]


JOINTS = ("base", "tip")  # of which the families have columns here


ROWS = 4


@cache
def declaration(place: str, name: str) -> dict[str, Column]:
    """The columns of one table, its families those of JOINTS."""
    written = declared(FILES[place])[name]
    present = []
    for column in written:
        family, _, places = column.partition(":")
        naming = {"": lambda family, _: [family], "*": columns.columns, "*:*": columns.pairs}
        present += naming[places](family, JOINTS)
    return expanded(written, present)


COLUMNS = [(*where, column) for where in TABLES for column in declaration(*where)]


def some(column: Column) -> list:
    """ROWS values that fit the column."""
    match column.kind:
        case "real" | "log":
            low, high = max(column.low, -1.0), min(column.high, max(column.low, -1.0) + 4.0)
            return np.linspace(low, high, ROWS).tolist()
        case "count":
            return list(range(int(column.low), int(column.low) + ROWS))
        case "flag":
            return [True, False] * (ROWS // 2)
    return [(column.among or "a")[0]] * ROWS


def table(name: str, place: str = "core") -> pd.DataFrame:
    return pd.DataFrame({key: some(column) for key, column in declaration(place, name).items()})


def spoiled(column: Column) -> list[tuple[str, list]]:
    """What the column must refuse: a name for it, and values of which the last is the bad one."""
    good = some(column)[:-1]
    bad = {
        "real": [("infinite", np.inf), ("minus infinity", -np.inf), ("text", "1.0")],
        "log": [("infinite", np.inf), ("text", "1.0")],  # minus infinity is a value there
        "count": [("fraction", 1.5), ("not a number", np.nan), ("text", "1")],
        "flag": [("text", "yes"), ("missing", None), ("number", 0.5)],
        "text": [("number", 3), ("missing", None)],
    }[column.kind]
    step = 1 if column.kind == "count" else 1e-9
    bad += [("not a number", np.nan)] * (column.kind == "real" and not column.gaps)
    bad += [("below", column.low - step)] * (column.low > -np.inf)
    bad += [("above", column.high + step)] * (column.high < np.inf)
    bad += [("not allowed", "something else")] * bool(column.among)
    return [(why, [*good, value]) for why, value in bad]


def test_the_papers_tables_and_those_of_studies_are_declared():
    assert "core" in FILES and len(FILES) > 1
    families = {c.partition(":")[0] for _, name, c in COLUMNS if name == "posterior" and ":" in c}
    assert families == {"m", "c"}


@pytest.mark.parametrize(("place", "name"), TABLES)
def test_a_table_that_fits_is_read_as_it_was_written(place, name, tmp_path):
    contracts.write(table(name, place), name, tmp_path, FILES[place])
    read = contracts.read(name, tmp_path, FILES[place])
    pd.testing.assert_frame_equal(read, table(name, place))
    assert contracts.exists(name, tmp_path)


@pytest.mark.parametrize(("place", "name", "column"), COLUMNS)
def test_a_column_refuses_what_does_not_fit(place, name, column, tmp_path, monkeypatch):
    # its neighbours have tests of their own
    alone = {column: declaration(place, name)[column]}
    monkeypatch.setattr(contracts, "declared", lambda _: {name: alone})
    for why, values in spoiled(alone[column]):
        with pytest.raises(ContractError, match=f"table '{name}' breaks its contract") as refused:
            contracts.write(pd.DataFrame({column: values}), name, tmp_path)
            pytest.fail(f"{why} was written")
        assert refused.value.evidence == {"file": tmp_path / f"{name}.parquet", "column": column}
        assert not contracts.exists(name, tmp_path)


@pytest.mark.parametrize(
    ("column", "value"),
    [("k", -1), ("q:tip", np.inf), ("take", None), ("part", "rehearsal"), ("t", "0.1")],
)
def test_what_another_program_wrote_is_checked_on_reading(column, value, tmp_path):
    good = some(declaration("core", "joints")[column])
    values = [value] * ROWS if column == "t" else [*good[:-1], value]
    table("joints").assign(**{column: values}).to_parquet(tmp_path / "joints.parquet")
    with pytest.raises(ContractError, match="breaks its contract") as refused:
        contracts.read("joints", tmp_path)
    assert refused.value.evidence["column"] == column


@pytest.mark.parametrize(
    ("place", "name", "column"),
    [where for where in COLUMNS if declaration(*where[:2])[where[2]].gaps],
)
def test_gaps_are_let_through_where_they_are_allowed(place, name, column, tmp_path):
    gaps = table(name, place).assign(**{column: [1.0, np.nan, np.nan, 1.0]})
    contracts.write(gaps, name, tmp_path, FILES[place])
    assert contracts.read(name, tmp_path, FILES[place])[column].isna().sum() == 2


def test_what_had_no_probability_has_a_log_density_of_minus_infinity(tmp_path):
    impossible = table("predictions").assign(mean=-np.inf)
    contracts.write(impossible, "predictions", tmp_path)
    assert np.isneginf(contracts.read("predictions", tmp_path)["mean"]).all()


@pytest.mark.parametrize(("place", "name"), TABLES)
def test_a_missing_and_an_additional_column_are_refused(place, name, tmp_path):
    columns = declared(FILES[place])[name]
    first, *_, last = [column for column, kind in columns.items() if not kind.optional]
    for column in (first, last):  # of a family, all of it
        gone = [each for each in table(name, place) if each.split(":")[0] == column.split(":")[0]]
        with pytest.raises(ContractError, match="is missing"):
            without = table(name, place).drop(columns=gone)
            contracts.write(without, name, tmp_path, FILES[place])
    with pytest.raises(ContractError, match=r"is not declared.*surplus"):
        contracts.write(table(name, place).assign(surplus=1.0), name, tmp_path, FILES[place])


def test_a_column_of_its_own_that_is_optional_may_be_missing(tmp_path):
    contracts.write(table("force_moments").drop(columns="fz"), "force_moments", tmp_path)
    assert "fz" not in contracts.read("force_moments", tmp_path)


def test_a_column_of_a_family_that_is_not_declared_is_refused(tmp_path):
    with pytest.raises(ContractError, match=r"is not declared.*w:tip"):
        contracts.write(table("joints").assign(**{"w:tip": 1.0}), "joints", tmp_path)
    # nor does a pair of joints pass for a joint
    with pytest.raises(ContractError, match=r"is not declared.*q:base:tip"):
        contracts.write(table("joints").assign(**{"q:base:tip": 1.0}), "joints", tmp_path)


def test_the_same_table_gives_the_same_bytes_whatever_its_index_and_the_order_of_its_columns(
    tmp_path,
):
    first, second = tmp_path / "first", tmp_path / "second"
    # but the joints of a family stay in the order that they are given in
    reordered = table("joints")[["residual", "q:base", "q:tip", "t", "k", "part", "take"]]
    for folder, written in (
        (first, table("joints")),
        (second, reordered.set_index(np.array([5, 3, 9, 1]))),
    ):
        folder.mkdir()
        contracts.write(written, "joints", folder)
    assert (first / "joints.parquet").read_bytes() == (second / "joints.parquet").read_bytes()
    # control: a single digit shows
    nudged = np.nextafter(table("joints")["q:base"], 9)
    contracts.write(table("joints").assign(**{"q:base": nudged}), "joints", second)
    assert (first / "joints.parquet").read_bytes() != (second / "joints.parquet").read_bytes()


def test_counts_of_any_width_are_written_as_one_and_the_table_given_is_left_alone(tmp_path):
    known = table("joints").astype({"k": "uint8"})
    contracts.write(known, "joints", tmp_path)
    assert str(contracts.read("joints", tmp_path)["k"].dtype) == "int64"
    assert str(known["k"].dtype) == "uint8"


def test_a_table_that_is_not_there_names_its_file(tmp_path):
    assert not contracts.exists("joints", tmp_path)
    with pytest.raises(ContractError, match="no table 'joints'") as refused:
        contracts.read("joints", tmp_path)
    assert refused.value.evidence["file"] == tmp_path / "joints.parquet"


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_truncated_table_is_refused(share, tmp_path):
    contracts.write(table("joints"), "joints", tmp_path)
    file = tmp_path / "joints.parquet"
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    with pytest.raises(ContractError, match="cannot be read"):
        contracts.read("joints", tmp_path)


def takes(*lengths: int) -> pd.DataFrame:
    names = [name for name, length in zip("bac", lengths, strict=False) for _ in range(length)]
    rows = np.arange(len(names))
    return pd.DataFrame({"take": names, "q:base": rows, "q:tip": -rows, "w:base": rows})


def test_takes_are_stacked_in_the_order_of_the_table():
    names, values = contracts.stacked(takes(3, 3), ["q:tip", "q:base"])
    assert names == ["b", "a"]
    assert values.tolist() == [[[0, 0], [-1, 1], [-2, 2]], [[-3, 3], [-4, 4], [-5, 5]]]
    # a family is stacked in the order of its columns
    np.testing.assert_array_equal(contracts.stacked(takes(3, 3), "q")[1], values[..., ::-1])


@pytest.mark.parametrize("lengths", [(3, 2), (3, 1), (2, 3, 1), ()])
def test_takes_of_unequal_length_or_none_are_refused(lengths):
    with pytest.raises(ContractError, match="take"):
        contracts.stacked(takes(*lengths), "q")


def test_takes_that_interleave_are_refused():
    with pytest.raises(ContractError, match="one after the other"):
        contracts.stacked(takes(3, 3).sort_values("q:base", key=lambda q: q % 3), "q")
