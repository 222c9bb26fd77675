"""A fault of a recording: what it does to the files of a valid one, how its severity is measured,
and what has to become of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

# path below the folder of the recordings, as os.fsdecode spells it → content
Files = Mapping[str, bytes]
# content of a valid file, severity, draws → content of a faulty one
Change = Callable[[bytes, float, np.random.Generator], bytes]
Infliction = Callable[[Files, float, np.random.Generator], Files]

REPAIRED, REFUSED, UNHARMED, UNNOTICED = "repaired", "refused", "unharmed", "unnoticed"
OUTCOMES = (REPAIRED, REFUSED, UNHARMED, UNNOTICED)


@dataclass(frozen=True)
class Fault:
    """One kind of fault.

    ``inflict`` is pure: equal files, severity and stream give equal faulty files. ``severity`` says
    what its number counts, with the unit; ``levels`` are three of them, from mild to grave (one
    where there is nothing to grade). ``expected`` are the outcomes that are right; ``counted`` the
    quantities of the table ``quality`` one of which a repair has to change; ``rule`` says why.
    """

    name: str
    instrument: str
    inflict: Infliction
    severity: str
    levels: tuple[float, ...]
    expected: tuple[str, ...]
    rule: str
    counted: tuple[str, ...] = ()


def in_file(pattern: str, change: Change) -> Infliction:
    """``change`` inflicted on one of the files whose paths match ``pattern``, drawn where there are
    several.
    """

    def inflict(files: Files, severity: float, rng: np.random.Generator) -> Files:
        name = chosen(files, pattern, 1, rng)[0]
        return {**files, name: change(files[name], severity, rng)}

    return inflict


def in_files(pattern: str, change: Change) -> Infliction:
    """One file inflicted with ``change`` alike for each unit of severity: that many files, severity
    1 each.
    """

    def inflict(files: Files, severity: float, rng: np.random.Generator) -> Files:
        return {
            **files,
            **{name: change(files[name], 1, rng) for name in chosen(files, pattern, severity, rng)},
        }

    return inflict


def in_all(pattern: str, change: Infliction) -> Infliction:
    """``change`` of all files together; those that it changes match ``pattern``."""
    return change


def chosen(files: Files, pattern: str, number: float, rng: np.random.Generator) -> list[str]:
    """``number`` of the files whose paths match ``pattern`` (all, where there are fewer), in
    order.
    """
    names = sorted(name for name in files if fnmatchcase(name, pattern))
    return [
        names[i]
        for i in sorted(rng.choice(len(names), min(int(number), len(names)), replace=False))
    ]
