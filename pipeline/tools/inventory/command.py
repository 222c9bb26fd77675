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

    Where the recordings are not on this machine, an inventory that is there stays; of an empty
    folder, as that of a dataset that is not analysed, the first one is empty.
    """
    parser = argparse.ArgumentParser(
        prog="python -m pipeline inventory", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("file", type=Path)
    arguments = parser.parse_args(words)
    folder, file = arguments.folder, arguments.file
    if not any(folder.glob("*")) and (folder.is_dir() or file.is_file()):
        print(f"inventory: no recordings in {folder}; an inventory that is there stays")
        if not file.is_file():
            contracts.write_text("", file)
        return
    contracts.write_text(listing(folder).to_csv(index=False, lineterminator="\n"), file)
