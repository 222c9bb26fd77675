"""``python -m pipeline inspect FILE|FOLDER [--json]``: what recordings are, and what would stop
their analysis.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.report import as_json, as_table


def run(words: list[str]) -> None:
    """Print what is found, as a table or as JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline inspect", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("place", type=Path, metavar="FILE|FOLDER", help="what an instrument wrote")
    parser.add_argument("--json", action="store_true", help="every fact, for programs")
    arguments = parser.parse_args(words)
    findings = inspect(arguments.place)
    print(as_json(findings) if arguments.json else as_table(findings, arguments.place))
