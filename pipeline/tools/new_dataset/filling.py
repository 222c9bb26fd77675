"""Answers to what is open in the two files of a dataset: given, suggested, asked for on the
terminal, or those of one motion in the joint logs.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.core import contracts
from pipeline.core.datasheet import Draft, Question, unfilled_keys
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import Robot
from pipeline.core.options.instruments import JointLogSection
from pipeline.recordings.commands import circular_joints
from pipeline.recordings.inventory import named_takes
from pipeline.recordings.motions import NEARLY, FoundMotion, motions
from pipeline.recordings.movement import read_logged_movement
from pipeline.recordings.repetitions import REACH
from pipeline.tools.check.command import get_filled, value_faults
from pipeline.tools.new_dataset.layout import RecordingLayout
from pipeline.tools.new_dataset.values import KEYS, suggested_values


@dataclass
class Filling:
    """A ``draft`` beside the ``recorded`` files in ``folder``."""

    draft: Draft
    recorded: RecordingLayout
    folder: Path

    beside: dict[Path, str] = field(default_factory=dict)  # other texts to write

    @property
    def left(self) -> list[str]:
        """Keys that are still ???."""
        return [question.key for question in self.draft.questions()]

    def fill(
        self,
        answers: Mapping[str, str],
        *,
        suggested: bool = False,
        motion: int | None = None,
        ask: bool = False,
    ) -> None:
        """Fill in the ``answers``, YAML values by key as robot.tool; then every suggestion where
        ``suggested``; the motion of that number in the printed table, from 1; and what is asked for
        on the terminal. ConfigError for an answer that does not fit.
        """
        for key, value in answers.items():
            self.answer(key, value)
        if suggested:
            self.take_suggested()
        if motion is not None:
            self.choose(self.show_motions(), motion)
        if ask:
            self.ask()

    def write(self) -> None:
        """Write the files, with remarks in the comments of the values that are open."""
        _, remarks = self.suggested()
        for key in [key for key in self.left if key in remarks]:
            self.draft.note(key, remarks[key])
        for file, text in (self.draft.texts | self.beside).items():
            contracts.write_text(text, file)
            print(f"new-dataset: wrote {os.path.relpath(file)}")

    def answer(self, key: str, value: str) -> None:
        """Put ``value``, as YAML has it; ConfigError as :meth:`Draft.answer`."""
        self.draft.answer(key, value, value_faults)

    def suggested(self) -> tuple[dict[str, str], dict[str, str]]:
        """Suggestions and remarks beside the present values."""
        return suggested_values(self.recorded, self.folder, self.draft.values())

    def take_suggested(self) -> None:
        """Take every suggestion that nothing is wrong with; they may follow from each other."""
        taken = True
        while taken:
            taken = False
            suggested, _ = self.suggested()
            for key in [key for key in self.left if key in suggested]:
                try:
                    self.answer(key, suggested[key])
                except PipelineError:
                    continue
                taken = True
                print(f"taken as suggested: {key}: {get_filled(self.draft.values(), key)}")

    def show_motions(self) -> list[FoundMotion]:
        """Print the motions in the logs, numbered from 1, and return them."""
        offered = found_motions(self.draft.values())
        if not offered:
            raise ConfigError("no motion is found that the logs hold from rest to rest, or repeat")
        rows = []
        for number, motion in enumerate(offered, start=1):
            counts = Counter(name for name, _ in motion.places)
            row = {"no.": number, "from (rad)": _rounded(motion.start, 2)}
            row |= {"to (rad)": _rounded(motion.end, 2), "steps": motion.steps}
            row["pause"] = "never rests" if motion.pause is None else motion.pause
            row["times"] = len(motion.places)
            disturbed = [f"{name} row {place}" for name, place in motion.disturbed]
            row["disturbed"] = ", ".join(disturbed) or "none"
            row["least singular value"] = f"{motion.least_singular:.2g}"
            row["commands differ by (rad)"] = f"{motion.deviation:.2g}"
            row["movements"] = ", ".join(f"{name} ({count})" for name, count in counts.items())
            rows.append(row)
        print(pd.DataFrame(rows).to_string(index=False))
        return offered

    def choose(self, offered: list[FoundMotion], number: int) -> None:
        """Fill in the motion of that ``number``."""
        if not 1 <= number <= len(offered):
            raise ConfigError(f"there is no motion {number}; there are 1 to {len(offered)}")
        motion, rate = offered[number - 1], self.draft.values()["motion"]["rate"]
        rest = motion.rest(rate)
        ends = (_rounded(motion.start, 4), _rounded(motion.end, 4))
        chosen = dict(zip(KEYS, (motion.steps + 2 * rest, *ends, rest), strict=True))
        for key in [key for key in self.left if key in chosen]:
            self.answer(key, str(chosen[key]))

    def ask(self) -> None:
        """Ask for one value after another, the robot's first as others follow from them; an empty
        answer takes the suggestion, or leaves ???.
        """
        passed: set[str] = set()
        try:
            while questions := [one for one in self.draft.questions() if one.key not in passed]:
                first = min(questions, key=lambda one: (one.key[:6] != "robot.", one.key in KEYS))
                motion = "joint_log.start" in self.left and not passed & {*KEYS}
                if motion and first.key in KEYS:
                    self._ask_for_motion()
                passed.add(first.key)
                if first.key in self.left:
                    self._ask(first)
        except (EOFError, KeyboardInterrupt):
            print("")

    def _ask(self, question: Question) -> None:
        suggested, remark = (held.get(question.key) for held in self.suggested())
        print("; ".join(filter(None, [f"\n{question.key}: {question.hint}", remark])))
        while answer := input(f"[{suggested}] " if suggested else "? ").strip() or suggested:
            try:
                return self.answer(question.key, answer)
            except PipelineError as error:
                print(f"! {error}")
                suggested = None if answer == suggested else suggested
        return print("left as ???")

    def _ask_for_motion(self) -> None:
        try:
            offered = self.show_motions()
            print("\nthe motion that is analysed: motion.steps, joint_log.start, .end and .rest")
        except PipelineError as error:
            return print(f"! {error}")
        while answer := input("number, or nothing to give them one by one? ").strip():
            try:
                return self.choose(offered, int(answer))
            except (ValueError, PipelineError) as error:
                print(f"! {error}")


def found_motions(values: dict[str, Any]) -> list[FoundMotion]:
    """Return the motions in the logs that the ``values`` of a dataset name, those that move most
    joints first, those through a singular pose or without a repetition last; ConfigError where a
    needed value is still ???, and as the logs' reader.
    """
    log = values["joint_log"] | {"start": [], "end": [], "rest": 0, "tolerance": 1.0}
    rate = values["motion"]["rate"]
    needed = {"joint_log": log, "robot": values["robot"], "motion": {"rate": rate}}
    if keys := ", ".join(unfilled_keys(needed)):
        raise ConfigError(f"the motions are found once these are filled in: {keys}")
    options, folder = JointLogSection(**log), Path(values["recordings"])
    places = named_takes(folder, options.movements, key="dataset.joint_log.movements")
    circular = circular_joints(values["robot"]["urdf"], options.joints)
    movements = {
        name: read_logged_movement(name, place, options, float(rate), circular)
        for name, place in places.items()
    }
    offered = motions(movements, Robot(**values["robot"]), rate)
    regular = NEARLY * max((motion.least_singular for motion in offered), default=0.0)

    def last(motion: FoundMotion) -> tuple[bool, int]:
        still = np.abs(motion.end - motion.start) <= REACH
        alone = len(motion.places) - len(motion.disturbed) < 2
        return alone or motion.least_singular < regular, int(still.sum())

    return sorted(offered, key=last)


def _rounded(angles: np.ndarray, digits: int) -> list[float]:
    return (np.round(angles, digits) + 0.0).tolist()
