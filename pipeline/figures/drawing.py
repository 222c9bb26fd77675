"""Draw all figures of this package. The YAML file beside a module names the module's figures, with
captions and tables. A figure function gets the tables and the options (``models``, ``joints``,
``mode``, ``configurations``, ``recordings``) that are parameters of the function; ``{recordings}``
in a text becomes "recordings" or "simulated recordings".
"""

import json
from collections.abc import Callable
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import NamedTuple

from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Compute
from pipeline.core.typed_yaml import read_yaml
from pipeline.figures.style import save


class Drawing(NamedTuple):
    """A figure: function, title, caption, tables with the folders of the stages that write them,
    and the part of a dataset that the tables need.
    """

    draw: Callable
    title: str
    caption: str
    tables: dict[str, str]
    needs: str = ""


def figures_in() -> dict[str, Drawing]:
    """Return the figures of this package by their names, in order."""
    figures = {}
    for file in Path(__file__).parent.glob("*.yaml"):
        module = import_module(f"pipeline.figures.{file.stem}")
        for name, stated in read_yaml(file).items():
            figures[name] = Drawing(getattr(module, name), **stated)
    return dict(sorted(figures.items()))


def draw_all(out: Path, options: dict[str, object], compute: Compute) -> None:
    """Draw every figure whose tables exist, and ``captions.json``, into ``out``: all or none."""
    drawn = []
    for name, figure in figures_in().items():
        absent = []
        for table, place in figure.tables.items():
            if not contracts.exists(table, Path(place)):
                absent.append(table)
        if absent:
            lacking = figure.needs or f"table {absent[0]}"
            print(f"figures: {name} left out: the dataset has no {lacking}")
        else:
            drawn.append(name)
    with contracts.replacing(out) as folder:
        trial = partial(_draw, options=options, folder=folder.resolve())
        captions = dict(run_trials(trial, drawn, compute=compute, label="figures"))
        text = json.dumps(captions, indent=2, ensure_ascii=False) + "\n"
        contracts.write_text(text, folder / "captions.json")


def _draw(name: str, options: dict[str, object], folder: Path) -> tuple[str, dict]:
    """Draw one figure; return its name and its entry of ``captions.json``."""
    draw, title, caption, tables, _ = figures_in()[name]
    values = dict(options)
    for table, place in tables.items():  # prior to an option of equal name
        values[table] = contracts.read(table, Path(place))
    arguments = {key: values[key] for key in signature(draw).parameters}
    save(draw(**arguments), folder, name)
    return name, {
        "title": title.format(**options),
        "caption": caption.format(**options),
        "sources": [f"{place}/{table}.parquet" for table, place in tables.items()],
        "script": f"{draw.__module__.replace('.', '/')}.py",
    }
