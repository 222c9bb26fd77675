"""The tables between stages: every column refuses what it should, and writing is exact, repeatable and all or nothing."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from pipeline import contracts
from pipeline.errors import ContractError
from pipeline.tables import TABLES

COLUMNS = [(name, column) for name, columns in TABLES.items() for column in columns]
ROWS = 4


def kind_of(name: str, column: str) -> str:
    kind = str(TABLES[name][column].dtype)
    return "text" if kind.startswith("str") else kind


def bounds(name: str, column: str) -> dict[str, object]:
    """Of one column: its least and greatest value and the values it may take, as far as it states them."""
    statistics = {}
    for check in TABLES[name][column].checks or []:
        statistics |= check.statistics or {}
    return statistics


def some(name: str, column: str) -> list:
    """ROWS values that fit the column."""
    kind, rules = kind_of(name, column), bounds(name, column)
    if kind == "float64":
        low, high = rules.get("min_value", -1.0), rules.get("max_value", 3.0)
        return np.linspace(low, high, ROWS).tolist()
    if kind == "int64":
        return list(range(rules["min_value"], rules["min_value"] + ROWS))
    if kind == "bool":
        return [True, False] * (ROWS // 2)
    return [rules["allowed_values"][0] if "allowed_values" in rules else "a"] * ROWS


def table(name: str) -> pd.DataFrame:
    return pd.DataFrame({column: some(name, column) for column in TABLES[name]})


def spoiled(name: str, column: str) -> list[tuple[str, list]]:
    """What the column must refuse: a name for it, and values of which the last is the bad one."""
    kind, rules, good = kind_of(name, column), bounds(name, column), some(name, column)[:-1]
    bad = {
        "float64": [("infinite", np.inf), ("text", "1.0")],
        "int64": [("fraction", 1.5), ("not a number", np.nan), ("text", "1"), ("below", rules.get("min_value", 0) - 1)],
        "bool": [("text", "yes"), ("missing", None), ("number", 0.5)],
        "text": [("number", 3), ("missing", None)],
    }[kind]
    if kind == "float64":
        logarithm = any(check.error == "must not be plus infinity" for check in TABLES[name][column].checks)
        bad += [("infinite", np.inf if logarithm else -np.inf)]  # of a log density minus infinity is a value
        bad += [("not a number", np.nan)] * (not TABLES[name][column].nullable)
        bad += [("below", rules["min_value"] - 1e-9)] if "min_value" in rules else []
        bad += [("above", rules["max_value"] + 1e-9)] if "max_value" in rules else []
    if "allowed_values" in rules:
        bad.append(("not allowed", "something else"))
    return [(why, [*good, value]) for why, value in bad]


@pytest.mark.parametrize("name", TABLES)
def test_a_table_that_fits_is_read_as_it_was_written(name, tmp_path):
    contracts.write(table(name), name, tmp_path)
    pd.testing.assert_frame_equal(contracts.read(name, tmp_path), table(name))
    assert contracts.exists(name, tmp_path)


@pytest.mark.parametrize(("name", "column"), COLUMNS)
def test_a_column_refuses_what_does_not_fit(name, column, tmp_path, monkeypatch):
    monkeypatch.setitem(TABLES, name, {column: TABLES[name][column]})  # its neighbours have tests of their own
    for why, values in spoiled(name, column):
        with pytest.raises(ContractError, match=f"table '{name}' breaks its contract") as refused:
            contracts.write(pd.DataFrame({column: values}), name, tmp_path)
            pytest.fail(f"{why} was written")
        assert refused.value.evidence == {"file": tmp_path / f"{name}.parquet", "column": column}
        assert not contracts.exists(name, tmp_path)


@pytest.mark.parametrize(("column", "value"), [("k", -1), ("q1", np.inf), ("take", None), ("part", "rehearsal"), ("t", "0.1")])
def test_what_another_program_wrote_is_checked_on_reading(column, value, tmp_path):
    values = [value] * ROWS if column == "t" else [*some("joints", column)[:-1], value]
    table("joints").assign(**{column: values}).to_parquet(tmp_path / "joints.parquet")
    with pytest.raises(ContractError, match="breaks its contract") as refused:
        contracts.read("joints", tmp_path)
    assert refused.value.evidence["column"] == column


@pytest.mark.parametrize(("name", "column"), [(n, c) for n, c in COLUMNS if TABLES[n][c].nullable])
def test_gaps_are_let_through_where_they_are_allowed(name, column, tmp_path):
    contracts.write(table(name).assign(**{column: [0.0, np.nan, np.nan, 1.0]}), name, tmp_path)
    assert contracts.read(name, tmp_path)[column].isna().sum() == 2


def test_what_had_no_probability_has_a_log_density_of_minus_infinity(tmp_path):
    impossible = table("one_step_scores").assign(log_density=-np.inf)
    contracts.write(impossible, "one_step_scores", tmp_path)
    assert np.isneginf(contracts.read("one_step_scores", tmp_path)["log_density"]).all()


@pytest.mark.parametrize("name", TABLES)
def test_a_missing_and_an_additional_column_are_refused(name, tmp_path):
    first, *_, last = TABLES[name]
    for column in (first, last):
        with pytest.raises(ContractError, match=f"column_in_dataframe, found {column}"):
            contracts.write(table(name).drop(columns=column), name, tmp_path)
    with pytest.raises(ContractError, match="column_in_schema, found surplus"):
        contracts.write(table(name).assign(surplus=1.0), name, tmp_path)


def test_the_same_table_gives_the_same_bytes_whatever_its_index_and_the_order_of_its_columns(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    for folder, written in ((first, table("joints")), (second, table("joints").iloc[:, ::-1].set_index(np.array([5, 3, 9, 1])))):
        folder.mkdir()
        contracts.write(written, "joints", folder)
    assert (first / "joints.parquet").read_bytes() == (second / "joints.parquet").read_bytes()
    # control: a single digit shows
    contracts.write(table("joints").assign(q1=np.nextafter(table("joints").q1, 9)), "joints", second)
    assert (first / "joints.parquet").read_bytes() != (second / "joints.parquet").read_bytes()


def test_counts_of_any_width_are_written_as_one_and_the_table_given_is_left_alone(tmp_path):
    given = table("joints").astype({"k": "uint8"})
    contracts.write(given, "joints", tmp_path)
    assert str(contracts.read("joints", tmp_path)["k"].dtype) == "int64"
    assert str(given["k"].dtype) == "uint8"


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


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf, np.float64("nan")])
def test_metrics_that_are_no_numbers_are_refused_and_the_old_ones_stay(broken, tmp_path):
    file = tmp_path / "new" / "metrics.json"
    contracts.write_metrics({"good": 1.0}, file)
    with pytest.raises(ContractError, match="worse, worst not finite"):
        contracts.write_metrics({"good": 2.0, "worse": broken, "worst": broken}, file)
    assert json.loads(file.read_text()) == {"good": 1.0}
    assert [path.name for path in file.parent.iterdir()] == ["metrics.json"]


def test_metrics_keep_every_digit_and_their_kind(tmp_path):
    metrics = {"share": np.float64(0.1) + np.float64(0.2), "count": np.int64(3), "at_end": np.bool_(True)}
    contracts.write_metrics(metrics, tmp_path / "metrics.json")
    assert json.loads((tmp_path / "metrics.json").read_text()) == {"share": 0.1 + 0.2, "count": 3, "at_end": True}


def test_a_folder_is_replaced_whole(tmp_path):
    folder = tmp_path / "data" / "track"
    for name in ("old", "new"):
        with contracts.replacing(folder) as partial:
            (partial / name).write_text(name)
            assert not (folder / "new").exists()
    assert [path.name for path in folder.iterdir()] == ["new"]
    assert [path.name for path in folder.parent.iterdir()] == ["track"]


@pytest.mark.parametrize("error", [ContractError("refused"), KeyboardInterrupt()])
def test_a_failure_leaves_the_old_folder_and_nothing_else(error, tmp_path):
    folder = tmp_path / "track"
    folder.mkdir()
    (folder / "old").write_text("old")
    with pytest.raises(type(error)), contracts.replacing(folder) as partial:
        (partial / "new").write_text("new")
        raise error
    assert [path.name for path in tmp_path.iterdir()] == ["track"]
    assert [path.name for path in folder.iterdir()] == ["old"]


def test_what_a_killed_run_left_behind_does_not_enter_the_folder(tmp_path):
    left = tmp_path / ".track.partial"
    left.mkdir()
    (left / "torn").write_text("torn")
    with contracts.replacing(tmp_path / "track") as partial:
        assert not list(partial.iterdir())


def takes(*lengths: int) -> pd.DataFrame:
    names = [name for name, length in zip("bac", lengths, strict=False) for _ in range(length)]
    return pd.DataFrame({"take": names, "q1": np.arange(len(names)), "q2": -np.arange(len(names))})


def test_takes_are_stacked_in_the_order_of_the_table():
    names, values = contracts.stacked(takes(3, 3), ["q2", "q1"])
    assert names == ["b", "a"]
    assert values.tolist() == [[[0, 0], [-1, 1], [-2, 2]], [[-3, 3], [-4, 4], [-5, 5]]]


@pytest.mark.parametrize("lengths", [(3, 2), (3, 1), (2, 3, 1), ()])
def test_takes_of_unequal_length_or_none_are_refused(lengths):
    with pytest.raises(ContractError, match="take"):
        contracts.stacked(takes(*lengths), ["q1"])


def test_takes_that_interleave_are_refused():
    with pytest.raises(ContractError, match="one after the other"):
        contracts.stacked(takes(3, 3).sort_values("q1", key=lambda q: q % 3), ["q1"])
