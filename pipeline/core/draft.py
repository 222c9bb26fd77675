"""The files of a dataset while they are being filled in: which values are still ???, what an answer
puts there, and everything that the types have against the values.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core.datasheet import OPEN, unfilled_keys
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import About, Dataset
from pipeline.core.typed_yaml import parsed
from pipeline.core.validation import all_faults, missing_keys, options

REMARK = " # → "  # begins what is remarked on a value to come


@options()
class Described(Dataset):
    """A dataset with the text of its datasheet."""

    about: About | None = None


@dataclass(frozen=True)
class Question:
    """A value that is still ???: its key, the comment beside it, and its line of ``file``, from
    0.
    """

    key: str
    hint: str
    file: Path
    line: int


@dataclass
class Draft:
    """Datasheet and option file as text, which ``answer`` fills in; comments stay."""

    texts: dict[Path, str]

    def values(self) -> dict[str, Any]:
        """What the files hold, put together; ConfigError for what is no YAML."""
        merged: dict[str, Any] = {}
        for file, text in self.texts.items():
            _merge(merged, parsed(text, file=file) or {})
        return merged

    def questions(self) -> list[Question]:
        """The values that are still ???, in the order of the files."""
        return [question for file in self.texts for question in self._questions(file)]

    def _questions(self, file: Path) -> list[Question]:
        lines = []
        for number, line in enumerate(self.texts[file].splitlines()):
            code, _, hint = line.partition(REMARK)[0].partition(" # ")
            if not code.lstrip().startswith("#"):
                lines += [(number, hint)] * code.count(OPEN)
        keys = list(unfilled_keys(parsed(self.texts[file], file=file)))
        if len(keys) != len(lines):
            raise ConfigError(f"{OPEN} stands where no value does; fill in by hand", file=file)
        return [
            Question(key, hint, file, number)
            for key, (number, hint) in zip(keys, lines, strict=True)
        ]

    def answer(self, key: str, value: str, wrong: Callable[[dict], list[PipelineError]]) -> None:
        """Put ``value``, as YAML has it, in the place of a ???.

        ConfigError where the key is none that is still open; the first that is ``wrong`` with the
        values now and was not before. The draft is then as it was.
        """
        question = next((question for question in self.questions() if question.key == key), None)
        if question is None:
            there_are = ", ".join(question.key for question in self.questions()) or "none"
            message = f"no such value is still to be filled in; there are {there_are}"
            raise ConfigError(message, key=key)
        changed = self._with(question, lambda line: line.replace(OPEN, _written(value, key), 1))
        before = {str(fault) for fault in wrong(self.values())}
        if new := [fault for fault in wrong(changed.values()) if str(fault) not in before]:
            raise new[0]
        self.texts = changed.texts

    def note(self, key: str, remark: str) -> None:
        """Put a ``remark`` behind the comment of a value that is still ???; an answer takes it away
        again.
        """
        question = next(question for question in self.questions() if question.key == key)
        self.texts = self._with(question, lambda line: f"{line}{REMARK}{remark}").texts

    def _with(self, question: Question, edit: Callable[[str], str]) -> Draft:
        """The draft after an ``edit`` of the question's line, whose remark is taken away before."""
        lines = self.texts[question.file].splitlines()
        lines[question.line] = edit(lines[question.line].partition(REMARK)[0])
        return Draft(self.texts | {question.file: "\n".join(lines) + "\n"})


def _merge(values: dict[str, Any], others: dict[str, Any]) -> None:
    for key, value in others.items():
        if isinstance(value, dict) and isinstance(values.get(key), dict):
            _merge(values[key], value)
        else:
            values[key] = value


def _written(value: str, key: str) -> str:
    """``value`` as it may stand behind a key: a text that YAML reads as anything but one value is
    quoted.
    """
    value = " ".join(value.split())
    if value in ("", OPEN):
        raise ConfigError("a value has to stand here", key=key)
    try:
        parsed(f"key: {value}")
    except ConfigError:
        return json.dumps(value, ensure_ascii=False)
    return json.dumps(value, ensure_ascii=False) if " #" in value or value[0] == "#" else value


def faults(values: dict[str, Any]) -> list[ConfigError]:
    """All faults of the ``values`` of a dataset that are filled in: unknown keys, and values of
    another type or out of range.
    """
    return all_faults(Described, _without_open(values), "dataset", missing=False)[1]


def filled(values: dict[str, Any]) -> Dataset | None:
    """The dataset of ``values`` without :func:`faults`; None where a value is missing."""
    return all_faults(Described, _without_open(values))[0]


def absent(values: dict[str, Any]) -> list[str]:
    """The keys that a dataset must have and that the ``values`` do not mention."""
    return missing_keys(Described, values)


def _without_open(values: Any) -> Any:
    """``values`` without those that are still ???, whatever list or mapping holds them."""
    if isinstance(values, dict):
        return {
            name: _without_open(value)
            for name, value in values.items()
            if not [*unfilled_keys(value)] or isinstance(value, dict)
        }
    return values
