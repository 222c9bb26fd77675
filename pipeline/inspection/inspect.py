"""The recordings in a file or a folder: each named by its format, with what it says of itself. Nothing is executed or changed."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

from pipeline.errors import PipelineError, RecordingError
from pipeline.inspection import depth
from pipeline.inspection.finding import UNKNOWN, Finding
from pipeline.inspection.formats import FRAMES, INDEX, OTHER, Format, format_of
from pipeline.inspection.limits import MAX_BYTES, MAX_FILES, bounded
from pipeline.instruments.rosbag import SUFFIXES as BAGS
from pipeline.instruments.rosbag import is_bag

NUMBERED = re.compile(r"(.*?)(\d+)(\D*)")
SEQUENCE = "depth sequence, numbered"


def inspect(place: Path) -> list[Finding]:
    """What ``place``, or every file below it, is; frames of one depth sequence, and the files of one bag, are one recording.

    What cannot be read is a finding too, with the reason in ``stops``. Raises RecordingError where ``place`` does not exist, and for a
    folder of more files than any recordings have.
    """
    if not place.exists():
        raise RecordingError("there is no such file or folder", file=place)
    if is_bag(place) or not place.is_dir():
        return [_described(place)]
    files, bags = _files(place)
    findings, covered = [_described(bag) for bag in bags], set()
    for index in [file for file in files if file.suffix.lower() in (".txt", ".csv", "") and _format(file) is INDEX]:
        finding, frames = _sequence(index, INDEX.name, lambda index=index: depth.sequence(index))
        findings.append(finding)
        # an index may name depth/../depth/1.png
        covered |= set(map(os.path.normpath, [index, *frames]))
    for folder, pattern, group in _numbered([file for file in files if os.path.normpath(file) not in covered]):
        finding, _ = _sequence(folder / pattern, SEQUENCE, lambda folder=folder, pattern=pattern: depth.numbered(folder, pattern))
        findings.append(finding)
        covered |= set(map(os.path.normpath, group))
    findings += [_described(file) for file in files if os.path.normpath(file) not in covered]
    return sorted(findings, key=lambda finding: str(finding.file))


def _files(folder: Path) -> tuple[list[Path], list[Path]]:
    """All files below ``folder`` but hidden ones and those of bags, and the bags that are folders; no link to a folder is followed."""
    files, bags = [], []
    for root, folders, names in os.walk(folder):
        shown = [Path(root, name) for name in sorted(folders) if not name.startswith(".")]
        bags += [path for path in shown if is_bag(path)]
        folders[:] = [path.name for path in shown if not is_bag(path)]
        files += [Path(root, name) for name in sorted(names) if not name.startswith(".")]
        if len(files) > MAX_FILES:
            raise RecordingError(f"more than {MAX_FILES} files; name a folder of recordings", file=folder)
    return files, bags


def _numbered(files: list[Path]) -> list[tuple[Path, str, list[Path]]]:
    """Folder, pattern and files of each group of frames whose names differ in their last number alone."""
    groups: dict[tuple[Path, str, str], list[Path]] = {}
    for file in files:
        if file.suffix.lower() in FRAMES and (parts := NUMBERED.fullmatch(file.stem)):
            groups.setdefault((file.parent, parts[1], parts[3] + file.suffix), []).append(file)
    return [(folder, f"{before}[0-9]*{after}", found) for (folder, before, after), found in groups.items() if len(found) > 1]


def _format(file: Path) -> Format:
    try:
        return OTHER if _unreadable(file) else format_of(file)
    except OSError:
        return OTHER


def _sequence(place: Path, name: str, describe: Callable[[], tuple[Finding, list[Path]]]) -> tuple[Finding, list[Path]]:
    """What the sequence at ``place`` is, and the frames that belong to it."""
    try:
        with bounded():
            return describe()
    except PipelineError as error:
        return Finding(place, name).refused(error), []


def _described(file: Path) -> Finding:
    if reason := _unreadable(file):
        return Finding(file, UNKNOWN, stops=[reason])
    name = "ROS bag"
    try:
        with bounded():
            if is_bag(file):
                return depth.bag(file)
            form = format_of(file)
            name = form.name
            return form.describe(file)
    except PipelineError as error:
        return Finding(file, name).refused(error)
    except OSError as error:
        return Finding(file, name, stops=[f"the file cannot be read ({error.strerror})"])


def _unreadable(file: Path) -> str | None:
    """Why a file is not opened; bags are read message by message, so that they may be of any size."""
    try:
        if is_bag(file):
            return None
        if not file.is_file():
            return "this is no regular file, or a link to nothing"
        size = file.stat().st_size
    except OSError as error:
        return f"the file cannot be read ({error.strerror})"
    if size > MAX_BYTES and file.suffix not in BAGS:
        return f"{size / 2**30:.1f} GiB are more than is read of one file"
    return "the file is empty" if size == 0 else None
