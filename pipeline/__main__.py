"""``python -m pipeline STAGE [ITEM]`` runs one stage of dvc.yaml, ``python -m pipeline COMMAND …`` what a person asks for beside them.

Either says in one line why it cannot.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path

from pipeline.errors import PipelineError


def main() -> int:
    """Run what is named on the command line; 1 with one message on standard error when the pipeline refuses."""
    # what is imported stays: to go through it for garbage again and again, as in every compilation, finds nothing and takes its time
    gc.disable()
    name, run = _chosen(sys.argv[1:])
    gc.freeze()
    gc.enable()
    try:
        run()
        sys.stdout.flush()
    except PipelineError as error:
        print(f"error: {name}: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        # whoever reads the output has read enough; nothing more is flushed to it on the way out
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    return 0


def _chosen(words: list[str]) -> tuple[str, Callable[[], None]]:
    """The name of the stage or command, and what runs it."""
    commands = [name.replace("_", "-") for name in _modules("commands")]
    if words[:1] and words[0] in commands:
        return words[0], partial(import_module(f"pipeline.commands.{words[0].replace('-', '_')}").run, words[1:])
    parser = argparse.ArgumentParser(
        prog="python -m pipeline",
        description="One stage of the experiment; `dvc repro` runs them all in order.",
        epilog=f"There are also the commands {', '.join(commands)}: each explains itself with --help.",
    )
    parser.add_argument("stage", choices=_modules("stages"))
    parser.add_argument("item", nargs="?", help="the model, for stages that run once per model; the folder, for inventory")
    arguments = parser.parse_args(words)
    run = import_module(f"pipeline.stages.{arguments.stage}").run
    if len(signature(run).parameters) != (arguments.item is not None):
        parser.error(f"{arguments.stage} takes no item" if arguments.item else f"{arguments.stage} runs for one item: name it")
    return arguments.stage, partial(run, arguments.item) if arguments.item else run


def _modules(room: str) -> list[str]:
    return sorted(file.stem for file in (Path(__file__).parent / room).glob("[a-z]*.py"))


if __name__ == "__main__":
    sys.exit(main())
