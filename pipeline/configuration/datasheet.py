"""Datasheet of a dataset: facts about its recordings, merged with the dataset's option file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import About, Dataset
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import (
    MISSING,
    all_faults,
    joined_faults,
    options,
    validated,
)

DATASHEETS = Path(__file__).parents[2] / "data" / "raw"
OPEN = "???"  # placeholder of a value that the user has to fill in


class Datasheet(NamedTuple):
    """Values that the datasheet ``file`` adds to the section ``dataset``, except ``about``."""

    file: Path
    values: dict[str, Any]


@options()
class DescribedDataset(Dataset):
    """A dataset with the text of its datasheet."""

    about: About | None = None


def path_of(dataset: str) -> Path:
    """Return the path of the datasheet of ``dataset``."""
    return DATASHEETS / dataset / "dataset.yaml"


def read(file: Path) -> Datasheet:
    """Read a datasheet; raises ConfigError if it is unreadable or ``about`` is incomplete."""
    values = read_yaml(file)
    about = values.pop("about", None)
    if about is None:
        message = (
            "a datasheet needs about: subject, source and licence of its recordings"
        )
        raise ConfigError(message, key="about", file=file)
    if is_open(about):
        raise joined_faults(
            to_fill_in([*unfilled_keys({"about": about} | values)]),
            file,
        )
    validated(About, about, "about", file)
    return Datasheet(file, values)


def to_fill_in(keys: list[str]) -> list[ConfigError]:
    """Return the fault of ``keys`` of the dataset whose value is ???."""
    return [
        ConfigError(
            f"fill in {', '.join(keys)}: the value is ???",
            key=f"dataset.{keys[0]}",
        ),
    ]


def facts_beside(option: dict[str, Any], sheet: dict[str, Any]) -> dict[str, Any]:
    """Return the sections of a datasheet that the ``option`` file does not leave out by null."""
    left_out = {key for key, value in option.items() if value is None}
    return {key: value for key, value in sheet.items() if key not in left_out}


def common_keys(
    option: dict[str, Any],
    sheet: dict[str, Any],
    prefix: str,
) -> Iterator[str]:
    """Yield the nested keys that are in both files."""
    for key in sheet:
        fact = sheet[key]
        choice = option.get(key)
        if isinstance(fact, dict) and isinstance(choice, dict):
            yield from common_keys(choice, fact, f"{prefix}{key}.")
        elif key in option:
            yield f"{prefix}{key}"


def unfilled_keys(values: Any, key: str = "") -> Iterator[str]:
    """Yield the nested keys of ``values`` whose value is ???, in order."""
    if isinstance(values, str) and values == OPEN:
        yield key
    elif isinstance(values, dict):
        for name, value in values.items():
            yield from unfilled_keys(value, f"{key}.{name}" if key else str(name))
    elif isinstance(values, list):
        for place, value in enumerate(values):
            yield from unfilled_keys(value, f"{key}[{place}]")


def is_open(value: Any) -> bool:
    """Return True if ``value`` is or contains ???."""
    return any(True for _ in unfilled_keys(value))


def get_nested(values: Any, key: str) -> Any:
    """Return the value of a nested ``key``, None without it."""
    for name in filter(None, key.split(".")):
        if not isinstance(values, dict) or name not in values:
            return None
        values = values[name]
    return values


def get_filled(values: Any, key: str) -> Any:
    """Return the value of a nested ``key``, None where it is missing or still ???."""
    value = get_nested(values, key)
    return None if is_open(value) else value


def check_values(
    values: dict[str, Any],
) -> tuple[Dataset | None, list[ConfigError], list[str]]:
    """Return the dataset of ``values`` (None if faulty), the errors of unknown keys and wrong
    values, and the sorted required keys that are absent.
    """
    dataset, faults = all_faults(DescribedDataset, _without_open(values), "dataset")
    unfilled = {key.partition("[")[0] for key in unfilled_keys(values)}
    absent = set()
    wrong = []
    for fault in faults:
        if fault.message.startswith(MISSING):
            absent.add(str(fault.evidence["key"]).removeprefix("dataset."))
        else:
            wrong.append(fault)
    return dataset, wrong, sorted(absent - unfilled)


def _without_open(values: Any) -> Any:
    """Return nested ``values`` without the keys whose value is or contains ???."""
    if not isinstance(values, dict):
        return values
    filled = {}
    for name, value in values.items():
        if isinstance(value, dict) or not is_open(value):
            filled[name] = _without_open(value)
    return filled
