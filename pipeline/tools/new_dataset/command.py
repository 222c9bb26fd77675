"""``python -m pipeline new-dataset NAME --from FOLDER``: datasheet and option file of a dataset,
with ??? for every value that the recordings do not state.
"""

import os
import re
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Template

from pipeline.configuration import config, datasheet
from pipeline.configuration.datasheet import OPEN, get_filled, unfilled_keys
from pipeline.core import contracts
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.core.options.dataset import Dataset
from pipeline.core.typed_yaml import parse_yaml
from pipeline.core.validation import validated
from pipeline.recordings.joint_logs import read_movements
from pipeline.recordings.lags import REACH
from pipeline.recordings.motions import NEARLY, FoundMotion, find_motions
from pipeline.tools.check.command import value_faults
from pipeline.tools.inspect.command import inspect
from pipeline.tools.inspect.finding import printable_path
from pipeline.tools.new_dataset import template
from pipeline.tools.new_dataset.layout import RecordingLayout, layout
from pipeline.tools.new_dataset.values import KEYS, entries

MOTION = Template(Path(__file__).with_name("motion.txt").read_text(encoding="utf-8"))
BETWEEN = "\n---\n"  # line between the texts of datasheet and option file
# keys of files and columns
LOG_FILES = (
    "actual",
    "target",
    "speed",
    "signals",
    "time",
)
UNPLACED = 12  # greatest number of unplaced recordings that the datasheet lists


def run(
    name: str,
    set: Sequence[str],
    folder: Path | None = None,
    suggested: bool = False,
    motion: int | None = None,
    ask: bool = False,
) -> None:
    """Write the two files, or fill in their open values; arguments as :meth:`Draft.fill`."""
    assigned = assigned_values(set)
    draft = open_draft(name, folder, assigned)
    draft.fill(assigned, suggested, motion, ask)
    draft.write()
    open_keys = draft.open_values()
    if "joint_log.start" in open_keys and not draft.shown:
        try:
            draft.show_motions()
            print("new-dataset: --motion NUMBER selects one of these motions")
        except PipelineError as error:
            print(f"new-dataset: {error}")
    if open_keys:
        print(f"new-dataset: {len(open_keys)} values are open: {', '.join(open_keys)}")
        print(
            f"next: `python -m pipeline new-dataset {name} --ask` asks for each of them; "
            "--set, --suggested and --motion, or an editor, fill them in too",
        )
    else:
        print(
            f"next: `python -m pipeline check {name}` reads all files as the stages do",
        )


def assigned_values(words: Sequence[str]) -> dict[str, str]:
    """Return key → value of --set; ConfigError for a word without =."""
    assigned = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            raise ConfigError(f"--set takes KEY=VALUE, not {word!r}")
        assigned[key.strip()] = value
    return assigned


def command_with(words: str, values: Mapping[str, str]) -> str:
    """Return the command ``words`` of the pipeline with the ``values`` as options, to copy."""
    options = []
    for key, value in values.items():
        if key == "robot.urdf":
            options.append(f"--urdf {shlex.quote(value)}")
        else:
            options.append(f"--set {shlex.quote(f'{key}={value}')}")
    return " ".join(["python -m pipeline", words, *options])


def open_draft(name: str, folder: Path | None, assigned: Mapping[str, str]) -> "Draft":
    """Return a draft of the dataset's two files from the recordings in ``folder``, read with the
    ``assigned`` values; without ``folder``, from the files.

    Raises ConfigError or RecordingError for an invalid name or folder, and for files that would be
    overwritten.
    """
    if not Path("params.yaml").is_file():
        raise ConfigError(
            "there is no params.yaml here; run the pipeline from the project's root",
        )
    require_dataset_name(name)
    if folder is None:
        return _existing_draft(name, assigned)
    if not folder.is_dir():
        raise RecordingError("there is no such folder", file=folder)
    sheet, option_file = dataset_files(name)
    for file in (sheet, option_file, sheet.with_name("dvc.yaml")):
        if file.exists():
            message = (
                "this file exists and is not overwritten; choose another name, or leave out "
                "--from to fill in open values"
            )
            raise ConfigError(message, file=file)
    return _new_draft(name, folder, assigned)


