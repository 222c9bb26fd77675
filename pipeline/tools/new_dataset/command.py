"""``python -m pipeline new-dataset NAME --from FOLDER``: datasheet and option file of a dataset,
filled in as far as its recordings tell.
"""

import os
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from pipeline.core import config, contracts, datasheet
from pipeline.core.datasheet import get_filled, unfilled_keys
from pipeline.core.errors import ConfigError, PipelineError, RecordingError
from pipeline.core.options.dataset import JointLogSection, Robot
from pipeline.core.validation import validated
from pipeline.recordings.inventory import named_takes
from pipeline.recordings.motions import NEARLY, FoundMotion, find_motions
from pipeline.recordings.movement import read_logged_movement
from pipeline.recordings.repetitions import REACH
from pipeline.tools.inspect.command import inspect
from pipeline.tools.inspect.finding import shown
from pipeline.tools.new_dataset.draft import Draft, Entry, filled_template, text_of
from pipeline.tools.new_dataset.layout import RecordingLayout, layout
from pipeline.tools.new_dataset.values import KEYS, Entries, entries

VALUE = "value that no file states, as robot.tool=flange; may be repeated"
FROM = "folder of the recordings (default: fill in what is ??? in the dataset's files)"
SET = {"action": "append", "default": [], "metavar": "KEY=VALUE", "help": VALUE}
MOTION = {"type": int, "metavar": "NUMBER", "help": "number of the motion that is analysed"}
ASK = {"action": "store_true", "help": "questions on the terminal for values still open"}
ARGUMENTS = {
    "name": {"metavar": "NAME", "help": "name of the dataset, as in params.yaml"},
    "--from": {"dest": "folder", "type": Path, "metavar": "FOLDER", "help": FROM},
    "--set": SET,
    "--suggested": {"action": "store_true", "help": "every suggested value is taken"},
    "--motion": MOTION,
    "--ask": ASK,
}
UNPLACED = 12  # recordings that are named although they have no place
NONE = MappingProxyType({})


def run(name: str, folder: Path | None, set: Sequence[str], **options: Any) -> None:
    """Write the two files, or fill in what is open in them; ``options`` as :meth:`Filling.fill`."""
    given = answers(set)
    filling = open_dataset(name, folder, given)
    filling.fill(given, **options)
    filling.write()
    left = filling.draft.questions()
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


def answers(assigned: Sequence[str]) -> dict[str, str]:
    """Return the values of --set by key; ConfigError for a word that assigns none."""
    pairs = [word.partition("=") for word in assigned]
    if wrong := [key for key, mark, _ in pairs if not mark]:
        raise ConfigError(f"--set takes KEY=VALUE, not {wrong[0]!r}")
    return {key.strip(): value for key, _, value in pairs}


