"""Compilation by numba: one way for the whole project, and a cache of machine code that is never
stale.

numba keeps what it compiled with ``cache=True`` and takes it up again while the function's own file
is as it was. But a compiled function holds within it those that it calls and the constants that it
uses, from other files too. So here a file counts as it was only while every module of the pipeline
that it imports, directly or not, is as it was.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numba
from numba import float64, types
from numba.core import caching
from numba.core.typeinfer import register_dispatcher

from pipeline.core.machine_code import Cache, Kept, PartCompiler, WholeCompiler

PROJECT = Path(__file__).parents[2]
VECTOR, MATRIX = types.Array(float64, 1, "C"), types.Array(float64, 2, "C")  # in signatures
IMPORT = re.compile(
    r"^[ \t]*(?:import (?P<module>pipeline[\w.]*)"
    r"|from (?P<parent>pipeline[\w.]*) import (?:\((?P<names>[^)]*)\)|(?P<names_in_line>.*)))",
    re.MULTILINE,
)
CLOSED = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(signature: object = None) -> Callable:
    """Decorator: numba's ``njit`` with the project's options; with a ``signature`` compiled at
    once, else when first called.

    It lets other threads run meanwhile, and a division by zero gives what IEEE 754 says. There is
    no fastmath: with it the bits would differ between processors.
    """

    def kept(function: Callable) -> Callable:
        dispatcher = _dispatcher(function, WholeCompiler)
        if signature is not None:
            with register_dispatcher(dispatcher):
                dispatcher.compile(signature)
            dispatcher.disable_compile()
        return dispatcher

    return kept


def inner(function: Callable) -> Callable:
    """Decorator: a compiled function that compiled functions alone can call, as a part of each; it
    has no machine code of its own.

    A call from Python ends the process: tests call it within a compiled function
    (``tests/compiled_calls.py``).
    """
    return _dispatcher(function, PartCompiler, **CLOSED)


def passed(function: Callable) -> Callable:
    """Decorator: a compiled function that is passed to others, which call it by its address.

    It has no other way in and compiles the sooner for it; a call from Python ends the process, as
    with :func:`inner`.
    """
    return _dispatcher(function, WholeCompiler, no_cpython_wrapper=True)


def inlined(function: Callable) -> Callable:
    """Decorator: an inner function that becomes part of every function that calls it in the place
    of the call, so that loops around it can be vectorised.
    """
    return _dispatcher(function, PartCompiler, forceinline=True, **CLOSED)


def _dispatcher(function: Callable, compiler: type, **options: bool) -> Callable:
    options = {"nogil": True, "error_model": "numpy", "pipeline_class": compiler} | options
    dispatcher = numba.njit(**options)(function)
    dispatcher._cache = Cache(function)
    return dispatcher


@cache
def sources_stamp(file: str) -> str:
    """Hash of the module in ``file`` and of all modules of the pipeline that it imports, directly
    or not.
    """
    reached: set[Path] = set()
    waiting = [Path(file)]
    while waiting:
        module = waiting.pop()
        if module not in reached:
            reached.add(module)
            waiting += _read(module)[1]
    return hashlib.sha256(b"".join(_read(module)[0] for module in sorted(reached))).hexdigest()


@cache
def _read(module: Path) -> tuple[bytes, list[Path]]:
    """The hash of ``module``, and the files of the pipeline that its statements import; read as
    text, as to parse every module takes as long as to import them.
    """
    content, files = module.read_bytes(), []
    for match in IMPORT.finditer(content.decode()):
        parent = match["parent"] or match["module"]
        names = re.findall(r"(\w+)(?: as \w+)?", match["names"] or match["names_in_line"] or "")
        for name in (parent, *(f"{parent}.{name}" for name in names)):
            place = PROJECT.joinpath(*name.split("."))
            files += [place.with_suffix(".py"), place / "__init__.py"]
    return hashlib.sha256(content).digest(), [file for file in files if file.is_file()]


class _Stamped:
    """A place of numba's cache whose code is taken up again only while :func:`sources_stamp` is the
    same.
    """

    def get_source_stamp(self) -> str:
        return sources_stamp(self._py_file)


class BesideTheSource(_Stamped, caching.InTreeCacheLocator):
    """``__pycache__``, where Python keeps its own compiled code."""


class OfTheUser(_Stamped, caching.UserWideCacheLocator):
    """The user's cache folder, for a checkout that cannot be written to."""


class OfTheProcess(_Stamped, caching.InTreeCacheLocator):
    """A folder that goes with the process, where no other can be written to: everything is compiled
    anew each time.
    """

    def __init__(self, function: Callable, file: str) -> None:
        super().__init__(function, file)
        self._cache_path = str(
            Path(_passing_folder().name, hashlib.sha256(file.encode()).hexdigest())
        )


@cache
def _passing_folder() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory()


# numba's own setting for this is lost when it reads its environment anew
Kept._locator_classes = [BesideTheSource, OfTheUser, OfTheProcess]
