"""The bounds within which every file of recordings is read: those of the section
``dataset.reading`` while it is in force, else its defaults.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from pipeline.core.errors import RecordingError
from pipeline.core.validation import options

Bound = Annotated[int, Field(gt=0)]

MIB = 1 << 20


@options(frozen=True)
class Reading:
    """Most that one file of recordings may be and take; beyond, it is refused with the name of the
    bound.
    """

    file_mib: Bound = 64  # of a file that is read whole; bags and archives are read in parts
    part_mib: Bound = 64  # of what is unfolded at once: a frame, an array, a chunk of a bag
    markers: Bound = 2000  # of a take
    seconds: Annotated[float, Field(gt=0)] = 60.0  # of what is read in a process of its own
    memory_mib: Bound = 2048  # likewise, beside the program's own


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
