"""Kinds of unusual files: a small file of one's own for each, and the public case beside it."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import yaml

CASES = Path(__file__).parents[3] / "shared/cases"  # public cases beside the project
Make = Callable[[Path], object]  # writes files below a folder


class FileKind(NamedTuple):
    """Files of one kind, and the words that ``inspect`` prints of them."""

    number: str  # of the public case in ../shared/cases, or another name
    make: Make | None  # None: only the public case
    says: tuple[str, ...]
    place: str  # file or folder that is inspected, in the folder of the files
    public: bool  # whether the words are also those of the public case
    never: tuple[str, ...]  # words that must not be printed
    stops: bool  # whether a line starts with !


def kind(
    number: str,
    make: Make | None,
    *says: str,
    at: str | None = None,
    inside: str = "",
    never: tuple[str, ...] = (),
    stops: bool = False,
) -> FileKind:
    """A kind whose public case is inspected ``at`` a place, or None for a relative of a case, which
    is inspected as a folder, or ``inside`` of it.
    """
    return FileKind(number, make, says, at or inside, at is not None, never, stops)


def read_kinds(
    name: str,
    writers: Mapping[str, Callable[..., object]],
) -> list[FileKind]:
    """The kinds of a YAML file beside this module, whose files the ``writers`` write."""
    text = Path(__file__).with_name(name).read_text(encoding="utf-8")
    kinds = []
    for entry in yaml.safe_load(text)["kinds"]:
        case, says = entry.pop("case"), entry.pop("says")
        place = {key: entry.pop(key) for key in ("at", "inside") if key in entry}
        never, stops = tuple(entry.pop("never", ())), entry.pop("stops", False)
        writer = writers[entry.pop("writes", "log")]
        make = partial(writer, **entry.pop("options", {}), **entry)
        kinds.append(kind(case, make, *says, **place, never=never, stops=stops))
    return kinds
