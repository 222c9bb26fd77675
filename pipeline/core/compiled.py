"""Compilation by numba: one way for the whole project, and a cache of machine code that is never
stale.

numba keeps what it compiled with ``cache=True`` and takes it up again while the function's own file
is as it was. But a compiled function holds within it those that it calls and the constants that it
uses, from other files too. So here a file counts as it was only while every module of the pipeline
that it imports, directly or not, is as it was.
"""

from __future__ import annotations

import ast
import hashlib
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numba
from numba import float64, types
from numba.core import caching

PROJECT = Path(__file__).parents[2]
VECTOR, MATRIX = types.Array(float64, 1, "C"), types.Array(float64, 2, "C")  # in signatures
CLOSED = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(*signature: object) -> Callable:
    """Decorator: numba's ``njit`` with the project's options; with a ``signature`` compiled at
    once, else when first called.

    It lets other threads run meanwhile, and a division by zero gives what IEEE 754 says. There is
    no fastmath: with it the bits would differ between processors.
    """
    return numba.njit(*signature, cache=True, nogil=True, error_model="numpy")


def inner(function: Callable) -> Callable:
    """Decorator: a compiled function that compiled functions alone can call; without ways in from
    Python and C it compiles sooner.

    A call from Python ends the process: tests call it within a compiled function
    (``tests/compiled_calls.py``).
    """
    return numba.njit(cache=True, nogil=True, error_model="numpy", **CLOSED)(function)


def passed(function: Callable) -> Callable:
    """Decorator: a compiled function that is passed to others, which call it by its address.

    It has no other way in and compiles the sooner for it; a call from Python ends the process, as
    with :func:`inner`.
    """
    return numba.njit(cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True)(
        function
    )


def inlined(function: Callable) -> Callable:
    """Decorator: an inner function that becomes part of every function that calls it, so that loops
    around it can be vectorised.
    """
    return numba.njit(cache=True, forceinline=True, error_model="numpy", **CLOSED)(function)


@cache
def sources_stamp(file: str) -> str:
    """Hash of the module in ``file`` and of all modules of the pipeline that it imports, directly
    or not.
    """
    found: set[Path] = set()
    waiting = [Path(file)]
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += _imported(module)
    return hashlib.sha256(
        b"".join(hashlib.sha256(module.read_bytes()).digest() for module in sorted(found))
    ).hexdigest()


def _imported(module: Path) -> Iterator[Path]:
    """Files of the pipeline that the statements of ``module`` import."""
    for node in ast.walk(ast.parse(module.read_bytes())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            place = PROJECT.joinpath(*name.split("."))
            if name.split(".")[0] == "pipeline":
                yield from (
                    file
                    for file in (place.with_suffix(".py"), place / "__init__.py")
                    if file.is_file()
                )


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


numba.config.CACHE_LOCATOR_CLASSES = ",".join(
    f"{__name__}.{place.__name__}" for place in (BesideTheSource, OfTheUser, OfTheProcess)
)
