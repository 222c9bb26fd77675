"""``python -m pipeline inventory FOLDER FILE``: the files of recordings that are read in place, so
that a change of them reruns what follows.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.core import contracts
from pipeline.recordings.inventory import listing


def run(words: list[str]) -> None:
    """Write path, bytes and SHA-256 of every file below FOLDER to FILE, as CSV.

    Where the recordings are not on this machine, an inventory that is there stays.
    """
    parser = argparse.ArgumentParser(
        prog="python -m pipeline inventory", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("file", type=Path)
    arguments = parser.parse_args(words)
    if not arguments.folder.exists() and arguments.file.is_file():
        print(f"inventory: no recordings in {arguments.folder}; {arguments.file} stays as it is")
        return
    text = listing(arguments.folder).to_csv(index=False, lineterminator="\n")
    contracts.write_text(text, arguments.file)
