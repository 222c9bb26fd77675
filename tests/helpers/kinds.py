"""Kinds of unusual files: a function that writes a small one, and the public case beside it."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

from pipeline.core.typed_yaml import read_yaml

Make = Callable[[Path], object]  # writes files below a folder
LOG = ("head", "change", "file")  # arguments of a log, which need no `options`


class FileKind(NamedTuple):
    """Files of one kind, and the words that ``inspect`` prints of them."""

    number: str  # of the public case in ../shared/cases, or another name
    make: Make | None  # None: only the public case
    says: list[str]
    place: str  # file or folder that is inspected, in the folder of the files
    public: bool  # whether the words are also those of the public case
    never: list[str]  # words that must not be printed
    stops: bool  # whether a line starts with !


def read_kinds(
    name: str,
    writers: Mapping[str, Callable[..., object]],
) -> list[FileKind]:
    """The kinds of a YAML file beside this module, whose files the ``writers`` write."""
    kinds = []
    for entry in read_yaml(Path(__file__).with_name(name))["kinds"]:
        arguments = {key: entry[key] for key in LOG if key in entry}
        arguments |= entry.get("options", {})
        writer = entry.get("writes", "log")
        kind = FileKind(
            entry["case"],
            make=writer and partial(writers[writer], **arguments),
            says=entry["says"],
            place=entry.get("at") or entry.get("inside", ""),
            public="at" in entry,
            never=entry.get("never", []),
            stops=entry.get("stops", False),
        )
        kinds.append(kind)
    return kinds
