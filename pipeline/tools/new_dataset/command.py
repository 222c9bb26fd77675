"""``python -m pipeline new-dataset NAME --from FOLDER``: the two files of a dataset, filled in as
far as its recordings tell.
"""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path

from pipeline.core import config, datasheet
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.layout import layout
from pipeline.tools.new_dataset.datasheet_file import datasheet_file
from pipeline.tools.new_dataset.option_file import option_file

INVENTORY = """\
# These recordings are read in place: their inventory stands here for them, so that a change of the
# files reruns what depends on it. It is looked at in every run, as the recordings may not be here.
vars: ["dataset.yaml:recordings"]
stages:
  inventory:
    wdir: ../../..
    cmd: python -m pipeline inventory "${{recordings}}" data/raw/{name}/inventory.csv
    always_changed: true
    outs: [data/raw/{name}/inventory.csv: {{cache: false, persist: true}}]
"""


def run(words: list[str]) -> None:
    """Write datasheet and option file, and the inventory's stage where the recordings are read in
    place; say what is left to do.
    """
    parser = argparse.ArgumentParser(
        prog="python -m pipeline new-dataset", description=__doc__.partition(": ")[2]
    )
    parser.add_argument(
        "name", metavar="NAME", help="the dataset's name, as params.yaml will have it"
    )
    parser.add_argument(
        "--from",
        dest="folder",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="the folder of its recordings",
    )
    arguments = parser.parse_args(words)
    name, folder = arguments.name, arguments.folder
    if not Path("params.yaml").is_file():
        raise ConfigError("there is no params.yaml here; run the pipeline from the project's root")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
        raise ConfigError(
            f"{name!r} cannot name a dataset: letters, digits, _ and - alone", key="NAME"
        )
    if not folder.is_dir():
        raise RecordingError("there is no such folder", file=folder)
    recordings = Path(os.path.relpath(folder.resolve())).as_posix()
    if re.search(r'["$`\\\n]', recordings):
        raise RecordingError(
            "the folder's name holds a quote, a dollar or a backslash; rename it", file=folder
        )
    sheet, option = datasheet.path_of(name), config.CONF / "dataset" / f"{name}.yaml"
    recorded = layout(inspect(folder), folder)
    texts = {
        sheet: datasheet_file(name, recordings, recorded, folder),
        option: option_file(name, recordings, recorded, folder),
    }
    if sheet.parent.resolve() not in folder.resolve().parents:
        texts[sheet.parent / "dvc.yaml"] = INVENTORY.format(name=name)
    for file in texts:
        if file.exists():
            raise ConfigError(
                "this file is there already, and nothing is overwritten; choose another name",
                file=file,
            )
    for file, text in texts.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        print(f"new-dataset: wrote {os.path.relpath(file)}")
    values = sum(len(datasheet.unfilled(file)) for file in (sheet, option))
    print(
        f"new-dataset: fill in the {values} values that are ??? there, set `dataset: {name}` in "
        "params.yaml, and run `dvc repro`"
    )
