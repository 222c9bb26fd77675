"""files: lists of the raw files of motion, depth and force, for the stages that read them."""

from pathlib import Path

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.recordings.inventory import by_part, listing, raw_folder

OUT = Path("data/files")


def run() -> None:
    """Write a table of path, bytes and hash for each part."""
    dataset = config.sections("files").dataset
    parts = by_part(listing(raw_folder(dataset.recordings)), dataset)
    with contracts.replacing(OUT) as folder:
        for part, files in parts.items():
            files.to_csv(folder / f"{part}.csv", index=False, lineterminator="\n")
