"""``python -m pipeline NAME …`` runs a stage of dvc.yaml, a study or a tool.

A stage is a module of pipeline/stages, a study a folder of pipeline/studies, a tool a folder of
pipeline/tools: each is found by its place. What cannot be done is said in one line.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path

import pipeline.core.environment  # noqa: F401 - before numpy, whose arithmetic it settles
from pipeline.core.errors import PipelineError

HERE = Path(__file__).parent
USAGE = """usage: python -m pipeline NAME [ITEM | OPTIONS]

stages   {stages}
studies  {studies}
tools    {tools}

`dvc repro` runs the stages in order, `dvc repro -P` the studies too; ITEM is the model of a stage
that runs once a model. A tool explains itself with --help."""
NO_ENVIRONMENT = (
    "the project's environment is missing here: `make` makes it, `. .venv/bin/activate` enters it"
)


def main() -> int:
    """Run what the command line names; 1 with one message on standard error where it cannot."""
    # what is imported stays: to go through it for garbage again and again, as in every compilation,
    # finds nothing and takes its time
    gc.disable()
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"
    try:
        run = _chosen(name, sys.argv[2:])
        gc.freeze()
        gc.enable()
        run()
        sys.stdout.flush()
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("pipeline"):
            raise
        print(f"error: {name}: no module {error.name}; {NO_ENVIRONMENT}", file=sys.stderr)
        return 1
    except PipelineError as error:
        print(f"error: {name}: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        # whoever reads the output has read enough; nothing more is flushed to it on the way out
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return 0


def _chosen(name: str, words: list[str]) -> Callable[[], None]:
    """What runs ``name`` with the ``words`` behind it; SystemExit where nothing does."""
    folder = name.replace("-", "_")
    if folder in (tools := _named("tools/*/command.py")):
        return partial(import_module(f"pipeline.tools.{folder}.command").run, words)
    stages, studies = _named("stages/[a-z]*.py"), _named("studies/*/stage.py")
    if name not in stages + studies:
        usage = USAGE.format(
            stages=" ".join(stages),
            studies=" ".join(studies),
            tools=" ".join(tool.replace("_", "-") for tool in tools),
        )
        if name in ("-h", "--help"):
            print(usage)
            raise SystemExit(0)
        raise SystemExit(f"{usage}\n\nerror: there is no {name!r}")
    place = f"stages.{name}" if name in stages else f"studies.{name}.stage"
    run = import_module(f"pipeline.{place}").run
    if len(signature(run).parameters) != len(words):
        takes = "runs for one item: name it" if signature(run).parameters else "takes no item"
        raise SystemExit(f"error: {name} {takes}")
    return partial(run, *words)


def _named(pattern: str) -> list[str]:
    files = sorted(HERE.glob(pattern))
    return [file.stem if file.parent.name == "stages" else file.parent.name for file in files]


if __name__ == "__main__":
    sys.exit(main())
