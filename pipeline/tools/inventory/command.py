"""``python -m pipeline inventory FOLDER FILE``: write path, size in bytes and SHA-256 of recordings
outside data/raw, so that the stages run again after a change of a recording.
"""

from pathlib import Path

from pipeline.core import contracts
from pipeline.recordings.inventory import listing, raw_folder


def run(folder: Path, file: Path) -> None:
    """Write the inventory of ``folder`` to ``file``; without recordings, keep ``file``."""
    folder = raw_folder(str(folder))
    if any(folder.glob("*")) or not (folder.is_dir() or file.is_file()):
        contracts.write_text(
            listing(folder).to_csv(index=False, lineterminator="\n"),
            file,
        )
        return
    print(f"inventory: no recordings in {folder}; an existing inventory is kept")
    if not file.is_file():
        contracts.write_text("", file)
