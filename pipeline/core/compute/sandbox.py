"""A process of its own for what reads the bytes of others: libraries that crash, never return or
take all memory on damaged ones end it, and not the program.
"""

from __future__ import annotations

import pickle
import resource
from collections.abc import Callable
from dataclasses import replace
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from pipeline.core.bounds import MIB, bounds, within
from pipeline.core.errors import PipelineError, RecordingError

PAGE = resource.getpagesize()


def call_alone(function: Callable, *arguments: object, file: Path) -> Any:
    """``function(*arguments)`` in a process of its own; what is raised names the ``file``."""
    with Sandbox() as sandbox:
        try:
            return sandbox.call(function, *arguments)
        except RecordingError as error:
            evidence = {"file": file} | error.evidence
            raise RecordingError(error.message, **evidence) from None


class Sandbox:
    """Calls functions, one after the other, in a process that is a fork of this one as it was at
    the first call; a new one takes the place of one that was ended. For a ``with`` statement.
    """

    def __init__(self) -> None:
        self._process = self._connection = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def call(self, function: Callable, *arguments: object) -> Any:
        """``function(*arguments)``, all of which is pickled.

        Raises what the function raises of the pipeline's errors; RecordingError for any other
        exception of it, and where it takes longer than the bound ``seconds``, more memory than
        ``memory_mib`` beside what the process has, or ends the process.
        """
        if self._process is None:
            self._start()
        self._connection.send_bytes(pickle.dumps((function, arguments)))
        seconds = bounds().seconds
        if not self._connection.poll(seconds):
            self._end()
            raise _refusal(f"it is not read within {seconds:g} s", "seconds")
        try:
            outcome = pickle.loads(self._connection.recv_bytes())
        except (EOFError, ConnectionResetError):
            self._process.join()
            code = self._process.exitcode
            self._end()
            raise RecordingError(f"reading it ends the process (exit code {code})") from None
        if isinstance(outcome, PipelineError):
            raise outcome
        return outcome

    def _start(self) -> None:
        self._connection, other = Pipe()
        # a fork has at once all that is imported; nothing has been computed here that has threads
        self._process = get_context("fork").Process(
            target=_serve, args=(other, self._connection, bounds().memory_mib)
        )
        self._process.start()
        other.close()

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._connection.close()
        self._process = self._connection = None


def _serve(connection: Connection, other: Connection, memory_mib: int) -> None:
    other.close()  # so that the end of the caller is seen
    while True:
        try:
            function, arguments = pickle.loads(connection.recv_bytes())
        except EOFError:
            return
        _allow(memory_mib * MIB)
        try:
            # a process of this one ends before it, as its caller knows best what to say
            half = replace(bounds(), seconds=bounds().seconds / 2)
            outcome = pickle.dumps(within(half, function, *arguments))
        except MemoryError:
            refused = _refusal(f"it takes more than {memory_mib} MiB of memory", "memory_mib")
            outcome = pickle.dumps(refused)
        except RecursionError:
            outcome = pickle.dumps(RecordingError("it nests too deeply to be read"))
        except PipelineError as error:
            outcome = pickle.dumps(error)
        except Exception as error:
            said = " ".join(str(error).split())[:200]
            refused = RecordingError(f"its reader fails on it ({type(error).__name__}: {said})")
            outcome = pickle.dumps(refused)
        connection.send_bytes(outcome)


def _allow(memory: int) -> None:
    """Bound the address space to what the process has and ``memory`` bytes."""
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * PAGE
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = taken + memory
    resource.setrlimit(
        resource.RLIMIT_AS, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard)
    )


def _refusal(message: str, bound: str) -> RecordingError:
    return RecordingError(
        f"{message}: damaged, or larger than any recording", bound=f"dataset.reading.{bound}"
    )
