"""What more than was tried would need, by what was measured, and what ends first here."""

from __future__ import annotations

import os
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path

DAY = 86_400.0  # s


@dataclass(frozen=True)
class Needs:
    """Of one item or, beside it, of any number: bytes of memory and disk, processor time in s."""

    memory: float
    disk: float
    time: float


def machine(folder: Path) -> Needs:
    """What there is here: memory, what is free of the disk that ``folder`` is on, a day of every
    core.
    """
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return Needs(memory, shutil.disk_usage(folder).free, DAY * len(os.sched_getaffinity(0)))


def beyond(items: float, fixed: Needs, each: Needs, there: Needs) -> dict[str, object]:
    """What ``items`` need, and which resource is there for the fewest of them: which, and how many
    these are.
    """
    base, slope, limit = (asdict(needs) for needs in (fixed, each, there))
    ends = {name: (limit[name] - base[name]) / slope[name] for name in slope if slope[name] > 0}
    first = min(ends, key=lambda name: ends[name])
    needs = {name: base[name] + items * slope[name] for name in slope}
    return {"items": items, "needs": needs, "ends_first": first, "enough_for": ends[first]}
