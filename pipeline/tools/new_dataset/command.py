"""``python -m pipeline new-dataset NAME --from FOLDER``: the two files of a dataset, filled in as
far as its recordings tell.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Mapping
from pathlib import Path

from pipeline.core import config, datasheet
from pipeline.core.draft import Draft
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.tools.inspect.examine import inspect
from pipeline.tools.inspect.finding import ROBOT
from pipeline.tools.inspect.layout import Layout, layout
from pipeline.tools.new_dataset.filling import Filling
from pipeline.tools.new_dataset.known_values import recorded_values
from pipeline.tools.new_dataset.option_values import option_values
from pipeline.tools.new_dataset.suggestions import Suggestions
from pipeline.tools.new_dataset.template import fill_template
from pipeline.tools.new_dataset.yaml_text import text_of

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
        draft = Draft({file: _text(file) for file in files})
        folder = Path(draft.values().get("recordings", ""))
        recorded = layout(inspect(folder), folder)
    else:
        recordings = _below_project(folder)
        _require_new([*files, files[0].parent / "dvc.yaml"])
        recorded = layout(inspect(folder), folder)
        if urdf is not None:
            recorded.single[ROBOT] = inspect(urdf)
        texts = dataset_texts(name, recordings, recorded, folder)
        draft = Draft(dict(zip(files, texts, strict=True)))
        if files[0].parent.resolve() not in folder.resolve().parents:
            inventory = {files[0].parent / "dvc.yaml": INVENTORY.format(name=name)}
    filling = Filling(draft, Suggestions(recorded, folder))
    filling.by_answers(answers)
    if suggested:
        filling.by_suggestions()
    if motion is not None:
        filling.by_motion(motion)
    if ask:
        filling.by_asking()
    filling.note_suggestions()
    for file, text in (draft.texts | inventory).items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        print(f"new-dataset: wrote {os.path.relpath(file)}")
    left = [question.key for question in draft.questions()]
    if "joint_log.start" in left:
        try:
            filling.by_motion(None)
            print("new-dataset: the motion is chosen by --motion NUMBER")
        except PipelineError as error:
            print(f"new-dataset: {error}")
    return left


def dataset_texts(name: str, recordings: str, layout: Layout, folder: Path) -> list[str]:
    """Return the texts of data/raw/NAME/dataset.yaml and pipeline/conf/dataset/NAME.yaml for the
    recordings of ``layout`` in ``folder``, which is ``recordings`` from the project's root.
    """
    known, blocks = recorded_values(layout, folder)
    known |= {"recordings": text_of(recordings)}
    known |= option_values(name, recordings, layout, folder)
    return fill_template(name, known, blocks)


def _arguments(words: list[str]) -> argparse.Namespace:
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
        metavar="FOLDER",
        help="the folder of its recordings; without it, what is ??? in the dataset's files is "
        "filled in",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a value that no file states, as robot.urdf=arm.urdf; as often as needed",
    )
    parser.add_argument("--suggested", action="store_true", help="take whatever is suggested")
    parser.add_argument(
        "--motion", type=int, metavar="NUMBER", help="of joint logs the motion of that number"
    )
    parser.add_argument("--ask", action="store_true", help="ask for what is then still open")
    return parser.parse_args(words)


def _text(file: Path) -> str:
    if not file.is_file():
        raise ConfigError("there is no such dataset; make it with --from FOLDER", file=file)
    return file.read_text()


def _below_project(folder: Path) -> str:
    """``folder`` as the datasheet names it."""
    if not folder.is_dir():
        raise RecordingError("there is no such folder", file=folder)
    recordings = Path(os.path.relpath(folder.resolve())).as_posix()
    if re.search(r'["$`\\\n]', recordings):
        raise RecordingError(
            "the folder's name holds a quote, a dollar or a backslash; rename it", file=folder
        )
    return recordings


def _require_new(files: list[Path]) -> None:
    for file in files:
        if file.exists():
            raise ConfigError(
                "this file is there already, and nothing is overwritten; choose another name, or "
                "leave out --from to fill in what is open there",
                file=file,
            )
