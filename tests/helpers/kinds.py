"""Kinds of unusual files: a small file of one's own for each, and the public case beside it."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

CASES = Path(__file__).parents[3] / "shared/cases"  # public cases beside the project


class FileKind(NamedTuple):
    """Files of one kind, and the words that ``inspect`` prints of them."""

    number: str  # of the public case in ../shared/cases
    make: Callable[[Path], None]  # writes files of this kind below a folder
    says: tuple[str, ...]  # words about these and about the public files
    place: str = ""  # file in the folder that is inspected, made and public (default the folder)
    never: tuple[str, ...] = ()  # words that must not be printed
    stops: bool = False  # whether a line starts with !
    public: bool = True  # False for a relative, a file of the same kind without a public case
