"""``python -m pipeline inventory FOLDER FILE``: path, bytes and SHA-256 of recordings that are read
in place, so that a change of them reruns the stages.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.core import contracts
from pipeline.recordings.inventory import listing


def run(words: list[str]) -> None:
    """Write the files below FOLDER to FILE, as CSV; where the recordings are not on this machine,
    FILE stays as it is, or is empty.
    """
    parser = argparse.ArgumentParser(
        prog="python -m pipeline inventory", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("file", type=Path)
    folder, file = vars(parser.parse_args(words)).values()
    if any(folder.glob("*")) or not (folder.is_dir() or file.is_file()):
        contracts.write_text(listing(folder).to_csv(index=False, lineterminator="\n"), file)
        return
    print(f"inventory: no recordings in {folder}; an inventory that is there stays")
    if not file.is_file():
        contracts.write_text("", file)
