"""files: raw files that the motion, the depth and the force read, so that a changed file reruns its
own part alone.
"""

from pathlib import Path

from pipeline.core import config, contracts
from pipeline.recordings.inventory import by_part, listing

OUT = Path("data/files")


def run() -> None:
    """A table of path, bytes and hash for each part."""
    dataset = config.sections("files").dataset
    parts = by_part(listing(Path(dataset.recordings)), dataset)
    with contracts.replacing(OUT) as folder:
        for part, files in parts.items():
            files.to_csv(folder / f"{part}.csv", index=False, lineterminator="\n")
