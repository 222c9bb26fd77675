"""files: lists of the raw files of motion, depth and force, for the stages that read them.

The list of the motion names the code of the readers of joint logs: ingest and predict depend on the
formats of the files that are there, and not on all formats of joint logs.
"""

from contextlib import suppress
from pathlib import Path

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.errors import RecordingError
from pipeline.core.sources import imported_sources, sources_hash
from pipeline.formats import joints
from pipeline.formats.format import Kind, format_of, formats_in, is_bag
from pipeline.recordings.inventory import by_part, listing, raw_folder

OUT = Path("data/files")


def run() -> None:
    """Write a table of path, bytes and hash for each part, and the readers of the motion."""
    dataset = config.sections("files").dataset
    raw = raw_folder(dataset.recordings)
    parts = by_part(listing(raw), dataset)
    motion = parts["motion"]
    readers = [reader_code(raw / name) for name in motion["file"]]
    parts["motion"] = motion.assign(reader=readers)
    with contracts.replacing(OUT) as folder:
        for part, files in parts.items():
            files.to_csv(folder / f"{part}.csv", index=False, lineterminator="\n")


def reader_code(file: Path) -> str:
    """Return the module of the format that reads the joint log ``file`` and the hash of its code;
    "" for a table, which the stages read by their own code, and for other files.
    """
    log = file.parent if is_bag(file.parent) else file
    with suppress(RecordingError):  # ingest has the reason
        chosen = format_of(log, formats_in(joints, Kind.JOINTS))
        if chosen is not None:
            module = chosen.read.__module__
            return f"{module} {sources_hash(imported_sources([module]))}"
    return ""
