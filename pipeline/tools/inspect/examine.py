"""Accounts of the recordings in a file or a folder, each by the stages' own reader of its format.

Files are read in a process of their own (:mod:`pipeline.core.bounds`), which bounds the
time and memory that one of them takes. Nothing is executed or changed.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

from pipeline.core.bounds import Sandbox
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.formats.depth.index import frame_endings
from pipeline.formats.format import is_bag
from pipeline.tools.inspect.finding import Finding
from pipeline.tools.inspect.joints import compare_tables
from pipeline.tools.inspect.kinds import described, numbered_sequence

NUMBERED = re.compile(r"(.*?)(\d+)(\D*)")
INDEXES = (".txt", ".csv", "")  # endings of the names of indexes of frames
MAX_FILES = 100_000  # of a folder


def inspect(place: Path) -> list[Finding]:
    """Return the account of ``place``, or of every file below it; frames of one depth sequence, and
    the files of one bag, are one recording.

    A file that cannot be read is a finding too, with the reason in ``stops``. Raises RecordingError
    where ``place`` does not exist, and for a folder of more than MAX_FILES files.
    """
    if not os.path.exists(place):
        raise RecordingError("there is no such file or folder", file=place)
    with Sandbox() as sandbox:

        def read(file: Path, describe: Callable[[Path], Finding] = described) -> Finding:
            try:
                return sandbox.call(describe, file)
            except PipelineError as error:
                return Finding(file).refused(error)

        if is_bag(place) or not place.is_dir():
            return [read(place)]
        files, bags, findings = _files(place)
        findings += map(read, bags)
        indexes = [read(file) for file in files if file.suffix.lower() in INDEXES]
        findings += indexes
        # an index may name depth/../depth/1.png
        placed = {os.path.normpath(one.file) for one in indexes}
        placed |= {os.path.normpath(frame) for one in indexes for frame in one.files}
        others = [file for file in files if os.path.normpath(file) not in placed]
        for pattern, frames in _sequences(others).items():
            findings.append(read(pattern, numbered_sequence))
            others = [file for file in others if file not in frames]
        findings += map(read, others)
    compare_tables(findings)
    return sorted(findings, key=lambda finding: str(finding.file))


def _files(folder: Path) -> tuple[list[Path], list[Path], list[Finding]]:
    """Return all files below ``folder`` but hidden ones and those of bags, the bags that are
    folders, and the folders that cannot be read; no link to a folder is followed.
    """
    files, bags, unread = [], [], []

    def closed(error: OSError) -> None:
        reason = f"the folder cannot be read ({error.strerror})"
        unread.append(Finding(Path(error.filename or folder), stops=[reason]))

    for place, folders, names in os.walk(folder, onerror=closed):
        below = [Path(place, name) for name in folders if not name.startswith(".")]
        bags += filter(is_bag, below)
        folders[:] = [path.name for path in below if not is_bag(path)]
        files += [Path(place, name) for name in names if not name.startswith(".")]
        if len(files) > MAX_FILES:
            message = f"more than {MAX_FILES} files; name a folder of recordings"
            raise RecordingError(message, file=folder)
    return sorted(files), sorted(bags), unread


def _sequences(files: list[Path]) -> dict[Path, set[Path]]:
    """Return pattern → frames whose names differ in their last number alone."""
    groups: dict[Path, set[Path]] = {}
    for file in files:
        if file.suffix.lower() in frame_endings() and (parts := NUMBERED.fullmatch(file.stem)):
            pattern = file.with_name(f"{parts[1]}[0-9]*{parts[3]}{file.suffix}")
            groups.setdefault(pattern, set()).add(file)
    return {pattern: frames for pattern, frames in groups.items() if len(frames) > 1}
