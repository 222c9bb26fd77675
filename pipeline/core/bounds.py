"""Bounds on size, time and memory for reading recordings, and a process with these bounds."""

import errno
import faulthandler
import pickle
import re
import resource
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from multiprocessing import Pipe, current_process, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from signal import SIGKILL, Signals
from tempfile import gettempdir
from typing import Annotated, Any, Self

from pydantic import Field

from pipeline.core.errors import PipelineError, RecordingError
from pipeline.core.validation import options

Bound = Annotated[int, Field(gt=0)]
MIB = 1 << 20
NO_SPACE = (errno.ENOSPC, errno.EDQUOT)
LINK = re.compile(rb"\.{1,2}/[^\n\0]{1,200}")
# beginning of a file that stands for another file: name, remedy
STAND_INS = (
    (
        rb"version https://git-lfs\.github\.com/spec/",
        "a pointer of Git LFS",
        "run `git lfs pull`",
    ),
    (
        rb"(\.\./)*(\.git)?/annex/objects/",
        "a pointer of git-annex",
        "run `git annex get`",
    ),
    (
        rb"(md5: \w+\n|frozen: \w+\n)*(deps|outs):\n",
        "a pointer of DVC",
        "run `dvc pull`",
    ),
    (
        rb"(?i)\s*<(!doctype html|html)\b",
        "a web page",
        "download the file that the page offers",
    ),
)


@options(frozen=True)
class Reading:
    """Greatest size, reading time and memory of one recording file; errors name the bound."""

    # of a file that is read whole; bags and archives are read in parts
    file_mib: Bound = 64
    # of a part that is unpacked at once: a frame, an array, a chunk of a bag
    part_mib: Bound = 64
    markers: Bound = 2000  # of a take
    joints: Bound = 1000  # of a URDF
    seconds: Annotated[float, Field(gt=0)] = 60.0  # of a call in a separate process
    # of a call in a separate process, in addition to the program's
    memory_mib: Bound = 2048


_in_force: ContextVar[Reading] = ContextVar("reading", default=Reading())  # noqa: B039 (frozen)


def bounds() -> Reading:
    """Return the bounds that :func:`within` has set, else the defaults."""
    return _in_force.get()


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
        message = f"found {amount:.6g} {what}, at most {most} are allowed"
        raise _refusal(message, bound, file=file)


class ReaderFailure(RecordingError):
    """A library refused a file, or ended its process: the file may be damaged."""


def require_content(content: bytes, file: Path) -> bytes:
    """Return the beginning ``content`` of ``file``; RecordingError if it stands for another file,
    such as a pointer of Git LFS.
    """
    file = Path(file)
    suffixes = {"a web page": (".html", ".htm"), "a pointer of DVC": (".dvc",)}
    for mark, name, remedy in STAND_INS:
        if file.suffix.lower() in suffixes.get(name, ()):
            continue
        if re.match(mark, content[:1024]):
            raise RecordingError(f"{name} in place of the file: {remedy}", file=file)
    if LINK.fullmatch(content) and (file.parent / content.decode("latin-1")).exists():
        message = f"the text of a link to {content.decode('latin-1')} in place of the file: name "
        raise RecordingError(
            f"{message}the file, or check out with core.symlinks=true",
            file=file,
        )
    return content


def read_whole(file: Path) -> bytes:
    """Return all bytes of ``file``; RecordingError above ``file_mib`` and for a stand-in, OSError
    if unreadable.
    """
    with Path(file).open("rb") as stream:
        require("file_mib", stream.seek(0, 2) / MIB, "MiB", file)
        stream.seek(0)
        return require_content(stream.read(), file)


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
        # a worker of Dask may not start a process: a hang ends it
        if current_process().daemon:
            faulthandler.dump_traceback_later(bounds().seconds, exit=True)
            try:
                outcome = _outcome(function, arguments)
            finally:
                faulthandler.cancel_dump_traceback_later()
        else:
            if self._process is None:
                self._connection, far_end = Pipe()
                # a fork has all imports at once; no library with threads has run here
                ends = far_end, self._connection
                self._process = get_context("fork").Process(target=_serve, args=ends)
                self._process.start()
                far_end.close()
            self._connection.send_bytes(pickle.dumps((function, arguments)))
            if not self._connection.poll(bounds().seconds):
                self.__exit__()
                raise _refusal(
                    f"the file is not read within {bounds().seconds:g} s",
                    "seconds",
                )
            try:
                outcome = pickle.loads(self._connection.recv_bytes())
            except (EOFError, ConnectionResetError):
                self._process.join()
                code = self._process.exitcode
                self.__exit__()
                if code == -SIGKILL:
                    message = "the reading process was killed, as where a machine lacks memory: "
                    raise RecordingError(
                        f"{message}free memory, and run this again",
                    ) from None
                how = Signals(-code).name if code < 0 else f"exit code {code}"
                raise ReaderFailure(f"reading it ends the process ({how})") from None
        if isinstance(outcome, PipelineError):
            raise outcome
        return outcome


def _serve(connection: Connection, callers_end: Connection) -> None:
    """Run calls until the caller ends, with an address space of at most ``memory_mib`` more."""
    callers_end.close()  # else the end of the caller would not be noticed
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    in_use = pages * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = in_use + bounds().memory_mib * MIB
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
        connection.send_bytes(
            outcome if isinstance(outcome, bytes) else pickle.dumps(outcome),
        )


def _call_pickled(function: Callable, *arguments: object) -> bytes:
    return pickle.dumps(function(*arguments))


def _outcome(function: Callable, arguments: tuple) -> Any:
    """Return ``function(*arguments)``, or a RecordingError for its exception."""
    try:
        return function(*arguments)
    except PipelineError as error:
        return error
    except MemoryError:
        return _refusal(
            f"it needs more than {bounds().memory_mib} MiB of memory",
            "memory_mib",
        )
    except RecursionError:
        return RecordingError("the file nests too deeply to be read")
    except ImportError as error:
        return RecordingError(
            f"a package is missing ({error}): run `make`, which installs it",
        )
    except Exception as error:
        if isinstance(error, OSError) and error.errno in NO_SPACE:
            message = f"no space left on device at {gettempdir()}: free some space, or set TMPDIR"
            return RecordingError(message)
        if isinstance(error, OSError) and error.errno is not None:
            return RecordingError(f"the file cannot be read ({error.strerror})")
        words = " ".join(str(error).split())[:200]
        return ReaderFailure(
            f"its reader fails on it ({type(error).__name__}: {words})",
        )


def _refusal(message: str, bound: str, **evidence: object) -> RecordingError:
    evidence |= {"bound": f"dataset.reading.{bound}"}
    return RecordingError(f"{message}: raise the bound for a sound file", **evidence)
