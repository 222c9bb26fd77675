"""What more than was tried would need, by what was measured, and what ends first here."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path

DAY = 86_400.0  # s
MANY = 1e8  # takes, particles and conditions


@dataclass(frozen=True)
class Needs:
    """Of one item or, beside it, of any number; or what there is."""

    memory: float = 0.0  # bytes
    disk: float = 0.0  # bytes
    files: float = 0.0  # and folders
    time: float = 0.0  # s of a core


def resources(folder: Path) -> Needs:
    """What there is here: memory, what is free of the disk that ``folder`` is on, a day of every
    core.
    """
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    disk = os.statvfs(folder)
    day = DAY * len(os.sched_getaffinity(0))
    return Needs(memory, disk.f_bavail * disk.f_frsize, disk.f_favail, day)


@dataclass(frozen=True)
class Paper:
    """What ``items`` need, and which resource is there for the fewest: which, and how many these
    are.
    """

    items: float
    needs: Needs
    ends_first: str
    enough_for: float


def beyond(items: float, fixed: Needs, each: Needs, there: Needs) -> Paper:
    """Of ``items`` that need ``each`` beside what any number of them needs, ``fixed``."""
    base, slope, limit = (asdict(needs) for needs in (fixed, each, there))
    ends = {name: (limit[name] - base[name]) / slope[name] for name in slope if slope[name] > 0}
    first = min(ends, key=lambda name: ends[name])
    needs = Needs(**{name: base[name] + items * slope[name] for name in slope})
    return Paper(items, needs, first, ends[first])


def papers(measured: dict) -> dict[str, Paper]:
    """Needs of many takes and particles by the slopes of scale.json."""
    particles = measured["particles"]
    few, many = measured["fleet"]["few"], measured["fleet"]["many"]
    takes, there = many["takes"], Needs(**measured["there"])
    # what the allocator leaves more or less of is no growth
    grows = max(many["peak_bytes"] - few["peak_bytes"], 0.0) / (takes - few["takes"])
    time = sum(many["seconds"].values()) / takes
    take = Needs(grows, many["kept_bytes"] / takes, many["kept_files"] / takes, time)
    steps = particles["steps"] * particles["seconds_many"]
    particle = Needs(memory=particles["bytes_of_a_particle"], time=steps)
    return {
        "takes of a fleet": beyond(MANY, Needs(memory=few["peak_bytes"]), take, there),
        "particles of one filter": beyond(MANY, Needs(), particle, there),
    }
