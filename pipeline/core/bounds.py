"""Bounds on size, time and memory for reading recordings, and a process with these bounds."""

import faulthandler
import pickle
import resource
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from multiprocessing import Pipe, current_process, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field

from pipeline.core.errors import PipelineError, RecordingError
from pipeline.core.validation import options

Bound = Annotated[int, Field(gt=0)]
MIB = 1 << 20


@options(frozen=True)
class Reading:
    """Greatest size, reading time and memory of one recording file; errors name the bound."""

    file_mib: Bound = 64  # of a file that is read whole; bags and archives are read in parts
    part_mib: Bound = 64  # of a part that is unpacked at once: a frame, an array, a chunk of a bag
    markers: Bound = 2000  # of a take
    seconds: Annotated[float, Field(gt=0)] = 60.0  # of a call in a separate process
    memory_mib: Bound = 2048  # of a call in a separate process, in addition to the program's


DEFAULT = Reading()
_in_force: ContextVar[Reading] = ContextVar("reading")


def bounds() -> Reading:
    """Return the bounds that :func:`within` has set, else the defaults."""
    return _in_force.get(DEFAULT)


def within(reading: Reading, function: Callable, *arguments: object) -> Any:
    """Return ``function(*arguments)`` within the bounds ``reading``."""
    before = _in_force.set(reading)
    try:
        return function(*arguments)
    finally:
        _in_force.reset(before)


def require(bound: str, amount: float, what: str, file: Path) -> None:
    """Raise RecordingError where the ``amount`` of ``what`` in ``file`` is above the ``bound``."""
    if amount > (most := getattr(bounds(), bound)):
        found = f"found {amount:.6g} {what}, at most {most} are allowed"
        option = f"dataset.reading.{bound}"
        raise RecordingError(f"{found}: damaged file, or raise the bound", file=file, bound=option)


def read_whole(file: Path) -> bytes:
    """Return all bytes of ``file``; RecordingError above ``file_mib``, OSError if unreadable."""
    with Path(file).open("rb") as stream:
        require("file_mib", stream.seek(0, 2) / MIB, "MiB", file)
        stream.seek(0)
        return stream.read()


def call_alone(function: Callable, *arguments: object, file: Path) -> Any:
    """Return ``function(*arguments)`` called in a :class:`Sandbox`; errors name the ``file``."""
    with Sandbox() as sandbox:
        try:
            return sandbox.call(function, *arguments)
        except RecordingError as error:
            raise RecordingError(error.message, **{"file": file} | error.evidence) from None


class Sandbox:
    """Context manager that calls functions in a forked process, or in a new one if it has ended."""

    def __init__(self) -> None:
        self._process = self._connection = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._connection.close()
        self._process = self._connection = None

    def call(self, function: Callable, *arguments: object) -> Any:
        """Return ``function(*arguments)``; function, arguments and result are pickled.

        Raises the pipeline's errors of the function unchanged. Raises RecordingError for any other
        exception, and where the call exceeds ``seconds`` or ``memory_mib`` or ends the process.
        """
        if current_process().daemon:  # a worker of Dask may not start a process: a hang ends it
            faulthandler.dump_traceback_later(bounds().seconds, exit=True)
            try:
                outcome = _outcome(function, arguments)
            finally:
                faulthandler.cancel_dump_traceback_later()
        else:
            if self._process is None:
                self._connection, other = Pipe()
                # a fork has all imports at once; no library with threads has run here
                ends = other, self._connection
                self._process = get_context("fork").Process(target=_serve, args=ends)
                self._process.start()
                other.close()
            self._connection.send_bytes(pickle.dumps((function, arguments)))
            if not self._connection.poll(bounds().seconds):
                self.__exit__()
                raise _refusal(f"the file is not read within {bounds().seconds:g} s", "seconds")
            try:
                outcome = pickle.loads(self._connection.recv_bytes())
            except (EOFError, ConnectionResetError):
                self._process.join()
                code = self._process.exitcode
                self.__exit__()
                raise RecordingError(f"reading it ends the process (exit code {code})") from None
        if isinstance(outcome, PipelineError):
            raise outcome
        return outcome


def _serve(connection: Connection, other: Connection) -> None:
    """Run calls until the caller ends, with an address space of at most ``memory_mib`` more."""
    other.close()  # else the end of the caller would not be noticed
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = taken + bounds().memory_mib * MIB
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
    while True:
        try:
            function, arguments = pickle.loads(connection.recv_bytes())
        except EOFError:
            return
        # a nested sandbox ends earlier, because its caller has the more exact message
        half = replace(bounds(), seconds=bounds().seconds / 2)
        outcome = within(half, _outcome, _call_pickled, (function, *arguments))
        connection.send_bytes(outcome if isinstance(outcome, bytes) else pickle.dumps(outcome))


def _call_pickled(function: Callable, *arguments: object) -> bytes:
    return pickle.dumps(function(*arguments))


def _outcome(function: Callable, arguments: tuple) -> Any:
    """Return ``function(*arguments)``, or a RecordingError for its exception."""
    try:
        return function(*arguments)
    except PipelineError as error:
        return error
    except MemoryError:
        return _refusal(f"it needs more than {bounds().memory_mib} MiB of memory", "memory_mib")
    except RecursionError:
        return RecordingError("the file nests too deeply to be read")
    except Exception as error:
        words = " ".join(str(error).split())[:200]
        return RecordingError(f"its reader fails on it ({type(error).__name__}: {words})")


def _refusal(message: str, bound: str) -> RecordingError:
    option = f"dataset.reading.{bound}"
    return RecordingError(f"{message}: the file is damaged or too large", bound=option)
