"""Bounds on what reading one hostile file may cost."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager

from pipeline.core.errors import RecordingError

PATIENCE = 60.0  # s a file
MEMORY = 8 << 30  # bytes of address space
MAX_BYTES = 1 << 30  # of a file that is read whole
MAX_FILES = 100_000  # of a folder


class _OutOfTimeError(BaseException):
    """No Exception, so that no reader takes it for damage."""


@contextmanager
def bounded(patience: float | None = None, memory: int = MEMORY) -> Iterator[None]:
    """Raises RecordingError where the body takes longer than ``patience`` (s), more than ``memory``
    (bytes), or nests too deeply.
    """
    allowed, expired = patience or PATIENCE, False

    def interrupt(*_: object) -> None:
        nonlocal expired
        expired = True
        raise _OutOfTimeError

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        resource.setrlimit(
            resource.RLIMIT_AS,
            (memory if hard == resource.RLIM_INFINITY else min(memory, hard), hard),
        )
        signal.setitimer(signal.ITIMER_REAL, allowed)
        yield
    except MemoryError:
        raise RecordingError(
            "it unfolds into more than the memory that a recording may take"
        ) from None
    except RecursionError:
        raise RecordingError("it nests too deeply to be read") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        # whatever a library made of the interruption on its way here
        if expired:
            raise RecordingError(
                f"it cannot be read within {allowed:g} s: damaged, or larger than any recording"
            ) from None
