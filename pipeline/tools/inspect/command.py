"""``python -m pipeline inspect FILE|FOLDER [--json]``: what recordings are, and what would stop
their analysis.
"""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path

from pipeline.core.bounds import Reading, within
from pipeline.core.errors import ConfigError
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.report import as_json, as_table


def run(words: list[str]) -> None:
    """Print what is found, as a table or as JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline inspect", description=__doc__.partition(": ")[2]
    )
    parser.add_argument("place", type=Path, metavar="FILE|FOLDER", help="what an instrument wrote")
    parser.add_argument("--json", action="store_true", help="every fact, for programs")
    parser.add_argument(
        "--reading",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="bounds of what a file may be, as in the section dataset.reading: file_mib=500",
    )
    arguments = parser.parse_args(words)
    findings = within(_reading(arguments.reading), inspect, arguments.place)
    print(as_json(findings) if arguments.json else as_table(findings, arguments.place))


def _reading(words: list[str]) -> Reading:
    values = dict(word.partition("=")[::2] for word in words)
    known = [field.name for field in fields(Reading)]
    for name, value in values.items():
        if name not in known or not (value.isascii() and value.isdigit()):
            message = f"--reading {name}={value}: a whole number of one of {', '.join(known)}"
            raise ConfigError(message)
    return Reading(**{name: int(value) for name, value in values.items()})
