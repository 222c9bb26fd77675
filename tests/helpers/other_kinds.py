"""Kinds of files other than joint logs: see :class:`kinds.FileKind`."""

from kinds import FileKind

KINDS: list[FileKind] = []
