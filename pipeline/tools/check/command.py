"""``python -m pipeline check [DATASET]``: everything that is wrong with a dataset's two files, its
robot and its recordings.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.core import config, datasheet
from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml
from pipeline.tools.check.report import problems


def run(words: list[str]) -> None:
    """Print a line a problem; ConfigError where there are any."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline check", description=__doc__.partition(": ")[2]
    )
    parser.add_argument(
        "name", nargs="?", metavar="DATASET", help="its name; by default that of params.yaml"
    )
    params = Path("params.yaml")
    name = parser.parse_args(words).name or read_yaml(params).get("dataset")
    if name not in config.option_names("dataset"):
        there_are = ", ".join(config.option_names("dataset"))
        raise ConfigError(f"no dataset {name!r}; there are {there_are}")
    option_file = config.CONF / "dataset" / f"{name}.yaml"
    wrong = problems(option_file, params)
    for number, problem in enumerate(wrong, start=1):
        print(f"{number}. {problem}")
    if wrong:
        raise ConfigError(
            f"{len(wrong)} to be mended, in {datasheet.path_of(name)} or {option_file} where no "
            "other file is named"
        )
    print(f"check: nothing is wrong with {name}")
