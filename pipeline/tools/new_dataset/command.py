"""``python -m pipeline new-dataset NAME --from FOLDER``: the two files of a dataset, filled in as
far as its recordings tell.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Collection, Mapping
from pathlib import Path

from pipeline.core import config, contracts, datasheet
from pipeline.core.datasheet import Draft
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.finding import ROBOT, shown
from pipeline.tools.new_dataset.filling import Filling
from pipeline.tools.new_dataset.layout import RecordingLayout, layout
from pipeline.tools.new_dataset.template import asked, fill_template, text_of
from pipeline.tools.new_dataset.values import known_values

FROM = "folder of the recordings (default: fill in what is ??? in the dataset's files)"
SET = "value that no file states, as robot.urdf=arm.urdf; as often as needed"
SHOWN = 12  # recordings that are named although they have no place
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
    """Write the two files, or fill in what is open in those that are there; say what is left."""
    given = vars(_arguments(words))
    answers = {}
    for assigned in given.pop("set"):
        key, equal, value = assigned.partition("=")
        if not equal:
            raise ConfigError(f"--set takes KEY=VALUE, not {assigned!r}")
        answers[key.strip()] = value
    name = given["name"]
    if left := write_datasheet(answers=answers, **given):
        print(
            f"new-dataset: {len(left)} values are open: {', '.join(left)}; fill them in there, or "
            f"by `new-dataset {name}` with --set, --suggested, --motion or --ask"
        )
    print(f"new-dataset: set `dataset: {name}` in params.yaml, and run `python -m pipeline check`")


def write_datasheet(
    name: str,
    folder: Path | None,
    answers: Mapping[str, str],
    *,
    urdf: Path | None = None,
    suggested: bool = False,
    motion: int | None = None,
    ask: bool = False,
) -> list[str]:
    """Write data/raw/NAME/dataset.yaml and pipeline/conf/dataset/NAME.yaml for the recordings in
    ``folder``, or fill in the files that are there where it is None; return the keys left open.

    ``answers`` are YAML values by dotted key of the template, as robot.tool; ``urdf`` takes the
    place of a URDF in the folder; ``suggested`` takes every suggestion; ``motion`` is the number
    of the motion in the printed table, from 1; ``ask`` asks on the terminal. Raises ConfigError or
    RecordingError, and writes nothing then.
    """
    if not Path("params.yaml").is_file():
        raise ConfigError("there is no params.yaml here; run the pipeline from the project's root")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
        raise ConfigError(
            f"{name!r} cannot name a dataset: letters, digits, _ and - alone", key="NAME"
        )
    files = datasheet.path_of(name), config.CONF / "dataset" / f"{name}.yaml"
    inventory: dict[Path, str] = {}
    if folder is None:
        for file in files:
            if not file.is_file():
                raise ConfigError("there is no such dataset; make it with --from FOLDER", file=file)
        draft = Draft({file: file.read_text() for file in files})
        folder = Path(draft.values().get("recordings", ""))
        recorded = layout(inspect(folder), folder)
    else:
        if not folder.is_dir():
            raise RecordingError("there is no such folder", file=folder)
        if re.search(r'["$`\\\n]', os.path.relpath(folder.resolve())):
            message = "the folder's name holds a quote, a dollar or a backslash; rename it"
            raise RecordingError(message, file=folder)
        for file in filter(Path.exists, [*files, files[0].with_name("dvc.yaml")]):
            message = (
                "this file is there already, and nothing is overwritten; choose another name, or "
                "leave out --from to fill in what is open there"
            )
            raise ConfigError(message, file=file)
        recorded = layout(inspect(folder), folder)
        if urdf is not None:
            recorded.single[ROBOT] = inspect(urdf)
        texts = dataset_texts(name, recorded, folder, answers)
        draft = Draft(dict(zip(files, texts, strict=True)))
        if files[0].parent.resolve() not in folder.resolve().parents:
            inventory = {files[0].parent / "dvc.yaml": INVENTORY.format(name=name)}
    filling = Filling(draft, recorded, folder)
    for key, value in answers.items():
        filling.answer(key, value)
    if suggested:
        filling.take_suggested()
    if motion is not None:
        filling.choose(filling.show_motions(), motion)
    if ask:
        filling.ask()
    filling.note()
    for file, text in (draft.texts | inventory).items():
        contracts.write_text(text, file)
        print(f"new-dataset: wrote {os.path.relpath(file)}")
    left = filling.left
    if "joint_log.start" in left:
        try:
            filling.show_motions()
            print("new-dataset: the motion is chosen by --motion NUMBER")
        except PipelineError as error:
            print(f"new-dataset: {error}")
    return left


def dataset_texts(
    name: str, layout: RecordingLayout, folder: Path, answered: Collection[str] = ()
) -> list[str]:
    """Return the texts of data/raw/NAME/dataset.yaml and pipeline/conf/dataset/NAME.yaml for the
    recordings of ``layout`` in ``folder``, with ??? for the keys that are ``answered``.
    """
    known = known_values(name, layout, folder)
    texts = fill_template(name, known | dict.fromkeys(known.keys() & {*answered}, asked()))
    if unplaced := [text_of(shown(one.file.relative_to(folder))) for one in layout.unplaced]:
        more = f" … ({len(unplaced)})" if len(unplaced) > SHOWN else ""
        texts[0] += f"# not placed: {', '.join(unplaced[:SHOWN])}{more}\n"
    return texts


def _arguments(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m pipeline new-dataset", description=__doc__.partition(": ")[2]
    )
    for flags, options in (
        (["name"], {"metavar": "NAME", "help": "name of the dataset, as in params.yaml"}),
        (["--from"], {"dest": "folder", "type": Path, "metavar": "FOLDER", "help": FROM}),
        (["--set"], {"action": "append", "default": [], "metavar": "KEY=VALUE", "help": SET}),
        (["--suggested"], {"action": "store_true", "help": "take every suggestion"}),
        (["--motion"], {"type": int, "metavar": "NUMBER", "help": "motion in the joint logs"}),
        (["--ask"], {"action": "store_true", "help": "ask for what is then still open"}),
    ):
        parser.add_argument(*flags, **options)
    return parser.parse_args(words)
