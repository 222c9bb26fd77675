"""The recordings in a file or a folder: each named by its format, with what it says of itself.
Nothing is executed or changed, and what a file makes of its reader stays with its finding.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

from pipeline.core.compute.sandbox import Sandbox
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.formats import rosbag
from pipeline.formats.depth.index import frame_endings
from pipeline.formats.format import Kind, is_bag
from pipeline.formats.joints import bag as joint_bag
from pipeline.tools.inspect import bag, joints, sequence
from pipeline.tools.inspect.finding import UNKNOWN, Finding
from pipeline.tools.inspect.kinds import known_as

NUMBERED = re.compile(r"(.*?)(\d+)(\D*)")
INDEXES = (".txt", ".csv", "")  # how the names of indexes of frames end
MAX_FILES = 100_000  # of a folder
MAX_LEVELS = 50  # of folders in one another


def inspect(place: Path) -> list[Finding]:
    """What ``place``, or every file below it, is; frames of one depth sequence, and the files of
    one bag, are one recording.

    What cannot be read is a finding too, with the reason in ``stops``. Raises RecordingError where
    ``place`` does not exist, and for a folder of more files than any recordings have.
    """
    if not os.path.exists(place):
        raise RecordingError("there is no such file or folder", file=place)
    with Sandbox() as sandbox:

        def guarded(place: Path) -> Finding:
            return _guarded(sandbox, Finding(place, UNKNOWN), described, place)

        if is_bag(place) or not place.is_dir():
            return [guarded(place)]
        files, bags, unread = _files(place)
        findings = unread + [guarded(bag) for bag in bags]
        candidates = [file for file in files if file.suffix.lower() in INDEXES]
        indexes = [file for file in candidates if _is_index(file)]
        findings += [guarded(index) for index in indexes]
        covered = _covered(findings) | set(map(os.path.normpath, indexes))
        groups = _numbered([file for file in files if os.path.normpath(file) not in covered])
        for folder, pattern, frames in groups:
            frame = Finding(folder / pattern, sequence.NUMBERED, Kind.SEQUENCE)
            findings.append(_guarded(sandbox, frame, sequence.numbered, folder, pattern))
            covered |= {os.path.normpath(file) for file in frames}
        findings += [guarded(file) for file in files if os.path.normpath(file) not in covered]
    joints.compare_tables(findings)
    return sorted(findings, key=lambda finding: str(finding.file))


def _guarded(sandbox: Sandbox, unread: Finding, describe: Callable, *arguments: object) -> Finding:
    """What ``describe`` finds, in the sandbox; ``unread`` with the reason where it is refused."""
    try:
        return sandbox.call(describe, *arguments)
    except PipelineError as error:
        return unread.refused(error)


def _covered(sequences: list[Finding]) -> set[str]:
    # an index may name depth/../depth/1.png
    return {os.path.normpath(frame) for finding in sequences for frame in finding.files}


def _files(folder: Path) -> tuple[list[Path], list[Path], list[Finding]]:
    """All files below ``folder`` but hidden ones and those of bags, the bags that are folders, and
    the folders that cannot be read; no link to a folder is followed.
    """
    files, bags, unread = [], [], []
    waiting = [(folder, 0)]
    while waiting:
        place, level = waiting.pop()
        try:
            entries = sorted(os.scandir(place), key=lambda entry: entry.name)
        except OSError as error:
            reason = f"the folder cannot be read ({error.strerror})"
            unread.append(Finding(place, UNKNOWN, stops=[reason]))
            continue
        for entry in entries:
            path = Path(entry)
            if entry.name.startswith("."):
                continue
            if not entry.is_dir():
                files.append(path)
            elif is_bag(path):
                bags.append(path)
            elif level == MAX_LEVELS:
                reason = f"folders lie more than {MAX_LEVELS} levels deep: inspect this one itself"
                unread.append(Finding(path, UNKNOWN, stops=[reason]))
            elif not entry.is_symlink():
                waiting.append((path, level + 1))
        if len(files) > MAX_FILES:
            raise RecordingError(
                f"more than {MAX_FILES} files; name a folder of recordings", file=folder
            )
    return sorted(files), sorted(bags), unread


def _numbered(files: list[Path]) -> list[tuple[Path, str, list[Path]]]:
    """Folder, pattern and files of each group of frames whose names differ in their last number
    alone.
    """
    groups: dict[tuple[Path, str, str], list[Path]] = {}
    for file in files:
        if file.suffix.lower() in frame_endings() and (parts := NUMBERED.fullmatch(file.stem)):
            groups.setdefault((file.parent, parts[1], parts[3] + file.suffix), []).append(file)
    return [
        (folder, f"{before}[0-9]*{after}", frames)
        for (folder, before, after), frames in groups.items()
        if len(frames) > 1
    ]


def _is_index(file: Path) -> bool:
    try:
        return _unreadable(file) is None and known_as(file).kind == Kind.SEQUENCE
    except OSError:
        return False


def described(file: Path) -> Finding:
    """What one file or bag is, read in this process."""
    if reason := _unreadable(file):
        return Finding(file, UNKNOWN, stops=[reason])
    finding = Finding(file, UNKNOWN)
    try:
        if is_bag(file):
            finding = Finding.read_by(rosbag.FORMAT, file)
            contents = bag.bag(rosbag.FORMAT, file)
            return joints.log(joint_bag.FORMAT, file) if bag.is_of_joints(contents) else contents
        known = known_as(file)
        finding = Finding(file, known.name, known.kind)
        return known.describe(file)
    except PipelineError as error:
        return finding.refused(error)
    except OSError as error:
        finding.stops.append(f"the file cannot be read ({error.strerror})")
        return finding


def _unreadable(file: Path) -> str | None:
    """Why a file is not opened."""
    try:
        if is_bag(file):
            return None
        if not file.is_file():
            return "this is no regular file, or a link to nothing"
        size = file.stat().st_size
    except OSError as error:
        return f"the file cannot be read ({error.strerror})"
    return "the file is empty" if size == 0 else None
