"""A study writes its tables, figures and page together, and nothing if a part of it fails."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import pandas as pd
import pytest

from pipeline.core import contracts
from pipeline.core.errors import ContractError
from pipeline.studies.frame import NoAnswerError, interval, listed, number

FILES = {
    "__init__.py": "",
    "params.yaml": "paper: {rows: 5}\nsmoke: {rows: 2}\n",
    "tables.yaml": "counted: {k: count | number, length: real 0.. | m}\n",
    "dvc.yaml": "stages: {counting: {params: [data/config.yaml: [seed]]}}\n",
    "figures/__init__.py": "",
    "figures/lengths.py": '''"""Lengths. One line."""
from pipeline.figures.style import panels


def draw(counted):
    figure, axes = panels(2, 2)
    axes[0, 0].plot(counted["k"], counted["length"])
    return figure
''',
    "figures/others.py": '"""Others. None."""\n\n\ndef draw(other):\n    raise AssertionError\n',
    "stage.py": '''"""counting: rows of a table."""
import pandas as pd

from pipeline.core.validation import options
from pipeline.studies.frame import Study


@options()
class Options:
    rows: int


def evaluate(settings, options):
    length = [float(settings.seed)] * options.rows
    return {"counted": pd.DataFrame({"k": range(options.rows), "length": length})}


def page(results):
    return [f"{len(results.tables['counted'])} rows", results.figures["lengths"]]


run = Study("How many rows", Options, evaluate, page).run
''',
}
DATA, REPORT = Path("data/studies/counting"), Path("reports/studies/counting")
PAGE = REPORT.with_suffix(".md")


@pytest.fixture
def study(project, monkeypatch):
    """The module ``stage`` of a study, whose Study is the one that its ``run`` is bound to."""
    for name, text in FILES.items():
        contracts.write_text(text, Path("counting") / name)
    monkeypatch.syspath_prepend(str(Path.cwd()))
    yield import_module("counting.stage")
    for name in [name for name in sys.modules if name.split(".")[0] == "counting"]:
        del sys.modules[name]


def written() -> dict[str, bytes]:
    """Every file below data/studies and reports/studies."""
    folders = (Path("data/studies"), Path("reports/studies"))
    files = [file for folder in folders for file in folder.rglob("*") if file.is_file()]
    return {str(file): file.read_bytes() for file in files}


def changed(study, **parts):
    """Run the study with other functions."""
    values = {name: getattr(study.run.__self__, name) for name in ("title", "options")}
    functions = {"evaluate": study.evaluate, "page": study.page}
    return type(study.run.__self__)(**values, **(functions | parts)).run()


def test_tables_figures_and_page_are_written_and_the_bytes_are_equal_in_a_second_run(study):
    study.run()
    first = written()
    assert set(first) == {
        *(f"{DATA}/counted.parquet", f"{REPORT}/counted.csv", str(PAGE)),
        *(f"{REPORT}/lengths.{kind}" for kind in ("png", "svg")),
    }
    # the scale of the run is smoke; the figure whose table the study lacks is left out
    picture = "![Lengths](counting/lengths.png)\n\n**Lengths.** One line."
    assert PAGE.read_text() == f"# How many rows\n\n2 rows\n\n{picture}\n"
    assert pd.read_csv(REPORT / "counted.csv").to_dict("list") == {
        "k": [0, 1],
        "length": [2017.0] * 2,
    }
    study.run()
    assert written() == first


def fail(*_):
    """Stand for a function of a study with a fault."""
    raise ZeroDivisionError


def undeclared(*_):
    """Return a table with a column that tables.yaml lacks."""
    return {"counted": pd.DataFrame({"k": [1], "length": [1.0], "width": [1.0]})}


@pytest.mark.parametrize(
    ("part", "error"),
    [
        ({"evaluate": fail}, ZeroDivisionError),
        ({"page": fail}, ZeroDivisionError),
        ({"evaluate": undeclared}, ContractError),
    ],
)
def test_a_study_that_fails_leaves_what_an_earlier_run_wrote(study, part, error):
    study.run()
    first = written()
    with pytest.raises(error):
        changed(study, **part)
    assert written() == first


def test_the_page_states_why_a_dataset_gives_no_answer(study, capsys):
    def refuse(*_):
        raise NoAnswerError("the dataset has no depth camera")

    study.run()
    changed(study, evaluate=refuse)
    text = "# How many rows\n\nNo answer for this dataset: the dataset has no depth camera.\n"
    assert PAGE.read_text() == text and set(written()) == {str(PAGE)}
    assert "counting: the dataset has no depth camera" in capsys.readouterr().out


def test_numbers_and_names_in_words():
    assert [number(x) for x in (3.0, 1234567.0, 0.12345, float("nan"), -float("inf"))] == [
        *("3", "1,234,567", "0.123", "–", "−∞")
    ]
    assert interval(-1e-13, 0.5, 1.25) == "+0 [+0.5, +1.25]"
    assert (
        interval(2.0, float("nan"), float("nan")) == "+2" and interval(*[float("nan")] * 3) == "–"
    )
    assert [listed(names) for names in (["a"], ["a", "b", "c"])] == ["a", "a, b and c"]
