"""The recordings that a dataset's pattern names, each under a name of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pipeline.core.errors import RecordingError
from pipeline.formats.format import is_literal, matching
from pipeline.recordings.quality import require_text


def take_name(path: Path, raw: Path, pattern: str) -> str:
    """Name of the recording at ``path``, which ``pattern`` matches below ``raw``: its path from the
    first part that the pattern leaves open to the last such part, without the ending of a file;
    the last part alone where the pattern leaves none open.
    """
    parts = list(path.relative_to(raw).parts)
    if not path.is_dir():
        parts[-1] = path.stem
    literal = [is_literal(part) for part in Path(pattern).parts]
    if all(literal):
        return parts[-1]
    return "_".join(parts[literal.index(False) : len(parts) - literal[::-1].index(False)])


def named_takes(
    raw: Path, pattern: str, *, key: str, wanted: Callable[[Path], bool] = lambda path: True
) -> dict[str, Path]:
    """Name → path of what ``pattern`` matches below ``raw`` and is ``wanted``, in the order of the
    paths.

    Raises RecordingError where two have one name, or one a name that is no text, ConfigError with
    the ``key`` where the pattern is none.
    """
    named: dict[str, Path] = {}
    for path in filter(wanted, matching(raw, pattern, key=key)):
        require_text(path)
        name = take_name(path, raw, pattern)
        if name in named:
            raise RecordingError(
                f"two recordings are named {name!r}, the other is "
                f"{named[name].relative_to(raw).as_posix()}: rename one of them, or narrow the "
                "pattern",
                file=path,
                key=key,
            )
        named[name] = path
    return named
