"""configure: validated configuration of params.yaml and pipeline/conf, in data/config.yaml; hash of
the code of each model, in data/code, as DVC's deps cannot name the folder of an option's kind.
"""

import shutil
from pathlib import Path

from pipeline.configuration import config
from pipeline.core import contracts, environment
from pipeline.core.sources import sources_hash
from pipeline.models import kinds

CODE = Path("data/code")
# folders with a subfolder for each model; later stages depend on all subfolders
BY_MODEL = (Path("data/fit"), Path("data/filter"))


def run() -> None:
    """Write configuration and hashes, and remove results of models that it does not name."""
    if not environment.has_equal_bytes():
        print(f"configure: {environment.NOT_EQUAL}")
    config.write_config(Path("params.yaml"))
    chosen = config.composed_config().models
    with contracts.replacing(CODE) as folder:
        for name, options in chosen.items():
            code = sources_hash(kinds.sources(options.kind))
            contracts.write_text(f"{options.kind} {code}\n", folder / f"{name}.txt")
    for folder in (folder for place in BY_MODEL for folder in place.glob("*/")):
        if folder.name not in chosen:
            shutil.rmtree(folder)
