"""Files and folders by the patterns that a dataset names them with."""

from __future__ import annotations

from pathlib import Path

from pipeline.core.errors import ConfigError


def matching(folder: Path, pattern: str, *, key: str) -> list[Path]:
    """What matches the glob ``pattern`` below ``folder``, in order; ConfigError with its ``key``
    where it is none, or not relative.
    """
    try:
        return sorted(folder.glob(pattern))
    except (ValueError, NotImplementedError, IndexError):
        message = (
            f"{pattern!r} is no pattern of files below {folder.as_posix()}: it has to "
            "be a relative path, with * for what differs"
        )
        raise ConfigError(message, key=key) from None


def is_literal(part: str) -> bool:
    """Whether one ``part`` of a pattern, a name between slashes, matches itself alone."""
    return not any(mark in part.replace("[[]", "") for mark in "*?[")
