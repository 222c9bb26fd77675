"""``python -m pipeline STAGE [ITEM]``: runs one stage of dvc.yaml, or says in one line why it cannot."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from inspect import signature
from pathlib import Path

from pipeline.errors import PipelineError


def main() -> int:
    """Run the stage named on the command line; 1 with one message on standard error when the pipeline refuses."""
    stages = sorted(file.stem for file in (Path(__file__).parent / "stages").glob("[a-z]*.py"))
    parser = argparse.ArgumentParser(
        prog="python -m pipeline", description="One stage of the experiment; `dvc repro` runs them all in order."
    )
    parser.add_argument("stage", choices=stages)
    parser.add_argument("item", nargs="?", help="the model, for stages that run once per model; the folder, for inventory")
    arguments = parser.parse_args()
    run = import_module(f"pipeline.stages.{arguments.stage}").run
    if len(signature(run).parameters) != (arguments.item is not None):
        parser.error(f"{arguments.stage} takes no item" if arguments.item else f"{arguments.stage} runs for one item: name it")
    try:
        run(arguments.item) if arguments.item else run()
    except PipelineError as error:
        print(f"error: {arguments.stage}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
