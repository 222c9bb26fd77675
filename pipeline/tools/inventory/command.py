"""``python -m pipeline inventory FOLDER FILE``: path, bytes and SHA-256 of recordings that are read
in place, so that a change of them reruns the stages.
"""

from pathlib import Path

from pipeline.core import contracts
from pipeline.recordings.inventory import listing

ARGUMENTS = {
    "folder": {"type": Path, "metavar": "FOLDER", "help": "recordings that are read in place"},
    "file": {"type": Path, "metavar": "FILE", "help": "CSV file that is written"},
}


def run(folder: Path, file: Path) -> None:
    """Write the files of ``folder`` to ``file``, which stays if the recordings are not here."""
    if any(folder.glob("*")) or not (folder.is_dir() or file.is_file()):
        contracts.write_text(listing(folder).to_csv(index=False, lineterminator="\n"), file)
        return
    print(f"inventory: no recordings in {folder}; an inventory that is there stays")
    if not file.is_file():
        contracts.write_text("", file)
