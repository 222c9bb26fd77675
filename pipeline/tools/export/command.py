"""``python -m pipeline export MODEL [--to FILE]``: a fitted model as one file for planners and
filters outside the pipeline.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from pipeline.core import config, contracts
from pipeline.tools.export.record import exported

HERE, FOLDER = Path(__file__).parent, Path("data/export")


def run(words: list[str]) -> None:
    """Write the model as the last run fitted it, and say how it is taken up."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline export", description=__doc__.partition(": ")[2]
    )
    parser.add_argument(
        "model", metavar="MODEL", help="of params.yaml; MODEL_closed for its closed-loop form"
    )
    parser.add_argument("--to", type=Path, metavar="FILE", help=f"else {FOLDER}/DATASET_MODEL.json")
    arguments = parser.parse_args(words)
    settings = config.sections("export", HERE / "reads.yaml")
    file = arguments.to or FOLDER / f"{settings.dataset.name}_{arguments.model}.json"
    text = json.dumps(exported(arguments.model, settings), indent=1, ensure_ascii=False)
    contracts.write_text(text + "\n", file)
    print(f"export: wrote {file}; pipeline.models.load('{file}') takes it up")
