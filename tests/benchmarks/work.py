"""The stages one after another in this process, and what of the processor time passes in the rooms
of the pipeline: the work itself, without imports, processes, and tables between stages. ``python
work.py ANSWER`` in a copy of the project; the plan is JSON on its input.

A stage is thin: what it calls of the rooms is rendering, encoding, decoding, a fit, a filter, a
figure. Whatever is run twice is imported and compiled the first time, so that the second has the
work alone.
"""

from __future__ import annotations

import ast
import functools
import inspect
import json
import pkgutil
import sys
import time
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType

sys.path.insert(0, str(Path.cwd()))
sys.path.insert(0, str(Path.cwd() / "tests"))
from project_copy import set_parameters

import pipeline.core.environment  # noqa: F401 - before numpy: it fixes the arithmetic

# what stages use between the rooms
BETWEEN = {"core", "stages"}

spent: Counter[str] = Counter()  # s by room
inside = [False]


def counted(function: FunctionType, room: str) -> FunctionType:
    """``function``, its processor time added to that of ``room`` unless what called it is counted
    already.
    """

    @functools.wraps(function)
    def call(*arguments: object, **named: object) -> object:
        if inside[0]:
            return function(*arguments, **named)
        inside[0], begin = True, time.process_time()
        try:
            result = function(*arguments, **named)
        finally:
            spent[room] += time.process_time() - begin
            inside[0] = False
        if isinstance(result, functools.partial) and room_of(result.func):
            # a function that the stage is handed to call
            return functools.partial(count(result.func), *result.args, **result.keywords)
        return result

    return call


def room_of(thing: object) -> str | None:
    """The room whose work ``thing`` is, where it is not counted yet."""
    place = (getattr(thing, "__module__", None) or "").split(".")
    work = place[0] == "pipeline" and place[1] not in BETWEEN
    return place[1] if work and not hasattr(thing, "__wrapped__") else None


def count(function: FunctionType) -> FunctionType:
    """``function`` counted, under every name that the pipeline has for it, so that it can still be
    pickled.
    """
    replacement = counted(function, room_of(function))
    for module in [module for name, module in sys.modules.items() if name.startswith("pipeline.")]:
        for name in [name for name, value in vars(module).items() if value is function]:
            setattr(module, name, replacement)
    return replacement


def named_by(module: ModuleType) -> Iterator[object]:
    """What ``module`` imports of the pipeline by name, at its top or in a function, and what is in
    the modules that it imports whole.
    """
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("pipeline"):
            continue
        for name in (alias.name for alias in node.names):
            thing = pkgutil.resolve_name(f"{node.module}.{name}")
            if inspect.ismodule(thing):
                yield from (
                    value
                    for value in vars(thing).values()
                    if getattr(value, "__module__", None) == thing.__name__
                )
            else:
                yield thing


def count_calls(stage: str) -> None:
    """Count what ``stage`` calls of the rooms."""
    for thing in list(named_by(import_module(f"pipeline.stages.{stage}"))):
        room = room_of(thing)
        if room and inspect.isclass(thing):
            for name, method in list(vars(thing).items()):
                if (
                    isinstance(method, FunctionType)
                    and not name.startswith("_")
                    and not hasattr(method, "__wrapped__")
                ):
                    setattr(thing, name, counted(method, room))
        elif room and isinstance(thing, FunctionType):
            count(thing)


def once(stages: list[list[str]]) -> dict:
    """Run ``stages``; the work in s by stage, its item and room."""
    work: dict[str, dict[str, float]] = {}
    for stage, *item in stages:
        spent.clear()
        import_module(f"pipeline.stages.{stage}").run(*item)
        work[" ".join([stage, *item])] = dict(spent)
    return work


def main(answer: Path) -> None:
    """Run the plan's stages once on each of its scales and write what that gave."""
    plan = json.load(sys.stdin)
    for stage in dict.fromkeys(stage for stage, *_ in plan["stages"]):
        count_calls(stage)
    known = []
    for scale in plan["scales"]:
        set_parameters(Path.cwd(), scale=scale, compute="serial")
        known.append(once(plan["stages"]))
    answer.write_text(json.dumps(known))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
