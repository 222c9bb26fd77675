"""The recordings in a file or a folder: each named by its format, with what it says of itself.
Nothing is executed or changed.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from pipeline.core.errors import PipelineError, RecordingError
from pipeline.formats import rosbag
from pipeline.formats.depth.index import frame_endings
from pipeline.formats.format import Kind
from pipeline.formats.rosbag import is_bag
from pipeline.tools.inspect import bag, joints, sequence
from pipeline.tools.inspect.finding import UNKNOWN, Finding
from pipeline.tools.inspect.kinds import known_as
from pipeline.tools.inspect.limits import MAX_BYTES, MAX_FILES, bounded

NUMBERED = re.compile(r"(.*?)(\d+)(\D*)")
INDEXES = (".txt", ".csv", "")  # how the names of indexes of frames end


def inspect(place: Path) -> list[Finding]:
    """What ``place``, or every file below it, is; frames of one depth sequence, and the files of
    one bag, are one recording.

    What cannot be read is a finding too, with the reason in ``stops``. Raises RecordingError where
    ``place`` does not exist, and for a folder of more files than any recordings have.
    """
    if not place.exists():
        raise RecordingError("there is no such file or folder", file=place)
    if is_bag(place) or not place.is_dir():
        return [_described(place)]
    files, bags = _files(place)
    findings = [_described(bag) for bag in bags]
    indexes = [file for file in files if file.suffix.lower() in INDEXES and _is_index(file)]
    findings += [_described(index) for index in indexes]
    covered = _covered(findings) | set(map(os.path.normpath, indexes))
    groups = _numbered([file for file in files if os.path.normpath(file) not in covered])
    findings += [_numbered_sequence(folder, pattern) for folder, pattern, _ in groups]
    covered |= {os.path.normpath(file) for _, _, group in groups for file in group}
    findings += [_described(file) for file in files if os.path.normpath(file) not in covered]
    joints.compare_tables(findings)
    return sorted(findings, key=lambda finding: str(finding.file))


def _covered(sequences: list[Finding]) -> set[str]:
    # an index may name depth/../depth/1.png
    return {os.path.normpath(frame) for finding in sequences for frame in finding.files}


def _files(folder: Path) -> tuple[list[Path], list[Path]]:
    """All files below ``folder`` but hidden ones and those of bags, and the bags that are folders;
    no link to a folder is followed.
    """
    files, bags = [], []
    for root, folders, names in os.walk(folder):
        shown = [Path(root, name) for name in sorted(folders) if not name.startswith(".")]
        bags += [path for path in shown if is_bag(path)]
        folders[:] = [path.name for path in shown if not is_bag(path)]
        files += [Path(root, name) for name in sorted(names) if not name.startswith(".")]
        if len(files) > MAX_FILES:
            raise RecordingError(
                f"more than {MAX_FILES} files; name a folder of recordings", file=folder
            )
    return files, bags


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


def _numbered_sequence(folder: Path, pattern: str) -> Finding:
    try:
        with bounded():
            return sequence.numbered(folder, pattern)
    except PipelineError as error:
        return Finding(folder / pattern, sequence.NUMBERED, Kind.SEQUENCE).refused(error)


def _described(file: Path) -> Finding:
    if reason := _unreadable(file):
        return Finding(file, UNKNOWN, stops=[reason])
    finding = Finding.read_by(rosbag.FORMAT, file)
    try:
        with bounded():
            if is_bag(file):
                return bag.bag(rosbag.FORMAT, file)
            known = known_as(file)
            finding = Finding(file, known.name, known.kind)
            return known.describe(file)
    except PipelineError as error:
        return finding.refused(error)
    except OSError as error:
        finding.stops.append(f"the file cannot be read ({error.strerror})")
        return finding


def _unreadable(file: Path) -> str | None:
    """Why a file is not opened; bags are read message by message, so that they may be of any
    size.
    """
    try:
        if is_bag(file):
            return None
        if not file.is_file():
            return "this is no regular file, or a link to nothing"
        size = file.stat().st_size
    except OSError as error:
        return f"the file cannot be read ({error.strerror})"
    if size > MAX_BYTES and file.suffix not in rosbag.SUFFIXES:
        return f"{size / 2**30:.1f} GiB are more than is read of one file"
    return "the file is empty" if size == 0 else None
