"""``python -m pipeline NAME …`` runs a stage of dvc.yaml, a study or a tool.

A stage is a module in pipeline/stages, a study a folder in pipeline/studies, a tool a folder in
pipeline/tools; no other list names them. Every error is one message on standard error.
"""

import argparse
import ast
import ctypes
import errno
import gc
import os
import re
import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import TextIO, get_args

import pipeline.core.environment  # noqa: F401 - before NumPy, whose arithmetic depends on it
from pipeline.core.errors import PipelineError

HERE = Path(__file__).parent
USAGE = """usage: python -m pipeline NAME [ITEM | OPTIONS]

stages   {stages}
studies  {studies}
tools    {tools}

`dvc repro` runs the stages in order, `dvc repro -P` the studies too. ITEM is the model of fit and
filter, the part of ingest (motion, depth, force) and the dataset of record.
NAME --help describes a stage, a study or a tool."""
BY_PARAMS = (
    "options are set in params.yaml, such as `dataset: ur5` and `overrides: {filter: {particles: "
    "100}}`, which `dvc repro` runs, or for one run by `dvc exp run -S dataset=ur5` or "
    "`-S +overrides.filter.particles=100`, and several values by `dvc exp run --queue`"
)
NO_ENVIRONMENT = (
    "the project's environment is missing here: create it with `make env`, activate it with "
    "`. .venv/bin/activate`"
)
# environment variable that prints the traceback of an error
TRACE = "PIPELINE_TRACEBACK"
# but for tab and line end; with the marks that turn the direction of a line
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
OUT_OF_MEMORY = (
    "free some memory, or raise the limit (ulimit -v), and run the command again"
)
PERMISSIONS = "change the permissions of the file or of its folder (ls -ld shows them)"
NO_ROOM = (
    "free some space, or raise the limit (quota, ulimit -f), and run the command again"
)
# error number of the system → what to do
REMEDIES = {
    errno.EROFS: "the file system is read-only: run the command in a copy that can be written",
    errno.ENOENT: "run what writes it, from the project's root; install it if it is a program",
    errno.ENOMEM: OUT_OF_MEMORY,
}
REMEDIES |= dict.fromkeys((errno.EACCES, errno.EPERM), PERMISSIONS)
REMEDIES |= dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), NO_ROOM)


def main() -> int:
    """Run the command line; return the exit code, 1 after an error and its message."""
    gc.disable()  # imports make no garbage, and collections during them take a quarter of a second
    for stream in filter(None, (sys.stdout, sys.stderr)):
        # prints ? for a character that the locale lacks
        stream.reconfigure(errors="replace")
        stream.write = partial(_write_plain, stream)
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"
    try:
        if "DVC_STAGE" in os.environ:
            _end_with_parent()
        try:
            run = _find_call(name, sys.argv[2:])
            gc.freeze()
            gc.enable()
            run()
            code = 0
        except SystemExit as stopped:  # argparse has printed the reason
            code = int(stopped.code or 0)
        if sys.stdout is not None:
            sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print(f"error: {name}: interrupted", file=sys.stderr)
        return 130
    except Exception as error:
        if isinstance(error, OSError):
            # else Python would fail again on the remaining output when it ends
            with suppress(OSError, ValueError, AttributeError):  # no file descriptor
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        # the program that reads the output has ended
        if not isinstance(error, BrokenPipeError):
            if os.environ.get(TRACE):
                traceback.print_exception(error)
            print(
                f"error: {name}: {error_summary(error)}{_restore_hint()}",
                file=sys.stderr,
            )
        return 1


def _write_plain(stream: TextIO, text: str) -> int:
    """Write ``text`` without control characters, on which a terminal acts: names are from files."""
    return type(stream).write(stream, CONTROL.sub("\ufffd", text))


def error_summary(error: Exception) -> str:
    """Return one line for any error: what was found, and what to do about it."""
    if isinstance(error, PipelineError):
        return str(error)
    if isinstance(error, ModuleNotFoundError) and not (error.name or "").startswith(
        "pipeline",
    ):
        return f"no module {error.name}; {NO_ENVIRONMENT}"
    if isinstance(error, OSError) and error.errno:
        file = error.filename2 or error.filename
        place = "standard output" if file is None else os.fsdecode(file)
        remedy = REMEDIES.get(error.errno, "check the file and run the command again")
        return f"{place}: {os.strerror(error.errno)}; {remedy}"
    unloaded = isinstance(error, ImportError) and "failed to map" in str(error)
    if isinstance(error, MemoryError) or unloaded:
        return f"out of memory; {OUT_OF_MEMORY}"
    frames = traceback.extract_tb(error.__traceback__)
    inside = [frame for frame in frames if HERE in Path(frame.filename).parents]
    at = f" [{Path(inside[-1].filename).relative_to(HERE.parent)}, line {inside[-1].lineno}]"
    words = " ".join(str(error).split())
    return (
        f"unexpected {type(error).__name__}: {words}{at if inside else ''}; check the input, and "
        f"report it with the traceback, which {TRACE}=1 prints"
    )