def open_dataset(name: str, folder: Path | None, given: Mapping[str, str]) -> "Filling":
    """Return the two files of the dataset ``name``, data/raw/NAME/dataset.yaml and
    pipeline/conf/dataset/NAME.yaml, from the recordings in ``folder``, or as they are where it is
    None; not written yet.

    Keys that are ``given`` stay open. Raises ConfigError or RecordingError for a name or folder
    that does not fit, and for files in the way.
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
        return Filling(name, draft, layout(inspect(folder), folder), folder)
    inventory = files[0].with_name("dvc.yaml")
    if not folder.is_dir():
        raise RecordingError("there is no such folder", file=folder)
    for file in filter(Path.exists, (*files, inventory)):
        message = "this file is there already, and nothing is overwritten; choose another name, or"
        raise ConfigError(f"{message} leave out --from to fill in what is open there", file=file)
    recorded = layout(inspect(folder), folder)
    texts = dict(zip(files, dataset_texts(name, recorded, folder, given), strict=True))
    if files[0].parent.resolve() not in folder.resolve().parents:
        texts[inventory] = _template("inventory.yaml", name)
    return Filling(name, Draft(texts), recorded, folder)


def dataset_texts(
    name: str,
    recorded: RecordingLayout,
    folder: Path,
    given: Mapping[str, str] = MappingProxyType({}),
) -> list[str]:
    """Return the texts of datasheet and option file, with ??? for the keys that are ``given``."""
    known = entries(name, recorded, folder, {"robot": {"urdf": given.get("robot.urdf")}})
    known |= dict.fromkeys(known.keys() & given.keys(), Entry())
    templates = _template("template.yaml", name).split("---\n")
    texts = [filled_template(template, known) for template in templates]
    if unplaced := [text_of(shown(one.file, folder)) for one in recorded.unplaced]:
        texts[0] += f"# {len(unplaced)} not placed: {', '.join(unplaced[:UNPLACED])}\n"
    return texts


def _template(file: str, name: str) -> str:
    text = Path(__file__).with_name(file).read_text(encoding="utf-8")
    return text.replace("{name}", name)


@dataclass
class Filling:
    """A ``draft`` of the files beside the ``recorded`` files in ``folder``."""

    name: str
    draft: Draft
    recorded: RecordingLayout
    folder: Path

    def fill(
        self,
        given: Mapping[str, str],
        *,
        suggested: bool = False,
        motion: int | None = None,
        ask: bool = False,
    ) -> None:
        """Fill in the ``given`` values, YAML by key as robot.tool; then every suggestion that
        nothing is wrong with where ``suggested``; the motion of that number among the printed ones,
        from 1; and what is asked for on the terminal. ConfigError for an answer that does not fit.
        """
        for key, value in given.items():
            self.draft.answer(key, value)
        while suggested:  # they may follow from each other
            before = self.draft.questions()
            for key, value in self._suggested().items():
                if key in before:
                    with suppress(PipelineError):
                        self.draft.answer(key, value)
                        print(f"taken as suggested: {key}: {get_filled(self.draft.values(), key)}")
            suggested = self.draft.questions() != before
        if motion is not None:
            self._choose(motion, self.show_motions())
        if ask:
            self._ask()

    def write(self) -> None:
        """Write the files."""
        for file, text in self.draft.texts.items():
            contracts.write_text(text, file)
            print(f"new-dataset: wrote {os.path.relpath(file)}")

    def _entries(self) -> Entries:
        return entries(self.name, self.recorded, self.folder, self.draft.values())

    def _suggested(self) -> dict[str, str]:
        found = {key: entry.value for key, entry in self._entries().items() if entry.value}
        return {key: value for key, value in found.items() if isinstance(value, str)}

    def show_motions(self) -> list[FoundMotion]:
        """Print the motions in the logs, numbered from 1, and return them."""
        offered = found_motions(self.draft.values())
        if not offered:
            raise ConfigError("no motion is found that the logs hold from rest to rest, or repeat")
        for number, motion in enumerate(offered, start=1):
            counts = Counter(name for name, _ in motion.places).items()
            pause = "no rest" if motion.pause is None else f"pauses of {motion.pause} or more"
            disturbed = ", ".join(f"{name} row {place}" for name, place in motion.disturbed)
            places = ", ".join(f"{name} ({count})" for name, count in counts)
            print(f"motion {number}: {motion.steps} steps, {pause}, in {places}")
            print(f"  from {_rounded(motion.start, 2)} to {_rounded(motion.end, 2)} rad")
            print(f"  commands differ by {motion.deviation:.2g} rad, least singular value", end=" ")
            print(f"{motion.least_singular:.2g}, disturbed: {disturbed or 'none'}")
        return offered

    def _choose(self, number: int, offered: list[FoundMotion]) -> None:
        if not 1 <= number <= len(offered):
            raise ConfigError(f"there is no motion {number}; there are 1 to {len(offered)}")
        motion, rate = offered[number - 1], self.draft.values()["motion"]["rate"]
        rest = motion.rest(rate)
        ends = (_rounded(motion.start, 4), _rounded(motion.end, 4))
        chosen = dict(zip(KEYS, (motion.steps + 2 * rest, *ends, rest), strict=True))
        for key in chosen.keys() & self.draft.questions().keys():
            self.draft.answer(key, str(chosen[key]))

    def _ask(self) -> None:
        """Ask for one value after another, the robot's first as others follow, the motion last."""
        passed: set[str] = set()
        with suppress(EOFError, KeyboardInterrupt):
            while keys := [key for key in self.draft.questions() if key not in passed]:
                key = min(keys, key=lambda one: (one[:6] != "robot.", one in KEYS))
                if key in KEYS and not passed & {*KEYS}:
                    try:
                        offered = self.show_motions()
                        print(f"the motion that is analysed: {', '.join(KEYS)}")
                        prompt = "number, or nothing to give them one by one? "
                        _accepted(lambda n, found=offered: self._choose(int(n), found), prompt)
                    except PipelineError as error:
                        print(f"! {error}")
                passed.add(key)
                if (question := self.draft.questions().get(key)) is None:
                    continue
                note = self._entries().get(key, Entry()).note
                print("; ".join(filter(None, [f"\n{key}: {question.hint}", note])))
                if not _accepted(partial(self.draft.answer, key), "? ", self._suggested().get(key)):
                    print("left as ???")


def _accepted(accept: Callable[[str], None], prompt: str, suggested: str | None = None) -> bool:
    """Ask until ``accept`` takes the answer, and return True; False for an empty answer."""
    while answer := input(f"[{suggested}] " if suggested else prompt).strip() or suggested:
        try:
            accept(answer)
            return True
        except (ValueError, PipelineError) as error:
            print(f"! {error}")
            suggested = None if answer == suggested else suggested
    return False


def found_motions(values: dict[str, Any]) -> list[FoundMotion]:
    """Return the motions in the logs that the ``values`` of a dataset name, those that move most
    joints first, those through a singular pose or without a repetition last; ConfigError where a
    needed value is still ???, and as the logs' reader.
    """
    if "joint_log" not in values:
        raise ConfigError("the dataset has no joint_log: there are no motions to choose from")
    log = values["joint_log"] | {"start": [], "end": [], "rest": 0, "tolerance": 1.0}
    rate = values["motion"]["rate"]
    needed = {"joint_log": log, "robot": values["robot"], "motion": {"rate": rate}}
    if keys := ", ".join(unfilled_keys(needed)):
        raise ConfigError(f"the motions are found once these are filled in: {keys}")
    options, folder = JointLogSection(**log), Path(values["recordings"])
    places = named_takes(folder, options.movements, key="dataset.joint_log.movements")
    urdf = values["robot"]["urdf"]
    movements = {
        name: read_logged_movement(name, place, options, float(rate), urdf)
        for name, place in places.items()
    }
    offered = find_motions(movements, validated(Robot, values["robot"], "robot"), rate)
    regular = NEARLY * max((motion.least_singular for motion in offered), default=0.0)

    def last(motion: FoundMotion) -> tuple[bool, int]:
        still = np.abs(motion.end - motion.start) <= REACH
        alone = len(motion.places) - len(motion.disturbed) < 2
        return alone or motion.least_singular < regular, int(still.sum())

    return sorted(offered, key=last)


def _rounded(angles: np.ndarray, digits: int) -> list[float]:
    return (np.round(angles, digits) + 0.0).tolist()
