"""``python -m pipeline inspect FILE|FOLDER [--json]``: format, rate, units and counted faults of
recordings, options that they leave open, and reasons that would stop their analysis.

Each file is read by the stages' own reader of its format, in a process of its own, which bounds
the time and memory that it takes.
"""

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from pipeline.core.bounds import Reading, Sandbox, within
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.formats.depth.image import frame_endings
from pipeline.formats.format import is_bag
from pipeline.tools.inspect.finding import Finding, as_json, as_table
from pipeline.tools.inspect.joints import compare_tables
from pipeline.tools.inspect.kinds import described, numbered_sequence

NUMBERED = re.compile(r"(.*?)(\d+)(\D*)")
INDEXES = (".txt", ".csv", "")  # endings of the names of indexes of frames
DEFAULTS = " ".join(f"{name}={most:g}" for name, most in vars(Reading()).items())
BOUNDS = f"bounds of what a file may be and take, as in dataset.reading (default {DEFAULTS})"
ARGUMENTS = {
    "place": {"type": Path, "metavar": "FILE|FOLDER", "help": "file or folder to inspect"},
    "--json": {"action": "store_true", "help": "every fact as JSON (default: a table)"},
    "--reading": {"nargs": "+", "default": [], "metavar": "NAME=VALUE", "help": BOUNDS},
}


def run(place: Path, json: bool, reading: Sequence[str]) -> None:
    """Print the findings as a table or as JSON."""
    bounds = Reading(**dict(word.partition("=")[::2] for word in reading))
    findings = within(bounds, inspect, place)
    print(as_json(findings) if json else as_table(findings, place))


def inspect(place: Path) -> list[Finding]:
    """Return the account of ``place``, or of every file below it; frames of one depth sequence, and
    the files of one bag, are one recording.

    A file that cannot be read is a finding too, with the reason in ``stops``. Raises RecordingError
    where ``place`` does not exist.
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
        files, bags = _files(place)
        indexes = [read(file) for file in files if file.suffix.lower() in INDEXES]
        # an index may name depth/../depth/1.png
        placed = {os.path.normpath(p) for one in indexes for p in (one.file, *one.files)}
        sequences: dict[Path, list[Path]] = {}  # pattern → frames that differ in their last number
        for file in files:
            if os.path.normpath(file) not in placed:
                parts = NUMBERED.fullmatch(file.stem)
                pattern = file
                if parts and file.suffix.lower() in frame_endings():
                    pattern = file.with_name(f"{parts[1]}[0-9]*{parts[3]}{file.suffix}")
                sequences.setdefault(pattern, []).append(file)
        findings = [*map(read, bags), *indexes]
        for pattern, frames in sequences.items():
            many = len(frames) > 1
            findings.append(read(pattern, numbered_sequence) if many else read(frames[0]))
    compare_tables(findings)
    return sorted(findings, key=lambda finding: str(finding.file))


def _files(folder: Path) -> tuple[list[Path], list[Path]]:
    """Files but hidden ones and those of bags; bags that are folders."""
    files, bags = [], []

    def closed(error: OSError) -> None:
        raise error

    for place, folders, names in os.walk(folder, onerror=closed):
        below = [Path(place, name) for name in folders if not name.startswith(".")]
        bags += filter(is_bag, below)
        folders[:] = [path.name for path in below if not is_bag(path)]
        files += [Path(place, name) for name in names if not name.startswith(".")]
    return sorted(files), sorted(bags)
