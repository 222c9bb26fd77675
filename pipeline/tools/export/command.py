"""``python -m pipeline export MODEL [--to FILE]``: a fitted model as one file for planners and
filters outside the pipeline, and beside it one Python file that reads it with NumPy alone.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from pipeline.core import config, contracts
from pipeline.models.joint_steps_fit import PLAIN
from pipeline.tools.export.reader_file import NAME, reader_source
from pipeline.tools.export.record import exported

HERE, FOLDER = Path(__file__).parent, Path("data/export")


def run(words: list[str]) -> None:
    """Write the model, fitted here where the last run has no fit of it, and its reader."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline export", description=__doc__.partition(": ")[2]
    )
    parser.add_argument(
        "model",
        metavar="MODEL",
        help=f"{', '.join(PLAIN)}: fitted to all motions; or an option of pipeline/conf/model, "
        "MODEL_closed for its closed-loop form",
    )
    parser.add_argument(
        "--to", type=Path, metavar="FILE", help=f"output file (default {FOLDER}/DATASET_MODEL.json)"
    )
    arguments = parser.parse_args(words)
    settings = config.sections("export", HERE / "reads.yaml")
    file = arguments.to or FOLDER / f"{settings.dataset.name}_{arguments.model}.json"
    write_export(exported(arguments.model, settings), file)


def write_export(record: dict, file: Path) -> None:
    """Write ``record`` to ``file`` and the reader beside it, and say how it is loaded."""
    contracts.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", file)
    contracts.write_text(reader_source(), file.parent / NAME)
    print(f"export: wrote {file} and {file.parent / NAME}")
    print(f"export: in that folder: from {Path(NAME).stem} import load; load('{file.name}')")
    for each in record["not_known"]:
        joint = f" of {each['joint']}" if "joint" in each else ""
        print(f"export: no number for {each['parameter']}{joint}: {each['found']}")
