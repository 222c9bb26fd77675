"""A dataset's datasheet: facts on its recordings, merged with the option file of the dataset; and
both files while they are being filled in, with values that are still ???.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.core.errors import ConfigError, PipelineError
from pipeline.core.options.dataset import About, Dataset
from pipeline.core.typed_yaml import parsed, read_yaml
from pipeline.core.validation import MISSING, all_faults, options, validated

DATASHEETS = Path(__file__).parents[2] / "data" / "raw"
OPEN = "???"  # a value that a person has yet to fill in
REMARK = " # → "  # begins a remark on such a value


class Datasheet(NamedTuple):
    """Keys that the datasheet in ``file`` adds to the section ``dataset``, without ``about``."""

    file: Path
    values: dict[str, Any]

    def holds(self, key: str) -> bool:
        """Return True if the nested ``key`` of the dataset stands in it."""
        node: Any = self.values
        for part in key.split("."):
            if not isinstance(node, dict) or part not in node:
                return False
            node = node[part]
        return True


def path_of(dataset: str) -> Path:
    """Return the file of a dataset's datasheet."""
    return DATASHEETS / dataset / "dataset.yaml"


def read(file: Path) -> Datasheet:
    """Read a datasheet; ConfigError where it is unreadable or ``about`` is incomplete."""
    values = read_yaml(file)
    about = values.pop("about", None)
    if about is None:
        message = "a datasheet needs about: subject, source and licence of its recordings"
        raise ConfigError(message, key="about", file=file)
    if any(unfilled_keys(about)):
        _refuse(unfilled_keys(read_yaml(file)), file)
    validated(About, about, "about", file)
    return Datasheet(file, values)


def require_apart(option: dict[str, Any], sheet: Datasheet, option_file: Path) -> None:
    """Raise ConfigError for a key that stands in the ``option`` file and in the datasheet."""
    if keys := list(_common(option, sheet.values, "dataset.")):
        verb, of_each = ("stands", "them") if len(keys) == 1 else ("stand", "each")
        message = f"{', '.join(keys)} {verb} in {option_file.name} too: keep one of {of_each}"
        raise ConfigError(message, key=keys[0], file=sheet.file)


def require_filled(composed: dict[str, Any], sheet: Datasheet, option_file: Path) -> None:
    """Raise ConfigError with the file and all keys of the ``composed`` dataset still to fill in."""
    keys = list(unfilled_keys(composed.get("dataset")))
    _refuse([key for key in keys if sheet.holds(key.partition("[")[0])], sheet.file)
    _refuse(keys, option_file)


def _common(option: dict[str, Any], sheet: dict[str, Any], prefix: str) -> Iterator[str]:
    """The keys that stand in both, down to where one of them holds a value."""
    for key in sheet:
        stated, other = sheet[key], option.get(key)
        if isinstance(stated, dict) and isinstance(other, dict):
            yield from _common(other, stated, f"{prefix}{key}.")
        elif key in option:
            yield f"{prefix}{key}"


def unfilled_keys(values: Any, key: str = "") -> Iterator[str]:
    """Yield the keys of ``values`` that hold ???, in their order."""
    if isinstance(values, str) and values == OPEN:
        yield key
    elif isinstance(values, dict):
        for name, value in values.items():
            yield from unfilled_keys(value, f"{key}.{name}" if key else str(name))
    elif isinstance(values, list):
        for place, value in enumerate(values):
            yield from unfilled_keys(value, f"{key}[{place}]")


def _refuse(keys: Iterable[str], file: Path) -> None:
    if names := list(keys):
        message = f"fill in {', '.join(names)}: there is ??? for a value"
        raise ConfigError(message, key=names[0], file=file)


class Question(NamedTuple):
    """A value that is still ???, the comment beside it, and its line of ``file``, from 0."""

    key: str
    hint: str
    file: Path
    line: int


@dataclass
class Draft:
    """Datasheet and option file as text, which ``answer`` fills in; comments stay."""

    texts: dict[Path, str]

    def values(self) -> dict[str, Any]:
        """Return the values of both files; ConfigError for a text that is no YAML."""
        merged: dict[str, Any] = {}
        for file, text in self.texts.items():
            _merge(merged, parsed(text, file=file) or {})
        return merged

    def questions(self) -> list[Question]:
        """Return the values that are still ???, in the order of the files."""
        result = []
        for file, text in self.texts.items():
            places = []
            for number, line in enumerate(text.splitlines()):
                code, _, hint = line.partition(REMARK)[0].partition(" # ")
                if not code.lstrip().startswith("#"):
                    places += [(hint, file, number)] * code.count(OPEN)
            keys = list(unfilled_keys(parsed(text, file=file)))
            if len(keys) != len(places):
                raise ConfigError(f"{OPEN} stands where no value does; fill in by hand", file=file)
            result += [Question(key, *place) for key, place in zip(keys, places, strict=True)]
        return result

    def answer(self, key: str, value: str, wrong: Callable[[dict], list[PipelineError]]) -> None:
        """Put ``value``, as YAML has it, in the place of a ???; ConfigError, and no change, where
        the key is not open or ``wrong`` finds a new fault in the values.
        """
        questions = {question.key: question for question in self.questions()}
        if key not in questions:
            there_are = ", ".join(questions) or "none"
            message = f"no such value is still to be filled in; there are {there_are}"
            raise ConfigError(message, key=key)
        edit = _written(value, key)
        changed = self._with(questions[key], lambda line: line.replace(OPEN, edit, 1))
        before = {str(fault) for fault in wrong(self.values())}
        if new := [fault for fault in wrong(changed.values()) if str(fault) not in before]:
            raise new[0]
        self.texts = changed.texts

    def note(self, key: str, remark: str) -> None:
        """Put a ``remark`` behind the comment of a ???, which an answer takes away again."""
        question = next(question for question in self.questions() if question.key == key)
        self.texts = self._with(question, lambda line: f"{line}{REMARK}{remark}").texts

    def _with(self, question: Question, edit: Callable[[str], str]) -> Draft:
        """The draft after an ``edit`` of the question's line without its remark."""
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
    """``value`` as it may stand behind a key: quoted where YAML reads anything but one value."""
    value = " ".join(value.split())
    if value in ("", OPEN):
        raise ConfigError("a value is required here", key=key)
    plain = " #" not in value and value[0] != "#"
    try:
        parsed(f"key: {value}")
    except ConfigError:
        plain = False
    return value if plain else json.dumps(value, ensure_ascii=False)


@options()
class Described(Dataset):
    """A dataset with the text of its datasheet."""

    about: About | None = None


def faults(values: dict[str, Any]) -> list[ConfigError]:
    """Return the unknown keys and wrong values among the filled in ``values`` of a dataset."""
    found = all_faults(Described, _without_open(values), "dataset")[1]
    return [fault for fault in found if not fault.message.startswith(MISSING)]


def filled(values: dict[str, Any]) -> Dataset | None:
    """Return the dataset of ``values`` without faults; None where a value is missing."""
    return all_faults(Described, _without_open(values))[0]


def absent(values: dict[str, Any]) -> list[str]:
    """Return the keys that a dataset must have and that the ``values`` do not mention, sorted."""
    found = all_faults(Described, values)[1]
    return sorted(str(f.evidence["key"]) for f in found if f.message.startswith(MISSING))


def _without_open(values: Any) -> Any:
    if not isinstance(values, dict):
        return values
    kept = {n: v for n, v in values.items() if isinstance(v, dict) or not [*unfilled_keys(v)]}
    return {name: _without_open(value) for name, value in kept.items()}
