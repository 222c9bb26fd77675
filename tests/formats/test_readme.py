"""The table of what is refused names tests that there are."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROW = re.compile(r"\| (?P<fault>[^|]+) \| `(?P<file>[\w/]+\.py)::(?P<test>\w+)` \|")
TABLE = (ROOT / "pipeline/formats/README.md").read_text().partition("## What is refused")[2]
ROWS = TABLE.partition("|---|---|\n")[2].splitlines()


@pytest.mark.parametrize("row", ROWS)
def test_each_kind_of_fault_has_a_test_that_shows_it(row):
    match = ROW.fullmatch(row)
    assert match, "one kind and one test a row"
    tree = ast.parse((ROOT / "tests" / match["file"]).read_text())
    assert match["test"] in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_the_table_is_there():
    assert len(ROWS) > 10
