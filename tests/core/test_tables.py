"""Tables and files between stages: every declared column refuses values that do not fit, and
writing is exact, and whole or not at all.
"""

import errno
import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from numpy.testing import assert_array_equal

from pipeline.core import columns, contracts
from pipeline.core.contracts import TABLES, Column, expand_families, read_declarations
from pipeline.core.errors import ContractError

cases = cases_beside(__file__)
# every file of declarations, by the folder it lies in: pipeline or a study
FILES = {
    file.parent.name: file for file in sorted(TABLES.parent.glob("**/tables.yaml"))
}
DECLARED = []
for folder, declarations in FILES.items():
    DECLARED += [(folder, table) for table in read_declarations(declarations)]
# of the families' columns here; of every table
JOINTS = ("base", "tip")
ROWS = 4


@cache
def declaration(place: str, name: str) -> dict[str, Column]:
    """The columns of one table, its families those of JOINTS."""
    declared = read_declarations(FILES[place])[name]
    names_of = {
        "": lambda family, _: [family],
        "*": columns.columns,
        "*:*": columns.pairs,
    }
    present = []
    for column in declared:
        family, _, places = column.partition(":")
        present += names_of[places](family, JOINTS)
    return expand_families(declared, present)


def some(column: Column) -> list:
    """ROWS values that fit the column."""
    match column.kind:
        case "real" | "log":
            low = max(column.low, -1.0)
            high = min(column.high, low + 4.0)
            return np.linspace(low, high, ROWS).tolist()
        case "count":
            least = int(column.low)
            return list(range(least, least + ROWS))
        case "flag":
            return [True, False] * (ROWS // 2)
    words = column.among or ["a"]
    return [words[0]] * ROWS


def table(name: str, place: str = "pipeline") -> pd.DataFrame:
    columns_of = declaration(place, name).items()
    return pd.DataFrame({key: some(column) for key, column in columns_of})


@pytest.mark.parametrize(("place", "name"), DECLARED)
def test_a_table_that_fits_is_read_as_it_was_written_and_no_column_more_or_less(
    place,
    name,
    tmp_path,
):
    sound = table(name, place)
    file = FILES[place]
    for column, kind in declaration(place, name).items():
        if kind.gaps:
            lost = -np.inf if kind.kind == "log" else np.nan
            sound[column] = [1.0, np.nan, lost, 1.0]
    contracts.write(sound, name, tmp_path, file)

    pd.testing.assert_frame_equal(contracts.read(name, tmp_path, file), sound)
    with pytest.raises(ContractError, match=r"is not declared.*surplus"):
        contracts.write(sound.assign(surplus=1.0), name, tmp_path, file)

    families = sound.columns.str.split(":").str[0]
    for column, kind in read_declarations(file)[name].items():
        without = sound.loc[:, families != column.split(":")[0]]
        if kind.optional:
            contracts.write(without, name, tmp_path, file)
            continue
        with pytest.raises(ContractError, match="is missing"):
            contracts.write(without, name, tmp_path, file)


@cases("wrong values")
def test_a_column_refuses_values_that_do_not_fit(text, bad, tmp_path, monkeypatch):
    column = Column.parse(text)
    declarations = {"one": {"it": column}}
    monkeypatch.setattr(contracts, "read_declarations", lambda _: declarations)

    contracts.write(pd.DataFrame({"it": some(column)}), "one", tmp_path)
    file = tmp_path / "one.parquet"
    file.unlink()

    for value in bad:
        rows = pd.DataFrame({"it": [*some(column)[:-1], value]})
        with pytest.raises(ContractError, match="'one' breaks its contract") as refused:
            contracts.write(rows, "one", tmp_path)
        assert refused.value.evidence == {"file": file, "column": "it"}
        assert not file.exists()


@cases("wrong joints")
def test_a_table_that_another_program_wrote_is_checked_on_reading(
    column,
    value,
    tmp_path,
):
    rows = table("joints")
    sound = list(rows.get(column, [1.0] * ROWS))
    rows[column] = [*sound[:-1], value]
    rows.to_parquet(tmp_path / "joints.parquet")

    with pytest.raises(ContractError, match="breaks its contract") as refused:
        contracts.read("joints", tmp_path)
    assert refused.value.evidence["column"] == column


def test_the_same_table_gives_the_same_bytes_whatever_its_index_and_the_order_of_its_columns(
    tmp_path,
):
    rows = table("joints")
    # the joints of a family stay in the order that they are given in
    reordered = rows[["residual", "q:base", "q:tip", "t", "k", "part", "take"]]
    reordered = reordered.set_index(np.array([5, 3, 9, 1])).astype({"k": "uint8"})
    # control: a single digit shows
    nearly = rows.assign(**{"q:base": np.nextafter(rows["q:base"], 9)})

    def content(written: pd.DataFrame) -> bytes:
        contracts.write(written, "joints", tmp_path)
        return (tmp_path / "joints.parquet").read_bytes()

    assert content(rows) == content(reordered) != content(nearly)
    assert str(reordered["k"].dtype) == "uint8"  # the table given is left alone


def test_a_table_that_is_absent_or_cut_off_is_refused_with_its_file(tmp_path):
    file = tmp_path / "joints.parquet"
    assert not contracts.exists("joints", tmp_path)
    contracts.write(table("joints"), "joints", tmp_path)
    assert contracts.exists("joints", tmp_path)
    whole = file.read_bytes()
    for share in (0.0, 0.5, 0.99):
        file.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(ContractError, match="cannot be read"):
            contracts.read("joints", tmp_path)

    file.unlink()
    with pytest.raises(ContractError, match="no table 'joints'") as refused:
        contracts.read("joints", tmp_path)
    assert refused.value.evidence["file"] == file


def takes(*lengths: int) -> pd.DataFrame:
    names = np.repeat(list("bac")[: len(lengths)], lengths)
    rows = np.arange(len(names))
    return pd.DataFrame({"take": names, "q:base": rows, "q:tip": -rows, "w:base": rows})


def test_takes_are_stacked_in_the_order_of_the_table():
    names, values = contracts.stacked(takes(3, 3), ["q:tip", "q:base"])
    assert names == ["b", "a"]
    assert values.tolist() == [[[0, 0], [-1, 1], [-2, 2]], [[-3, 3], [-4, 4], [-5, 5]]]

    # a family is stacked in the order of its columns
    _, family = contracts.stacked(takes(3, 3), "q")
    assert_array_equal(family, values[..., ::-1])


def test_takes_with_unequal_or_interleaved_rows_are_not_stacked():
    interleaved = takes(3, 3).sort_values("q:base", key=lambda q: q % 3)
    for rows in (takes(3, 2), takes(2, 3, 1), takes(), interleaved):
        with pytest.raises(ContractError, match="consecutive rows"):
            contracts.stacked(rows, "q")


def test_values_and_symmetric_matrices_are_spread_over_columns_and_read_back():
    # a colon in a joint's name, as namespaces have it, does not hide its columns
    names = ("arm:base", "5%3A%2", "tip%25:%")
    array = np.arange(24.0).reshape(2, 4, 3)
    spread = pd.DataFrame(columns.spread("q", names, array))

    assert columns.members(spread, "q") == names
    assert "q:arm%3Abase" in spread
    assert_array_equal(columns.values(spread, "q"), array.reshape(-1, 3))

    half = np.random.default_rng(3).random((5, 3, 3))
    full = half + half.swapaxes(1, 2)
    triangles = pd.DataFrame(columns.triangle("c", "abc", full))

    assert list(triangles)[:4] == ["c:a:a", "c:a:b", "c:a:c", "c:b:b"]
    assert_array_equal(columns.matrices(triangles, "c", "abc"), full)
    # control: another order of the joints has other pairs
    with pytest.raises(KeyError):
        columns.matrices(triangles, "c", "cba")


def test_members_of_a_family_are_found_beside_other_columns():
    mixed = pd.DataFrame(columns=["k", "q:tip", "q:base", "c:tip:tip", "qq:tip", 7])
    assert columns.members(mixed, "q") == ("tip", "base")
    assert columns.members(mixed, "c") == ()


def test_metrics_keep_every_digit_and_those_not_finite_leave_the_old_file(tmp_path):
    file = tmp_path / "new" / "metrics.json"
    share = np.float64(0.1) + np.float64(0.2)
    metrics = {"share": share, "count": np.int64(3), "end": np.bool_(1)}
    contracts.write_metrics(metrics, file)

    for broken in (np.nan, np.inf, -np.inf):
        worse = {"good": 2.0, "worse": broken, "worst": broken}
        with pytest.raises(ContractError, match="worse, worst not finite"):
            contracts.write_metrics(worse, file)
    assert json.loads(file.read_text()) == {"share": 0.1 + 0.2, "count": 3, "end": True}
    assert [path.name for path in file.parent.iterdir()] == ["metrics.json"]


def test_a_full_disk_names_the_file_that_cannot_be_written(tmp_path, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    declarations = tmp_path / "t.yaml"
    declarations.write_text("kept: {}\n")
    monkeypatch.setattr(Path, "write_text", full)
    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)

    with pytest.raises(OSError, match="No space left") as refused:
        contracts.write_text("text", tmp_path / "kept.json")
    assert Path(refused.value.filename).name.startswith("kept.")
    with pytest.raises(OSError, match="No space left") as refused:
        contracts.write(pd.DataFrame(), "kept", tmp_path, declarations)
    assert Path(refused.value.filename).name.startswith("kept.")


@pytest.mark.parametrize(
    "error",
    [OSError(errno.ENOSPC, "full"), OSError("99 requested and 4 written")],
    ids=["of the system", "of NumPy"],
)
def test_a_full_disk_names_the_folder_that_cannot_be_written(error, tmp_path):
    with pytest.raises(OSError) as refused, contracts.replacing(tmp_path / "track"):
        raise error
    assert refused.value.errno == errno.ENOSPC
    assert refused.value.filename == f"{tmp_path}/track"


def test_a_folder_is_replaced_whole_or_stays_as_it_was(tmp_path):
    folder = tmp_path / "track"
    left = tmp_path / ".track.999999999.partial"
    left.mkdir()
    (left / "torn").write_text("torn")  # of a killed run
    for name in ("old", "new"):
        with contracts.replacing(folder) as partial:
            assert not list(partial.iterdir())
            (partial / name).write_text(name)
            assert not (folder / "new").exists()
    living = tmp_path / ".track.1.partial"  # of a living process
    living.mkdir()
    with contracts.replacing(folder) as partial:
        (partial / "new").touch()
    living.rmdir()

    for error in (ContractError("refused"), KeyboardInterrupt()):
        with pytest.raises(type(error)), contracts.replacing(folder) as partial:
            (partial / "newer").write_text("newer")
            raise error
    assert [path.name for path in folder.iterdir()] == ["new"]
    assert {path.name for path in tmp_path.iterdir()} == {"track"}


@pytest.mark.parametrize("exists", [True, False])
def test_an_output_folder_that_is_a_link_is_refused_and_its_content_stays(
    tmp_path,
    exists,
):
    foreign = tmp_path / "foreign"
    link = tmp_path / "track"
    if exists:
        foreign.mkdir()
        (foreign / "thesis").write_text("mine")
    link.symlink_to(foreign)

    with pytest.raises(ContractError, match=r"is a link to .*foreign") as refused:
        with contracts.replacing(link):
            pass
    assert refused.value.evidence["file"] == link and link.is_symlink()
    assert [path.name for path in foreign.glob("*")] == ["thesis"] * exists
