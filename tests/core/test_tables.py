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

from pipeline.core import columns, contracts
from pipeline.core.contracts import TABLES, Column, expand_families, read_declarations
from pipeline.core.errors import ContractError

# every file of declarations, by the folder it lies in: pipeline or a study
FILES = {
    file.parent.name: file for file in sorted(TABLES.parent.glob("**/tables.yaml"))
}
DECLARED = [
    (place, name) for place, file in FILES.items() for name in read_declarations(file)
]
JOINTS, ROWS = ("base", "tip"), 4  # of the families' columns here; of every table


@cache
def declaration(place: str, name: str) -> dict[str, Column]:
    """The columns of one table, its families those of JOINTS."""
    written = read_declarations(FILES[place])[name]
    present = []
    for column in written:
        family, _, places = column.partition(":")
        naming = {
            "": lambda family, _: [family],
            "*": columns.columns,
            "*:*": columns.pairs,
        }
        present += naming[places](family, JOINTS)
    return expand_families(written, present)


def some(column: Column) -> list:
    """ROWS values that fit the column."""
    match column.kind:
        case "real" | "log":
            low, high = (
                max(column.low, -1.0),
                min(column.high, max(column.low, -1.0) + 4.0),
            )
            return np.linspace(low, high, ROWS).tolist()
        case "count":
            return list(range(int(column.low), int(column.low) + ROWS))
        case "flag":
            return [True, False] * (ROWS // 2)
    return [(column.among or "a")[0]] * ROWS


def table(name: str, place: str = "pipeline") -> pd.DataFrame:
    return pd.DataFrame(
        {key: some(column) for key, column in declaration(place, name).items()}
    )


@pytest.mark.parametrize(("place", "name"), DECLARED)
def test_a_table_that_fits_is_read_as_it_was_written_and_no_column_more_or_less(
    place, name, tmp_path
):
    good, kinds = table(name, place), declaration(place, name)
    for column in (column for column, kind in kinds.items() if kind.gaps):
        lost = -np.inf if kinds[column].kind == "log" else np.nan
        good[column] = [1.0, np.nan, lost, 1.0]
    contracts.write(good, name, tmp_path, FILES[place])
    pd.testing.assert_frame_equal(contracts.read(name, tmp_path, FILES[place]), good)
    optional = [column for column, kind in kinds.items() if kind.optional]
    contracts.write(good.drop(columns=optional), name, tmp_path, FILES[place])
    required = [
        n
        for n, kind in read_declarations(FILES[place])[name].items()
        if not kind.optional
    ]
    for column in (required[0], required[-1]):  # of a family, all of it
        gone = [name for name in good if name.split(":")[0] == column.split(":")[0]]
        with pytest.raises(ContractError, match="is missing"):
            contracts.write(good.drop(columns=gone), name, tmp_path, FILES[place])
    with pytest.raises(ContractError, match=r"is not declared.*surplus"):
        contracts.write(good.assign(surplus=1.0), name, tmp_path, FILES[place])


@pytest.mark.parametrize(
    ("text", "bad"),
    [
        ("real 0..1 | m", [np.inf, -np.inf, np.nan, -1e-9, 1 + 1e-9, "1.0"]),
        ("real gaps | m", [np.inf, "1.0"]),
        ("log | nat", [np.inf, "1.0"]),
        ("count 2..9 | 1", [1.5, np.nan, "1", 1, 10]),
        ("flag | yes or no", ["yes", None, 0.5]),
        ("text (a, b) | name", [3, None, "c"]),
        ("text | name", [3, None]),
    ],
)
def test_a_column_refuses_values_that_do_not_fit(text, bad, tmp_path, monkeypatch):
    column = Column.parse(text)
    monkeypatch.setattr(
        contracts, "read_declarations", lambda _: {"one": {"it": column}}
    )
    contracts.write(pd.DataFrame({"it": some(column)}), "one", tmp_path)
    for value in bad:
        file = tmp_path / "one.parquet"
        file.unlink(missing_ok=True)
        with pytest.raises(
            ContractError, match="table 'one' breaks its contract"
        ) as refused:
            contracts.write(
                pd.DataFrame({"it": [*some(column)[:-1], value]}), "one", tmp_path
            )
        assert (
            refused.value.evidence == {"file": file, "column": "it"}
            and not file.exists()
        )


@pytest.mark.parametrize(
    ("column", "value"),
    # nor does a pair of joints pass for a joint
    [
        ("k", -1),
        ("q:tip", np.inf),
        ("take", None),
        ("part", "rehearsal"),
        ("q:base:tip", 1.0),
    ],
)
def test_a_table_that_another_program_wrote_is_checked_on_reading(
    column, value, tmp_path
):
    good = table("joints")
    values = [*good.get(column, [1.0] * ROWS)][:-1]
    good.assign(**{column: [*values, value]}).to_parquet(tmp_path / "joints.parquet")
    with pytest.raises(ContractError, match="breaks its contract") as refused:
        contracts.read("joints", tmp_path)
    assert refused.value.evidence["column"] == column


def test_the_same_table_gives_the_same_bytes_whatever_its_index_and_the_order_of_its_columns(
    tmp_path,
):
    # but the joints of a family stay in the order that they are given in
    reordered = table("joints")[
        ["residual", "q:base", "q:tip", "t", "k", "part", "take"]
    ]
    written = {
        "first": table("joints"),
        "second": reordered.set_index(np.array([5, 3, 9, 1])).astype({"k": "uint8"}),
        # control: a single digit shows
        "third": table("joints").assign(
            **{"q:base": np.nextafter(table("joints")["q:base"], 9)}
        ),
    }
    for folder, rows in written.items():
        (tmp_path / folder).mkdir()
        contracts.write(rows, "joints", tmp_path / folder)
    first, second, third = (
        file.read_bytes() for file in sorted(tmp_path.glob("*/*.parquet"))
    )
    assert first == second != third
    assert str(written["second"]["k"].dtype) == "uint8"  # the table given is left alone


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
    names = [
        name
        for name, length in zip("bac", lengths, strict=False)
        for _ in range(length)
    ]
    rows = np.arange(len(names))
    return pd.DataFrame({"take": names, "q:base": rows, "q:tip": -rows, "w:base": rows})


def test_takes_are_stacked_in_the_order_of_the_table_where_all_have_the_same_rows():
    names, values = contracts.stacked(takes(3, 3), ["q:tip", "q:base"])
    assert names == ["b", "a"]
    assert values.tolist() == [[[0, 0], [-1, 1], [-2, 2]], [[-3, 3], [-4, 4], [-5, 5]]]
    # a family is stacked in the order of its columns
    np.testing.assert_array_equal(
        contracts.stacked(takes(3, 3), "q")[1], values[..., ::-1]
    )
    interleaved = takes(3, 3).sort_values("q:base", key=lambda q: q % 3)
    for wrong in (takes(3, 2), takes(2, 3, 1), takes(), interleaved):
        with pytest.raises(ContractError, match="consecutive rows"):
            contracts.stacked(wrong, "q")


def test_values_and_symmetric_matrices_are_spread_over_columns_and_read_back():
    # a colon in a joint's name, as namespaces have it, does not hide its columns
    names, array = ("arm:base", "5%3A%2", "tip%25:%"), np.arange(24.0).reshape(2, 4, 3)
    spread = pd.DataFrame(columns.spread("q", names, array))
    assert columns.members(spread, "q") == names and "q:arm%3Abase" in spread
    np.testing.assert_array_equal(columns.values(spread, "q"), array.reshape(-1, 3))
    half = np.random.default_rng(3).random((5, 3, 3))
    full = half + half.swapaxes(1, 2)
    triangles = pd.DataFrame(columns.triangle("c", ("a", "b", "c"), full))
    assert list(triangles)[:4] == ["c:a:a", "c:a:b", "c:a:c", "c:b:b"]
    np.testing.assert_array_equal(
        columns.matrices(triangles, "c", ("a", "b", "c")), full
    )
    with pytest.raises(
        KeyError
    ):  # control: another order of the joints has other pairs
        columns.matrices(triangles, "c", ("c", "b", "a"))
    mixed = pd.DataFrame(columns=["k", "q:tip", "q:base", "c:tip:tip", "qq:tip", 7])
    assert (
        columns.members(mixed, "q") == ("tip", "base")
        and columns.members(mixed, "c") == ()
    )


def test_metrics_keep_every_digit_and_those_not_finite_leave_the_old_file(tmp_path):
    file = tmp_path / "new" / "metrics.json"
    written = {
        "share": np.float64(0.1) + np.float64(0.2),
        "count": np.int64(3),
        "end": np.bool_(1),
    }
    contracts.write_metrics(written, file)
    for broken in (np.nan, np.inf, -np.inf):
        with pytest.raises(ContractError, match="worse, worst not finite"):
            contracts.write_metrics(
                {"good": 2.0, "worse": broken, "worst": broken}, file
            )
    assert json.loads(file.read_text()) == {"share": 0.1 + 0.2, "count": 3, "end": True}
    assert [path.name for path in file.parent.iterdir()] == ["metrics.json"]


@pytest.mark.parametrize(
    "write",
    [
        lambda file: contracts.write_text("text", file),
        lambda file: contracts.write(
            pd.DataFrame(), "kept", file.parent, file.parent / "t.yaml"
        ),
    ],
)
def test_a_full_disk_names_the_file_that_cannot_be_written(
    write, tmp_path, monkeypatch
):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (tmp_path / "t.yaml").write_text("kept: {}\n")
    monkeypatch.setattr(Path, "write_text", full)
    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    with pytest.raises(OSError, match="No space left") as refused:
        write(tmp_path / "kept.json")
    assert Path(refused.value.filename).name.startswith("kept.")
    for error in (
        OSError(errno.ENOSPC, "full"),
        OSError("99 requested and 4 written"),
    ):  # NumPy's
        with pytest.raises(OSError) as refused, contracts.replacing(tmp_path / "track"):
            raise error
        assert (refused.value.errno, refused.value.filename) == (
            errno.ENOSPC,
            f"{tmp_path}/track",
        )


def test_a_folder_is_replaced_whole_or_stays_as_it_was(tmp_path):
    folder, left = tmp_path / "track", tmp_path / ".track.999999999.partial"
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
    tmp_path, exists
):
    foreign, link = tmp_path / "foreign", tmp_path / "track"
    if exists:
        foreign.mkdir()
        (foreign / "thesis").write_text("mine")
    link.symlink_to(foreign)
    with pytest.raises(ContractError, match=r"is a link to .*foreign") as refused:
        with contracts.replacing(link):
            pass
    assert refused.value.evidence["file"] == link and link.is_symlink()
    assert [path.name for path in foreign.glob("*")] == ["thesis"] * exists
