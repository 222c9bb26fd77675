"""The bounds within which every file of recordings is read: those of the section
``dataset.reading`` while it is in force, else its defaults.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from pipeline.core.errors import RecordingError
from pipeline.core.options.reading import Reading

MIB = 1 << 20
DEFAULT = Reading()
_in_force: ContextVar[Reading] = ContextVar("reading")


def bounds() -> Reading:
    """The bounds in force."""
    return _in_force.get(DEFAULT)


def within(reading: Reading, function: Callable, *arguments: object) -> Any:
    """``function(*arguments)``, within the bounds ``reading``; a function, so that a worker can be
    given it.
    """
    before = _in_force.set(reading)
    try:
        return function(*arguments)
    finally:
        _in_force.reset(before)


def require(bound: str, amount: float, what: str, file: Path) -> None:
    """RecordingError, with the option that raises the ``bound``, where ``file`` has a greater
    ``amount`` of ``what``.
    """
    most = getattr(bounds(), bound)
    if amount > most:
        raise RecordingError(
            f"{amount:.6g} {what} are more than the {most} that are read: damaged, or raise the "
            "bound",
            file=file,
            bound=f"dataset.reading.{bound}",
        )


def read_whole(file: Path) -> bytes:
    """All bytes of ``file``; RecordingError where they are more than ``file_mib``, OSError where it
    cannot be read.
    """
    with Path(file).open("rb") as stream:
        size = stream.seek(0, 2)
        require("file_mib", size / MIB, "MiB", file)
        stream.seek(0)
        return stream.read()
