"""The files of a dataset while they are being filled in: which values are still ???, what an answer
puts there, and everything that the types have against the values.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.core.datasheet import unfilled_keys
from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.about import About
from pipeline.core.options.dataset import Dataset
from pipeline.core.typed_yaml import parsed, said, structured

REMARK = " # → "  # begins what is remarked on a value to come


@dataclass
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
        merged = OmegaConf.create()
        for file, text in self.texts.items():
            merged = OmegaConf.merge(merged, parsed(text, file=file) or {})
        return OmegaConf.to_container(merged)

    def questions(self) -> list[Question]:
        """The values that are still ???, in the order of the files."""
        return [question for file in self.texts for question in self._questions(file)]

    def _questions(self, file: Path) -> list[Question]:
        lines = []
        for number, line in enumerate(self.texts[file].splitlines()):
            code, _, hint = line.partition(REMARK)[0].partition(" # ")
            if not code.lstrip().startswith("#"):
                lines += [(number, hint)] * code.count(MISSING)
        keys = list(unfilled_keys(parsed(self.texts[file], file=file)))
        if len(keys) != len(lines):
            raise ConfigError(f"{MISSING} stands where no value does; fill in by hand", file=file)
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
        changed = self._with(question, lambda line: line.replace(MISSING, _written(value, key), 1))
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


def _written(value: str, key: str) -> str:
    """``value`` as it may stand behind a key: a text that YAML reads as anything but one value is
    quoted.
    """
    value = " ".join(value.split())
    if value in ("", MISSING):
        raise ConfigError("a value has to stand here", key=key)
    try:
        parsed(f"key: {value}")
    except ConfigError:
        return json.dumps(value, ensure_ascii=False)
    return json.dumps(value, ensure_ascii=False) if " #" in value or value[0] == "#" else value


def faults(values: dict[str, Any]) -> list[ConfigError]:
    """Everything that the types have against the ``values`` of a dataset, as far as they are filled
    in: unknown keys, values of another type, and per section the first that is out of its range.
    """
    whole, refused = _merged(values)
    return refused + _out_of_range(whole)


def filled(values: dict[str, Any]) -> Dataset | None:
    """The dataset of ``values`` without :func:`faults`; None where one is missing."""
    node = OmegaConf.merge(structured(Described), values)
    return None if OmegaConf.missing_keys(node) else OmegaConf.to_object(node)


def absent(values: dict[str, Any]) -> list[str]:
    """The keys that a dataset must have and that the ``values`` do not mention."""
    whole, _ = _merged(values)
    return sorted(OmegaConf.missing_keys(whole) - {".".join(key) for key, _ in _leaves(values)})


def _merged(values: dict[str, Any]) -> tuple[DictConfig, list[ConfigError]]:
    """Those of the ``values`` that have a place and its type, and what is said of the others."""
    whole, refused = structured(Described), []
    for key, value in _leaves(values):
        if value == MISSING:
            continue
        nested = value
        for part in reversed(key):
            nested = {part: nested}
        try:
            whole = OmegaConf.merge(whole, nested)
        except OmegaConfBaseException as error:
            refused.append(ConfigError(said(error), key=f"dataset.{'.'.join(key)}"))
    return whole, refused


def _leaves(values: dict[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[tuple, Any]]:
    """Keys and values that are no mappings, and those that are empty."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, (*above, name))
        else:
            yield (*above, name), value


def _out_of_range(node: DictConfig) -> list[ConfigError]:
    """What the types of ``node`` and of the sections in it refuse. A section that lacks a value is
    asked about the others, where it holds no sections itself.
    """
    sections = [child for child in (node._get_node(key) for key in node) if _is_section(child)]
    faults = [fault for section in sections for fault in _out_of_range(section)]
    missing = OmegaConf.missing_keys(node)
    if faults or (missing and sections):
        return faults
    try:
        if missing:
            held = OmegaConf.to_container(node)
            OmegaConf.get_type(node)(**{k: v for k, v in held.items() if v != MISSING})
        else:
            OmegaConf.to_object(node)
    except ConfigError as error:
        return [error]
    return []


def _is_section(node: Any) -> bool:
    if not isinstance(node, DictConfig) or node._is_none() or node._is_missing():
        return False
    return is_dataclass(OmegaConf.get_type(node))
