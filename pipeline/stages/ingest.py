"""ingest@part: tables in SI units and counts of faults from raw logs of motion, depth or force."""

from pathlib import Path

import pandas as pd

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.recordings.ingest import read_part

OUT = Path("data/ingest")


def run(part: str) -> None:
    """Read the files of ``part``; print a line where the dataset has none."""
    settings = config.sections("ingest", item=part)
    with contracts.replacing(OUT / part) as folder:
        quality = read_part(part, settings.dataset, settings.compute, folder)
        if quality:
            contracts.write(pd.DataFrame(quality), "quality", folder)
        else:
            print(f"ingest: the dataset has no {part}; results from it are left out")
