"""Patterns of files that a dataset names."""

from __future__ import annotations

import pytest

from pipeline.core.errors import ConfigError
from pipeline.formats.format import matching


def test_what_matches_comes_in_order(tmp_path):
    for name in ("b2.csv", "b10.csv", "a.csv", "c.txt"):
        (tmp_path / name).touch()
    assert [path.name for path in matching(tmp_path, "*.csv", key="k")] == [
        "a.csv",
        "b10.csv",
        "b2.csv",
    ]
    assert matching(tmp_path, "absent/*", key="k") == []


@pytest.mark.parametrize("pattern", ["/absolute/*.csv", ""])
def test_a_pattern_that_is_none_is_refused_with_its_key(tmp_path, pattern):
    with pytest.raises(ConfigError) as caught:
        matching(tmp_path, pattern, key="dataset.depth.frames")
    assert caught.value.evidence["key"] == "dataset.depth.frames"
