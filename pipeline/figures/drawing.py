"""Figures of the paper, each a module of this package that is found by its place.

The module's docstring holds title and caption, ``TABLES`` maps each table to the folder of the
stage that writes it, and ``draw(**tables, **options)`` draws. ``NEEDS`` names the part that a
dataset lacks where a table is absent. Options are ``models``, ``joints``, ``mode`` and
``configurations``; ``draw`` gets those that it names.
"""

from __future__ import annotations

import json
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path

from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials
from pipeline.core.options.analysis import Compute
from pipeline.figures.style import save

PACKAGE = "pipeline.figures"


def figures_in(folder: Path = Path(__file__).parent) -> list[str]:
    """Return the names of the modules of ``folder`` that draw a figure, in order."""
    names = sorted(file.stem for file in folder.glob("[a-z]*.py"))
    return [name for name in names if hasattr(import_module(f"{PACKAGE}.{name}"), "TABLES")]


def draw_all(out: Path, options: dict[str, object], compute: Compute) -> None:
    """Draw every figure whose tables exist, and ``captions.json``, into ``out``: all or none."""
    wanted = []
    for name in figures_in():
        module = import_module(f"{PACKAGE}.{name}")
        absent = [t for t, place in module.TABLES.items() if not contracts.exists(t, Path(place))]
        if absent:
            lacking = getattr(module, "NEEDS", f"table {absent[0]}")
            print(f"figures: {name} left out: the dataset has no {lacking}")
        else:
            wanted.append(name)
    with contracts.replacing(out) as folder:
        trial = partial(_draw, options=options, folder=folder.resolve())
        written = dict(run_trials(trial, wanted, compute=compute, label="figures"))
        text = json.dumps(written, indent=2, ensure_ascii=False) + "\n"
        contracts.write_text(text, folder / "captions.json")


def _draw(name: str, options: dict[str, object], folder: Path) -> tuple[str, dict]:
    """Draw one figure; return its name and caption with the files that it shows."""
    module = import_module(f"{PACKAGE}.{name}")
    tables = {table: contracts.read(table, Path(p)) for table, p in module.TABLES.items()}
    named = signature(module.draw).parameters
    options = {key: value for key, value in options.items() if key in named}
    # a table comes before an option of its name
    save(module.draw(**(options | tables)), folder, name)
    title, _, text = " ".join(module.__doc__.split()).partition(". ")
    return name, {
        "title": title,
        "caption": text,
        "sources": [f"{place}/{table}.parquet" for table, place in module.TABLES.items()],
        "script": f"{PACKAGE.replace('.', '/')}/{name}.py",
    }