def _end_with_parent() -> None:
    """Have Linux interrupt this process when its parent ends, as DVC after a kill: the next run
    would work on the same outputs. By SIGTERM, as a program started with ``&`` ignores SIGINT.
    """
    if sys.platform == "linux":
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        set_parent_death_signal = 1
        ctypes.CDLL(None).prctl(set_parent_death_signal, signal.SIGTERM)


def _restore_hint() -> str:
    """Return the commands that restore the outputs which DVC removed before it ran this stage."""
    folder, _, stage = os.environ.get("DVC_STAGE", "").rpartition("dvc.yaml:")
    lock = Path(os.environ.get("DVC_ROOT", "."), folder, "dvc.lock")
    if not stage or not lock.is_file():
        return ""
    # needs more than the standard library
    from pipeline.core.typed_yaml import (
        read_yaml,
    )

    commands: dict[str, list[str]] = {}
    for out in read_yaml(lock).get("stages", {}).get(stage, {}).get("outs", []):
        if not Path(path := out["path"]).exists():
            by = "git checkout --" if path.startswith("reports/") else "dvc checkout"
            commands.setdefault(by, []).append(path)
    if not commands:
        return ""
    listed = [f"`{by} {' '.join(paths)}`" for by, paths in sorted(commands.items())]
    restore = f"run {' and '.join(listed)}, or undo the change and run `dvc repro`"
    return f"; to restore the earlier results {restore}"


def _find_call(name: str, words: list[str]) -> Callable[[], object]:
    """Return the call that runs ``name`` with ``words``; PipelineError for an unknown name."""
    stages = sorted(file.stem for file in HERE.glob("stages/[a-z]*.py"))
    studies = sorted(file.parent.name for file in HERE.glob("studies/*/stage.py"))
    tools = sorted(file.parent.name for file in HERE.glob("tools/*/command.py"))
    tool = name.replace("-", "_")
    if tool in tools:
        return tool_call(tool, words)
    if name not in stages + studies:
        usage = USAGE.format(
            stages=" ".join(stages),
            studies=" ".join(studies),
            tools=" ".join(tools).replace("_", "-"),
        )
        if name in ("-h", "--help"):
            return partial(print, usage)
        print(usage, file=sys.stderr)
        remedy = _settings([name, *words])
        raise PipelineError(f"there is no such stage, study or tool{remedy}")
    place = f"stages.{name}" if name in stages else f"studies.{name}.stage"
    if {"-h", "--help"} & set(words):
        summary = _docstring(place).partition("\n\n")[0]
        return partial(print, " ".join(summary.split()))
    if name in studies:
        run = partial(import_module("pipeline.studies.frame").run, name)
    else:
        run = import_module(f"pipeline.{place}").run
    items = signature(run).parameters
    remedy = _settings([name, *words])
    if len(items) != len(words) or remedy:
        takes = f"takes one item ({', '.join(items)})" if items else "takes no item"
        got = " ".join(words) or "none"
        raise PipelineError(f"{takes}, got {got}{remedy}")
    return partial(run, *words)


def _settings(words: list[str]) -> str:
    """Return how options are set, if ``words`` set one in Hydra's notation; else nothing."""
    for word in words:
        if "=" in word or word.startswith("-"):
            return f"; {BY_PARAMS}"
    return ""


def tool_call(folder: str, words: list[str]) -> Callable[[], None]:
    """Return the call of the tool in ``folder`` with the command line ``words``. Its arguments.yaml
    maps names or flags to options of ``add_argument``; types and defaults are those of its ``run``.
    """
    # needs more than the standard library
    from pipeline.core.typed_yaml import (
        read_yaml,
    )

    tool = import_module(f"pipeline.tools.{folder}.command")
    text = _docstring(f"tools.{folder}.command")
    description, _, epilog = text.partition(": ")[2].partition("\n\n")
    program = f"python -m pipeline {folder.replace('_', '-')}"
    parser = argparse.ArgumentParser(
        prog=program,
        description=description,
        epilog=epilog,
    )
    for name, stated in read_yaml(HERE / f"tools/{folder}/arguments.yaml").items():
        parameter = signature(tool.run).parameters[stated.get("dest", name.strip("-"))]
        kinds = {parameter.annotation, *get_args(parameter.annotation)}
        options = dict([("type", kind) for kind in (Path, int, float) if kind in kinds])
        if parameter.default is not parameter.empty:
            options["default"] = parameter.default
        if bool in kinds:
            options["action"] = "store_true"
        elif name[0] != "-":
            options |= {
                "metavar": name.upper(),
                "nargs": "?" if "default" in options else None,
            }
        parser.add_argument(name, **options | stated)
    return partial(tool.run, **vars(parser.parse_args(words)))


def _docstring(place: str) -> str:
    """Docstring of a module, from its source: PYTHONOPTIMIZE=2 leaves none in memory."""
    source = HERE / f"{place.replace('.', '/')}.py"
    return ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""


if __name__ == "__main__":
    sys.exit(main())