def _existing_draft(name: str, assigned: Mapping[str, str]) -> "Draft":
    """Return the draft of the files of the dataset ``name``."""
    texts = []
    for file in dataset_files(name):
        if not file.is_file():
            message = "there is no such dataset; make it with --from FOLDER"
            raise ConfigError(message, file=file)
        texts.append(file.read_text(encoding="utf-8").rstrip())
    text = BETWEEN.join(texts)
    values = values_of(text, name)
    folder = Path(values.get("recordings", ""))
    stated = {key: get_filled(values, f"joint_log.{key}") for key in LOG_FILES}
    stated = {key: value for key, value in stated.items() if value is not None}
    stated |= _stated(assigned, "joint_log", LOG_FILES)
    return Draft(name, text, layout(inspect(folder), folder, stated), folder)


def _new_draft(name: str, folder: Path, assigned: Mapping[str, str]) -> "Draft":
    """Return the template with the values that the recordings in ``folder`` state."""
    stated = _stated(assigned, "joint_log", LOG_FILES)
    recorded = layout(inspect(folder), folder, stated)
    robot = _stated(assigned, "robot", ("urdf", "plane", "joints"))
    stated_entries = entries(name, recorded, folder, {"robot": robot})
    sections = {key.partition(".")[0] for key in stated_entries}
    for key in assigned:
        if key.partition(".")[0] in sections:
            stated_entries[key] = template.Entry()
    text = template.fill_template(_read("template", name), stated_entries)
    if count := len(recorded.unplaced):
        listed = []
        for finding in recorded.unplaced[:UNPLACED]:
            listed.append(template.text_of(printable_path(finding.file, folder)))
        note = f"# {count} not placed: {', '.join(listed)}"
        text = text.replace(BETWEEN, f"\n{note}{BETWEEN}", 1)
        print(
            f"new-dataset: {count} files not placed, named in the datasheet; see inspect",
        )
    return Draft(name, text, recorded, folder)


def _stated(
    assigned: Mapping[str, str],
    section: str,
    keys: Sequence[str],
) -> dict[str, Any]:
    """Return key → value of those ``keys`` of a ``section`` that are ``assigned``."""
    values = {}
    for key in keys:
        if f"{section}.{key}" in assigned:
            values[key] = parse_yaml(assigned[f"{section}.{key}"])
    return values


