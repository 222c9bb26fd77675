"""A reference finds the one number it addresses, says when there is none, and refuses to choose among several."""

from __future__ import annotations

import pandas as pd
import pytest

from pipeline.audit.evidence import Reference
from pipeline.errors import ConfigError

EVIDENCE = {
    "metrics/motion": {"wishart_std": 0.5, "gap": float("nan")},
    "tables/sigma_s": pd.DataFrame(
        {"name": ["C1", "C1", "C2"], "form": ["diagonal", "full", "diagonal"], "agents": [3, 3, 5], "e": [1.0, 2.0, 3.0]}
    ),
}


def test_a_key_and_a_row_are_found():
    assert Reference("metrics/motion", "wishart_std").look_up(EVIDENCE) == 0.5
    assert Reference("tables/sigma_s", rows={"name": "C1", "form": "full"}, column="e").look_up(EVIDENCE) == 2.0
    assert Reference("tables/sigma_s", rows={"agents": 5}, column="e").look_up(EVIDENCE) == 3.0


@pytest.mark.parametrize(
    "reference",
    [
        Reference("metrics/motion", "no_such"),
        Reference("metrics/motion", "gap"),
        Reference("metrics/none", "wishart_std"),
        Reference("tables/sigma_s", "e"),
        Reference("metrics/motion", rows={"name": "C1"}, column="e"),
        Reference("tables/sigma_s", rows={"name": "C3"}, column="e"),
        Reference("tables/sigma_s", rows={"colour": "red"}, column="e"),
        Reference("tables/sigma_s", rows={"name": "C2"}, column="f"),
    ],
)
def test_what_a_run_lacks_is_none(reference):
    assert reference.look_up(EVIDENCE) is None


def test_several_rows_are_refused():
    with pytest.raises(ConfigError, match="2 rows fit"):
        Reference("tables/sigma_s", rows={"name": "C1"}, column="e").look_up(EVIDENCE)


def test_placeholders_take_the_values_of_a_case():
    template = Reference("tables/sigma_s", rows={"name": "{c}", "form": "diagonal", "agents": 3}, column="{column}")
    assert template.of_case({"c": "C1", "column": "e"}).look_up(EVIDENCE) == 1.0
    assert (
        template.of_case({"c": "C1", "column": "e"}).address == "reports/tables/sigma_s.csv: e where name = C1, form = diagonal, agents = 3"
    )
    assert Reference("metrics/motion", "{m}_std").of_case({"m": "wishart"}).address == "reports/metrics/motion.json: wishart_std"
    with pytest.raises(ConfigError, match="placeholder"):
        template.of_case({"c": "C1"})


@pytest.mark.parametrize(
    "parts", [{}, {"key": "a", "column": "b"}, {"key": "a", "rows": {"b": 1}}, {"column": "e", "rows": ["b"]}, {"key": 3}]
)
def test_what_is_neither_a_key_nor_a_cell_is_refused(parts):
    with pytest.raises(ConfigError):
        Reference("metrics/motion", **parts)
