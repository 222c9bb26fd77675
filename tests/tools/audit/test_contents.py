"""What is within the tolerance and what is not, for every kind of file, and where it is said
to be.
"""

from __future__ import annotations

import json
import shutil
from base64 import b64encode
from gzip import compress
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pipeline.tools.audit.contents import compare
from pipeline.tools.audit.tolerance import LEVELS, PRINTED, RELATIVE, ROUNDING

VALUES = np.array([1e-9, 0.3, -2.0, 1e3])
TABLE = pd.DataFrame(
    {"take": list("abcd"), "k": range(4), "x": VALUES, "gap": [np.nan, 1.0, np.inf, 2.0]}
)


@pytest.fixture
def differences(tmp_path):
    """Differences of two contents in files of one name."""

    def difference(name: str, before: object, now: object) -> list:
        for folder, content in (("before", before), ("now", now)):
            shutil.rmtree(tmp_path / folder, ignore_errors=True)
            file = tmp_path / folder / name
            file.parent.mkdir()
            if isinstance(content, pd.DataFrame):
                content.to_parquet(file) if file.suffix == ".parquet" else content.to_csv(
                    file, index=False
                )
            elif isinstance(content, np.ndarray):
                Image.fromarray(content).save(file)
            else:
                file.write_bytes(content) if isinstance(content, bytes) else file.write_text(
                    content
                )
        return compare(tmp_path / "before", tmp_path / "now")

    return difference


@pytest.mark.parametrize("name", ["t.parquet", "t.csv"])
def test_a_table_is_compared_by_its_columns(differences, name):
    assert differences(name, TABLE, TABLE) == []
    (last_bit,) = differences(name, TABLE, TABLE.assign(x=np.nextafter(VALUES, np.inf)))
    assert (
        last_bit.within and last_bit.where == f"{name}, column x" and 0 < last_bit.relative < 3e-16
    )
    (altered,) = differences(name, TABLE, TABLE.assign(x=VALUES * [1, 1 + 3 * RELATIVE, 1, 1]))
    assert not altered.within and altered.relative == pytest.approx(3 * RELATIVE, rel=1e-3)
    assert altered.absolute == pytest.approx(0.9 * RELATIVE, rel=1e-3)


def test_a_small_number_may_be_off_by_the_rounding_of_the_greatest_in_its_column(differences):
    assert differences(
        "t.parquet", TABLE, TABLE.assign(x=VALUES + np.array([0.9 * ROUNDING * 1e3, 0, 0, 0]))
    )[0].within
    assert not differences(
        "t.parquet", TABLE, TABLE.assign(x=VALUES + np.array([1.1 * ROUNDING * 1e3, 0, 0, 0]))
    )[0].within


@pytest.mark.parametrize(
    "altered",
    [
        TABLE.assign(k=[0, 1, 2, 4]),
        TABLE.assign(take=list("abce")),
        TABLE.assign(gap=[0.0, 1.0, np.inf, 2.0]),
        TABLE.assign(gap=[np.nan, 1.0, 9.0, 2.0]),
        TABLE.assign(gap=[np.nan, 1.0, -np.inf, 2.0]),
        TABLE.assign(gap=[np.inf, 1.0, np.inf, 2.0]),
        TABLE.iloc[:3],
        TABLE.drop(columns="k"),
        TABLE.rename(columns={"k": "step"}),
    ],
)
def test_all_but_decimal_numbers_is_equal(differences, altered):
    for name in ("t.parquet", "t.csv"):
        assert [difference.within for difference in differences(name, TABLE, altered)] == [False]


def test_numbers_of_json_are_compared_one_by_one(differences):
    before = {"fit": {"sigma": 0.25, "takes": 3}, "rows": ["a,0.1", "b,0.2"], "none": None}
    (difference,) = differences(
        "m.json",
        json.dumps(before),
        json.dumps(before | {"fit": {"sigma": 0.25 * (1 + 1e-12), "takes": 3}}),
    )
    assert (
        difference.within
        and difference.where == "m.json, fit/sigma"
        and difference.relative == pytest.approx(1e-12, rel=1e-3)
    )
    (difference,) = differences(
        "m.json", json.dumps(before), json.dumps(before | {"fit": {"sigma": 0.2501, "takes": 3}})
    )
    assert not difference.within and difference.how.startswith("0.25 before, 0.2501 now")
    for altered in (
        {"fit": {"sigma": 0.25, "takes": 4}},
        {"rows": ["a,0.1", "b,0.3"]},
        {"none": False},
        {"rows": []},
        {"more": 1},
    ):
        assert [
            difference.within
            for difference in differences(
                "m.json", json.dumps(before), json.dumps(before | altered)
            )
        ] == [False]


