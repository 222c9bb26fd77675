"""choose: the dataset that params.yaml names → data/dataset.txt, where there is one of that name.

A stage of its own, as DVC would meet a file that is not there before `configure` could say which
datasets are.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.core import config, datasheet
from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml

PARAMS = Path("params.yaml")
CHOSEN = Path("data/dataset.txt")


def run() -> None:
    """Write the name; ConfigError naming the datasets that there are, or how to begin one, where
    its files are not.
    """
    name = read_yaml(PARAMS).get("dataset")
    if name not in config.option_names("dataset"):
        message = (
            f"no dataset {name!r}; there are {', '.join(config.option_names('dataset'))}, "
            "and new-dataset begins another"
        )
        raise ConfigError(message, key="dataset", file=PARAMS)
    if not (file := datasheet.path_of(name)).is_file():
        raise ConfigError(
            f"the dataset {name!r} has an option file but no datasheet; new-dataset begins one",
            key="dataset",
            file=file,
        )
    CHOSEN.parent.mkdir(exist_ok=True)
    CHOSEN.write_text(f"{name}\n")
