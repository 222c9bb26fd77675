"""Figures, each a module that is found by its place and says what it shows.

A figure's module has a docstring (title, then caption), ``TABLES`` (table → folder of the stage
that writes it) and ``draw(**tables, **options)``. It may have ``DECLARATIONS``, the file that
declares its tables; ``METRICS``, a file of numbers and patterns of those that the caption states;
and ``NEEDS``, what a dataset lacks where a table is not there. Of the options ``models``,
``joints``, ``mode`` and ``configurations`` ``draw`` is given those that it names.
"""

from __future__ import annotations

import json
from fnmatch import fnmatch
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path
from types import ModuleType

from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials
from pipeline.core.contracts import PAPER
from pipeline.core.errors import ContractError
from pipeline.core.options.analysis import Compute
from pipeline.figures.style import save


def figures_in(package: str) -> list[str]:
    """Return the dotted names of the figures' modules in ``package``, in order."""
    places = import_module(package).__path__
    names = sorted(file.stem for place in places for file in Path(place).glob("[a-z]*.py"))
    modules = (import_module(f"{package}.{name}") for name in names)
    return [module.__name__ for module in modules if hasattr(module, "TABLES")]


def draw_all(
    package: str, out: Path, options: dict[str, object], compute: Compute, label: str
) -> None:
    """Draw every figure of ``package`` whose tables the dataset has, all or none of them, into
    ``out``, which is replaced, with ``captions.json``; ``options`` by name go to the figures that
    name them, ``label`` names the progress.
    """
    wanted = []
    for name in figures_in(package):
        module = import_module(name)
        absent = [t for t, place in module.TABLES.items() if not contracts.exists(t, Path(place))]
        if absent:
            lacking = getattr(module, "NEEDS", f"table {absent[0]}")
            print(f"{label}: {name.rpartition('.')[2]} left out: the dataset has no {lacking}")
        else:
            wanted.append(name)
    with contracts.replacing(out) as folder:
        trial = partial(_draw, options=options, folder=folder.resolve())
        captions = dict(run_trials(trial, wanted, compute=compute, label=label))
        text = json.dumps(captions, indent=2, ensure_ascii=False) + "\n"
        contracts.write_text(text, folder / "captions.json")


def _draw(name: str, options: dict[str, object], folder: Path) -> tuple[str, dict]:
    module = import_module(name)
    declarations = getattr(module, "DECLARATIONS", PAPER)
    tables = {t: contracts.read(t, Path(p), declarations) for t, p in module.TABLES.items()}
    named = signature(module.draw).parameters
    options = {key: value for key, value in options.items() if key in named}
    # a table comes before an option of its name
    save(module.draw(**(options | tables)), folder, name.rpartition(".")[2])
    return name.rpartition(".")[2], _caption(module)


def _caption(module: ModuleType) -> dict:
    """Title, caption, the numbers that other stages wrote, and where everything comes from."""
    title, _, text = " ".join(module.__doc__.split()).partition(". ")
    sources = [f"{place}/{table}.parquet" for table, place in module.TABLES.items()]
    file, patterns = getattr(module, "METRICS", (None, ()))
    return {
        "title": title,
        "caption": text,
        "numbers": _stated(Path(file), patterns) if file else {},
        "sources": sources + ([file] if file else []),
        "script": module.__name__.replace(".", "/") + ".py",
    }


def _stated(file: Path, patterns: tuple[str, ...]) -> dict:
    if not file.is_file():
        raise ContractError("there are no such metrics; run the stage that writes them", file=file)
    metrics = json.loads(file.read_text(encoding="utf-8"))
    stated = {key: v for key, v in metrics.items() if any(fnmatch(key, p) for p in patterns)}
    if not stated:
        raise ContractError(f"no number named like {' or '.join(patterns)}", file=file)
    return stated
