"""configure: validated configuration of params.yaml and pipeline/conf, in data/config.yaml."""

import shutil
from pathlib import Path

from pipeline.core import config, environment

# folders with a subfolder for each model; later stages depend on all subfolders
BY_MODEL = (Path("data/fit"), Path("data/filter"))


def run() -> None:
    """Write the configuration, and remove results of models that it does not name."""
    if not environment.has_equal_bytes():
        print(f"configure: {environment.NOT_EQUAL}")
    config.write_config(Path("params.yaml"))
    chosen = config.composed_config().models
    for folder in (folder for place in BY_MODEL for folder in place.glob("*/")):
        if folder.name not in chosen:
            shutil.rmtree(folder)
