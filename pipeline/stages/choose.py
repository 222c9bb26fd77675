"""choose: name of the dataset in params.yaml; DVC needs it before `configure` reads a datasheet."""

from pathlib import Path

from pipeline.configuration import config, datasheet
from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml

PARAMS = Path("params.yaml")
CHOSEN = Path("data/dataset.txt")


def run() -> None:
    """Write the name; raises ConfigError with the known datasets where its files are missing."""
    config.require_dataset(name := read_yaml(PARAMS).get("dataset"))
    if not (file := datasheet.path_of(name)).is_file():
        message = (
            f"{name!r} has an option file and no datasheet; create one with new-dataset"
        )
        raise ConfigError(message, key="dataset", file=file)
    CHOSEN.parent.mkdir(exist_ok=True)
    CHOSEN.write_text(f"{name}\n")
