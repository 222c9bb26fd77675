"""``python -m pipeline new-dataset NAME --from FOLDER``: the two files of a dataset, filled in as
far as its recordings tell.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Sequence
from pathlib import Path

from pipeline.core import config, datasheet
from pipeline.core.datasheet import Draft
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.tools.inspect.command import inspect
from pipeline.tools.inspect.finding import ROBOT, shown
from pipeline.tools.new_dataset.filling import Filling
from pipeline.tools.new_dataset.layout import RecordingLayout, layout
from pipeline.tools.new_dataset.template import asked, fill_template, text_of
from pipeline.tools.new_dataset.values import known_values

ARGUMENTS = {
    "name": {"metavar": "NAME", "help": "name of the dataset, as in params.yaml"},
    "--from": {
        "dest": "folder",
        "type": Path,
        "metavar": "FOLDER",
        "help": "folder of the recordings (default: fill in what is ??? in the dataset's files)",
    },
    "--set": {
        "action": "append",
        "default": [],
        "metavar": "KEY=VALUE",
        "help": "value that no file states, as robot.urdf=arm.urdf; as often as needed",
    },
    "--suggested": {"action": "store_true", "help": "take every suggestion"},
    "--motion": {"type": int, "metavar": "NUMBER", "help": "motion in the joint logs"},
    "--ask": {"action": "store_true", "help": "ask for what is then still open"},
}
UNPLACED = 12  # recordings that are named although they have no place
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


def run(
    name: str,
    folder: Path | None,
    set: Sequence[str],
    suggested: bool = False,
    motion: int | None = None,
    ask: bool = False,
) -> None:
    """Write the two files, or fill in what is open in those that are there; say what is left."""
    answers = {}
    for assigned in set:
        key, equal, value = assigned.partition("=")
        if not equal:
            raise ConfigError(f"--set takes KEY=VALUE, not {assigned!r}")
        answers[key.strip()] = value
    filling = open_dataset(name, folder, answers)
    filling.fill(answers, suggested=suggested, motion=motion, ask=ask)
    filling.write()
    left = filling.left
    if "joint_log.start" in left:
        try:
            filling.show_motions()
            print("new-dataset: the motion is chosen by --motion NUMBER")
        except PipelineError as error:
            print(f"new-dataset: {error}")
    if left:
        print(
            f"new-dataset: {len(left)} values are open: {', '.join(left)}; fill them in there, or "
            f"by `new-dataset {name}` with --set, --suggested, --motion or --ask"
        )
    print(f"new-dataset: set `dataset: {name}` in params.yaml, and run `python -m pipeline check`")


def open_dataset(
    name: str, folder: Path | None, answered: Collection[str] = (), urdf: Path | None = None
) -> Filling:
    """Return the two files of the dataset ``name``, data/raw/NAME/dataset.yaml and
    pipeline/conf/dataset/NAME.yaml, from the recordings in ``folder``, or as they are where it is
    None; not written yet.

    Keys that are ``answered`` stay open; ``urdf`` takes the place of a URDF in the folder. Raises
    ConfigError or RecordingError for a name or folder that does not fit, and for files in the way.
    """
    if not Path("params.yaml").is_file():
        raise ConfigError("there is no params.yaml here; run the pipeline from the project's root")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
        message = f"{name!r} cannot name a dataset: letters, digits, _ and - alone"
        raise ConfigError(message, key="NAME")
    files = datasheet.path_of(name), config.CONF / "dataset" / f"{name}.yaml"
    if folder is None:
        for file in files:
            if not file.is_file():
                raise ConfigError("there is no such dataset; make it with --from FOLDER", file=file)
        draft = Draft({file: file.read_text() for file in files})
        folder = Path(draft.values().get("recordings", ""))
        return Filling(draft, layout(inspect(folder), folder), folder)
    inventory = files[0].with_name("dvc.yaml")
    _require_new(folder, [*files, inventory])
    recorded = layout(inspect(folder), folder)
    if urdf is not None:
        recorded.single[ROBOT] = inspect(urdf)
    texts = dataset_texts(name, recorded, folder, answered)
    filling = Filling(Draft(dict(zip(files, texts, strict=True))), recorded, folder)
    if files[0].parent.resolve() not in folder.resolve().parents:
        filling.beside[inventory] = INVENTORY.format(name=name)
    return filling


def _require_new(folder: Path, files: Sequence[Path]) -> None:
    if not folder.is_dir():
        raise RecordingError("there is no such folder", file=folder)
    if re.search(r'["$`\\\n]', os.path.relpath(folder.resolve())):
        message = "the folder's name holds a quote, a dollar or a backslash; rename it"
        raise RecordingError(message, file=folder)
    for file in filter(Path.exists, files):
        message = "this file is there already, and nothing is overwritten; choose another name, or"
        raise ConfigError(f"{message} leave out --from to fill in what is open there", file=file)


def dataset_texts(
    name: str, recorded: RecordingLayout, folder: Path, answered: Collection[str] = ()
) -> list[str]:
    """Return the texts of data/raw/NAME/dataset.yaml and pipeline/conf/dataset/NAME.yaml for the
    recordings ``recorded`` in ``folder``, with ??? for the keys that are ``answered``.
    """
    known = known_values(name, recorded, folder)
    texts = fill_template(name, known | dict.fromkeys(known.keys() & {*answered}, asked()))
    if unplaced := [text_of(shown(one.file.relative_to(folder))) for one in recorded.unplaced]:
        more = f" … ({len(unplaced)})" if len(unplaced) > UNPLACED else ""
        texts[0] += f"# not placed: {', '.join(unplaced[:UNPLACED])}{more}\n"
    return texts
