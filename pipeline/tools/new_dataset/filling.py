"""Fills in the two files of a dataset: by options, by what is suggested, and by asking."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.core.draft import Draft, Question
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.recordings.motions import Motion
from pipeline.tools.check.values import get_filled, value_faults
from pipeline.tools.new_dataset.motion_choice import KEYS, answers, found_motions, table
from pipeline.tools.new_dataset.suggestions import Suggestions


@dataclass
class Filling:
    """A ``draft`` that is filled in beside what is suggested for it."""

    draft: Draft
    suggestions: Suggestions

    def by_answers(self, answers: Mapping[str, str]) -> None:
        """Fill in each of ``answers``, YAML values by key; ConfigError as :meth:`Draft.answer`."""
        for key, value in answers.items():
            self.draft.answer(key, value, value_faults)

    def by_suggestions(self) -> None:
        """Every suggestion that nothing is wrong with; they may follow from each other."""
        while taken := [key for key in self._open() if self._take(key)]:
            values = self.draft.values()
            print(
                "\n".join(f"taken as suggested: {key}: {get_filled(values, key)}" for key in taken)
            )

    def by_motion(self, number: int | None) -> None:
        """The values of the motion of that ``number`` in the table; the table itself where there is
        no number.
        """
        offered = self._motions()
        if number is not None:
            self._choose(offered, number)

    def by_asking(self) -> None:
        """One value after another, those of the robot first as others follow from them; an empty
        answer takes what is suggested, or leaves ???.
        """
        passed: set[str] = set()
        motion_is_open = True
        try:
            while left := [one for one in self._ordered() if one.key not in passed]:
                if left[0].key in KEYS and motion_is_open:
                    motion_is_open = False
                    self._ask_for_motion()
                else:
                    passed.add(left[0].key)
                    self._ask(left[0])
        except (EOFError, KeyboardInterrupt):
            print("")

    def note_suggestions(self) -> None:
        """Put what is suggested into the comments of what is still open."""
        values = self.draft.values()
        for key in self._open():
            if remark := self.suggestions.remark(key, values):
                self.draft.note(key, remark)

    def _open(self) -> list[str]:
        return [question.key for question in self.draft.questions()]

    def _ordered(self) -> list[Question]:
        return sorted(
            self.draft.questions(),
            key=lambda one: (not one.key.startswith("robot."), one.key in KEYS),
        )

    def _take(self, key: str) -> bool:
        suggested = self.suggestions.of(key, self.draft.values())
        if suggested is None:
            return False
        try:
            self.draft.answer(key, suggested, value_faults)
        except PipelineError:
            return False
        return True

    def _ask(self, question: Question) -> None:
        key, values = question.key, self.draft.values()
        suggested, remark = self.suggestions.of(key, values), self.suggestions.remark(key, values)
        print("; ".join(filter(None, [f"\n{key}: {question.hint}", remark])))
        while answer := input(f"[{suggested}] " if suggested else "? ").strip() or suggested:
            try:
                return self.draft.answer(key, answer, value_faults)
            except PipelineError as error:
                print(f"! {error}")
                suggested = None if answer == suggested else suggested
        print("left as ???")
        return None

    def _ask_for_motion(self) -> None:
        if "joint_log.start" not in self._open():
            return
        try:
            offered = self._motions()
        except PipelineError as error:
            print(f"! {error}")
            return
        print("\nthe motion that is analysed: motion.steps, joint_log.start, .end and .rest")
        while answer := input("number, or nothing to give them one by one? ").strip():
            try:
                return self._choose(offered, int(answer))
            except (ValueError, PipelineError) as error:
                print(f"! {error}")

    def _motions(self) -> list[Motion]:
        offered = found_motions(self.draft.values())
        if not offered:
            raise ConfigError("no motion is found that the logs hold from rest to rest, or repeat")
        print(table(offered))
        return offered

    def _choose(self, offered: list[Motion], number: int) -> None:
        if not 1 <= number <= len(offered):
            raise ConfigError(f"there is no motion {number}; there are 1 to {len(offered)}")
        rate = self.draft.values()["motion"]["rate"]
        chosen = answers(offered[number - 1], rate)
        for key in [key for key in self._open() if key in chosen]:
            self.draft.answer(key, chosen[key], value_faults)