def test_a_printed_number_may_be_off_by_its_last_digit_where_that_is_little(differences):
    def within(before: str, now: str) -> bool:
        (difference,) = differences(
            "report.md", f"line\nthe mean is {before} rad\n", f"line\nthe mean is {now} rad\n"
        )
        return difference.within

    assert (
        within("0.01234", "0.01235")
        and within("1.2345e-05", "1.2346e-05")
        and within("-3.142", "-3.143")
    )
    assert not within("0.01234", "0.01236") and not within("12", "13") and not within("0.2", "0.3")
    assert 0.1 / 0.2 > PRINTED
    assert within("0.30000000000000004", "0.29999999999999993")


def test_another_word_is_a_difference_wherever_it_stands(differences):
    (difference,) = differences("report.md", "a\nreproduced: 0.1\n", "a\nnot reproduced: 0.1\n")
    assert not difference.within and difference.where == "report.md, line 2"
    assert not differences("report.md", "a\n", "a\nb\n")[0].within


def test_hashes_of_other_outputs_are_passed_over(differences):
    for length in (32, 64):
        (difference,) = differences(
            "page.html",
            f"<code>{'a1' * (length // 2)}</code>",
            f"<code>{'b2' * (length // 2)}</code>",
        )
        assert difference.within and "equal" in difference.how
    assert not differences("page.html", "seed 20170101", "seed 20170102")[0].within


def test_what_a_page_embeds_is_compared_by_its_kind(differences):
    def page(kind: str, content: bytes) -> str:
        return f'<a href="data:{kind};base64,{b64encode(content).decode()}">0.5</a>'

    table = TABLE.to_csv(index=False)
    near, far = (
        table.replace("0.3", number).encode() for number in ("0.30000000000000004", "0.31")
    )
    for kind, pack in (("text/csv", bytes), ("application/gzip", compress)):
        assert differences("page.html", page(kind, pack(table.encode())), page(kind, pack(near)))[
            0
        ].within
        (difference,) = differences(
            "page.html", page(kind, pack(table.encode())), page(kind, pack(far))
        )
        assert not difference.within and difference.where == f"page.html, embedded {kind}, column x"


def test_an_image_may_be_off_by_a_level(differences):
    image = np.full((4, 5), 100, np.uint8)
    # and no number of numpy, which JSON would refuse
    assert differences("f.png", image, image + np.uint8(LEVELS))[0].within is True
    assert not differences("f.png", image, image + np.uint8(LEVELS + 1))[0].within
    assert not differences("f.png", image, image[:3])[0].within
    assert differences(
        "depth.png", image.astype(np.uint16) * 40, image.astype(np.uint16) * 40 + np.uint16(LEVELS)
    )[0].within


def test_what_cannot_be_read_is_different_and_no_error(differences):
    for name, good in (
        ("t.parquet", TABLE),
        ("f.png", np.zeros((2, 2), np.uint8)),
        ("m.json", "{}"),
        ("x.bin", b"\xff\x00"),
    ):
        (difference,) = differences(name, good, b"\xff\xfe torn")
        assert not difference.within and difference.where == name


def test_a_log_whose_lines_differ_in_length_is_compared_as_text(differences):
    log = "Format Version,1.23\nFrame,Time,X,Y\n0,0.0,1.500000,2.0\n"
    (difference,) = differences("take.csv", log, log.replace("1.500000", "1.500001"))
    assert difference.within and "1 of 1" not in difference.how
    assert not differences("take.csv", log, log.replace("1.500000", "1.600000"))[0].within


def test_a_file_in_one_run_alone_is_named(tmp_path):
    for name in ("before/both", "before/old", "now/both", "now/new"):
        file: Path = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.write_text("")
    difference = compare(tmp_path / "before", tmp_path / "now")
    assert {difference.where: difference.how for difference in difference} == {
        "new": "written by the rerun alone",
        "old": "not written by the rerun",
    }
    assert not any(difference.within for difference in difference)