def require_dataset_name(name: str) -> None:
    """Raise ConfigError if ``name`` cannot be the name of a dataset and of its files."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
        message = f"{name!r} cannot name a dataset: use letters, digits, _ and - only"
        raise ConfigError(message, key="NAME")


def dataset_files(name: str) -> tuple[Path, Path]:
    """Return the paths of the datasheet and the option file of a dataset."""
    return datasheet.path_of(name), config.CONF / "dataset" / f"{name}.yaml"


def _read(file: str, name: str) -> str:
    text = Path(__file__).with_name(f"{file}.yaml").read_text(encoding="utf-8")
    return text.replace("{name}", name)


def values_of(text: str, name: str) -> dict[str, Any]:
    """Return the merged keys and values of both files; ConfigError for a text that is no YAML."""
    merged: dict[str, Any] = {}
    texts = text.split(BETWEEN, 1)
    for file, file_text in zip(dataset_files(name), texts, strict=True):
        values = parse_yaml(file_text, file=file) or {}
        for key, value in values.items():
            stated = merged.get(key)
            if isinstance(value, dict) and isinstance(stated, dict):
                merged[key] = stated | value
            else:
                merged[key] = value
    return merged


@dataclass
class Draft:
    """Text of datasheet and option file, and layout of the recordings in ``folder``."""

    name: str
    text: str
    recorded: RecordingLayout
    folder: Path
    shown: bool = False  # whether the motions were printed

    def values(self) -> dict[str, Any]:
        """Return the values of both files; ConfigError for a text that is no YAML."""
        return values_of(self.text, self.name)

    def open_values(self) -> dict[str, str]:
        """Return key → comment of every ???, in the order of the files."""
        comments = {}
        for _, key, parts in template.keyed_lines(self.text):
            if parts is not None and OPEN in (parts["value"] or ""):
                comments[key] = parts["hint"] or ""
        return comments

    def proposals(self) -> dict[str, str]:
        """Return key → suggestion of every ???, else the first word of its choices or its name."""
        proposed = {}
        for key in self.open_values():
            entry = self._entries().get(key, template.Entry())
            choices = entry.note.removeprefix("one of ").split(", ")
            if entry.text:
                proposed[key] = entry.text
            elif entry.note.startswith("one of "):
                proposed[key] = choices[0]
            else:
                proposed[key] = key.rpartition(".")[2].upper()
        return proposed

    def choices(self) -> list[str]:
        """Return the notes of the ??? that have one, behind their keys."""
        notes = []
        for key in self.open_values():
            entry = self._entries().get(key, template.Entry())
            if entry.note:
                notes.append(f"{key}: {entry.note}")
        return notes

    def assign(self, values: Mapping[str, str]) -> None:
        """Set each key to its value (YAML, else text), all together. Raises ConfigError, without
        any change, for a value that is missing, and the first fault that the values cause.
        """
        text = self.text
        for key, value in values.items():
            value = " ".join(value.split())
            if value in ("", OPEN):
                raise ConfigError("a value is required here", key=key)
            text = template.set_value(text, key, template.yaml_of(value))
        before = {str(fault) for fault in value_faults(self.values())}
        for fault in value_faults(values_of(text, self.name)):
            if str(fault) not in before:
                raise fault
        self.text = text

    def fill(
        self,
        assigned: Mapping[str, str],
        suggested: bool = False,
        motion: int | None = None,
        ask: bool = False,
    ) -> None:
        """Fill in the ``assigned`` values (key such as robot.tool → YAML); if ``suggested``, all
        suggestions without a fault; the values of the motion with the printed number ``motion``; if
        ``ask``, answers from the terminal. Raises ConfigError for an invalid answer.
        """
        self.assign(assigned)
        self._accept(suggested)
        if motion is not None:
            self._choose_motion(self.show_motions(), str(motion))
        if ask:
            with suppress(EOFError, KeyboardInterrupt):
                self._ask()

    def _accept(self, suggested: bool = False) -> None:
        """Fill in the open values that the recordings and the filled-in values determine, and those
        that are ``suggested``. A value may determine another one.
        """
        accepted = True
        while accepted:
            accepted = False
            open_keys = self.open_values()
            for key, entry in self._entries().items():
                wanted = entry.text and (entry.certain or suggested)
                if key in open_keys and wanted:
                    with suppress(PipelineError):
                        self.assign({key: entry.text})
                        accepted = True
                        source = (
                            "determined" if entry.certain else "suggestion accepted"
                        )
                        print(f"{source}: {key}: {get_filled(self.values(), key)}")

    def write(self) -> None:
        """Write the files, and the inventory of recordings that are outside of the datasheet's
        folder.
        """
        sheet, option_file = dataset_files(self.name)
        sheet_text, option_text = self.text.split(BETWEEN, 1)
        texts = {sheet: sheet_text, option_file: option_text}
        inventory = sheet.with_name("dvc.yaml")
        inside = sheet.parent.resolve() in self.folder.resolve().parents
        if not inside and not inventory.exists():
            texts[inventory] = _read("inventory", self.name)
        for file, text in texts.items():
            contracts.write_text(f"{text.rstrip()}\n", file)
            print(f"new-dataset: wrote {os.path.relpath(file)}")

    def _entries(self) -> dict[str, template.Entry]:
        return entries(self.name, self.recorded, self.folder, self.values())

    def show_motions(self) -> list[FoundMotion]:
        """Print the motions in the logs, numbered from 1, and return them."""
        self.shown = True
        offered = motions_in_logs(self.values())
        if not offered:
            raise ConfigError(
                "the logs have no motion from rest to rest and no repeated motion",
            )
        for number, motion in enumerate(offered, start=1):
            counts = Counter(name for name, _ in motion.places)
            ends = {"start": _round(motion.start, 2), "end": _round(motion.end, 2)}
            print(MOTION.render(number=number, m=motion, counts=counts, **ends))
        return offered

    def _choose_motion(self, offered: Sequence[FoundMotion], number: str) -> None:
        """Fill in the values of the motion with the printed ``number``."""
        numbers = [str(n) for n in range(1, len(offered) + 1)]
        if number not in numbers:
            raise ConfigError(
                f"there is no motion {number}; choose 1 to {len(offered)}",
            )
        motion = offered[numbers.index(number)]
        rest = motion.rest(self.values()["motion"]["rate"])
        start = _round(motion.start, 4)
        end = _round(motion.end, 4)
        values = (motion.steps + 2 * rest, start, end, rest)
        for key, value in zip(KEYS, values, strict=True):
            if key in self.open_values():
                self.assign({key: str(value)})

    def _ask(self) -> None:
        """Ask for the open values one by one, the robot first, the motion by its number last. An
        empty answer accepts the suggestion, else leaves ???.
        """
        open_keys = [key for key in self.open_values() if key not in KEYS]
        open_keys.sort(key=lambda key: not key.startswith("robot."))
        print("an empty answer accepts the value in [brackets], else leaves ???")
        for key in open_keys:
            self._ask_value(key)
        if self.open_values().keys() & {*KEYS}:
            try:
                offered = self.show_motions()
            except PipelineError as error:
                print(f"! {error}")
                return
            print(f"\nmotion: number, or nothing to enter {', '.join(KEYS)}")
            suggested = "1" if len(offered) == 1 else ""
            _accept_answer(partial(self._choose_motion, offered), suggested)
        for key in KEYS:
            self._ask_value(key)

    def _ask_value(self, key: str) -> None:
        """Ask for the value of a ``key`` if it is open, and fill in what the answer determines."""
        hints = self.open_values()
        if key not in hints:
            return
        entry = self._entries().get(key, template.Entry())
        hint = template.SUGGESTED.sub("", hints[key])  # the prompt shows the suggestion
        words = [f"\n{key}: {hint}"]
        if entry.note and entry.note not in hint:
            words.append(entry.note)
        print("; ".join(words))
        _accept_answer(lambda value: self.assign({key: value}), entry.text)
        self._accept()


def _accept_answer(accept: Callable[[str], None], suggested: str) -> None:
    """Prompt until ``accept`` raises no error, or until there is no answer."""
    while True:
        prompt = f"[{suggested}] " if suggested else "? "
        answer = input(prompt).strip() or suggested
        if not answer:
            return
        try:
            return accept(answer)
        except PipelineError as error:
            print(f"! {error}")
            if answer == suggested:
                suggested = ""


def motions_in_logs(values: dict[str, Any]) -> list[FoundMotion]:
    """Return the motions in the logs of a dataset with these ``values``, most moving joints first;
    motions near a singular pose or without repetition are last.

    Raises ConfigError where a needed value is still ???, and errors of the reader.
    """
    if "joint_log" not in values:
        raise ConfigError(
            "the dataset has no joint_log, so that no motions can be found",
        )
    needed = {key: values[key] for key in ("name", "recordings", "robot")}
    ends = [0.0] * len(values["robot"]["joints"])
    any_motion = {"start": ends, "end": ends, "rest": 0, "tolerance": 1.0}
    needed["joint_log"] = values["joint_log"] | any_motion
    needed["motion"] = {"rate": values["motion"]["rate"], "steps": 1}
    if open_keys := ", ".join(unfilled_keys(needed)):
        raise ConfigError(f"to find the motions, first fill in {open_keys}")
    dataset = validated(Dataset, needed, "dataset")
    offered = find_motions(read_movements(dataset), dataset.robot, dataset.motion.rate)
    regular = NEARLY * max((motion.least_singular for motion in offered), default=0.0)

    def order(motion: FoundMotion) -> tuple[bool, int]:
        still = np.abs(motion.end - motion.start) <= REACH
        alone = len(motion.places) - len(motion.disturbed) < 2
        return alone or motion.least_singular < regular, int(still.sum())

    return sorted(offered, key=order)


def _round(angles: np.ndarray, digits: int) -> list[float]:
    return (np.round(angles, digits) + 0.0).tolist()
