"""Every key that a dataset may have has one row in data/raw/README.md, and no other has one."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import get_args, get_origin, get_type_hints

from source_code import ROOT

from pipeline.core.draft import Described

PAGE = (ROOT / "data/raw/README.md").read_text(encoding="utf-8")
NAMED = {"mocap.bodies": "LINK", "force.configurations": "NAME"}  # what stands for names below


def keys(structure: type, above: str = "") -> Iterator[str]:
    """The keys of a type and of the types in it."""
    hints = get_type_hints(structure)
    for one in fields(structure):
        key, hint = above + one.name, hints[one.name]
        if key != "about":
            yield key
        for nested in (hint, *get_args(hint)):
            if is_dataclass(nested):
                name = f"{NAMED[key]}." if get_origin(hint) is dict else ""
                yield from keys(nested, f"{key}.{name}")


def test_every_key_has_one_row():
    rows = Counter(
        re.findall(r"^\| `([\w.]+)` \|", PAGE.partition("## Every key")[2], re.MULTILINE)
    )
    expected = Counter(keys(Described))
    assert rows == expected, (rows - expected, expected - rows)
