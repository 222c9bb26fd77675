"""What a file format is to the rest: how a file of it begins, and what reads it.

A format is a module somewhere below this folder with a ``FORMAT``. Nothing lists them: they are
found by their place, so a new module is recognised by ``python -m pipeline inspect``, proposed by
``new-dataset`` and read by the stages.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache, cached_property
from pathlib import Path
from pkgutil import resolve_name, walk_packages
from types import ModuleType

from pipeline.core.errors import RecordingError

BYTES = 16_384  # of a file's head


class Kind(StrEnum):
    """What a file holds; ``read`` of every format of a kind takes and returns the same."""

    MOTION = "motion"  # read(file, unit) → pipeline.formats.motion.take.MotionTake
    JOINTS = "joints"  # read(file, options) → pipeline.formats.joints.log.JointLog
    FORCE = "force"  # read(file, options) → pipeline.formats.force.record.ForceRecord
    CALIBRATION = "calibration"  # read(file) → pipeline.formats.force.calibration.Calibration
    IMAGE = "image"  # read(content, file=) → pipeline.formats.depth.image.DepthImage
    CLOUD = "cloud"  # read(content, file=) → pipeline.formats.depth.cloud.PointCloud
    SEQUENCE = "sequence"  # read(file) → pipeline.formats.depth.index.DepthIndex
    INTRINSICS = "intrinsics"  # read(file, width=, height=) → …depth.intrinsics.Intrinsics
    TRAJECTORY = "trajectory"  # read(file) → table t, x:*, v:*
    BAG = "bag"  # read(file) → pipeline.formats.rosbag.Summary
    TABLE = "table"  # read(file, key=) → pipeline.formats.number_sheet.Sheet


@dataclass(frozen=True)
class Head:
    """The beginning of a file."""

    file: Path
    content: bytes

    @classmethod
    def read(cls, file: Path) -> Head:
        """The first bytes of ``file``, none of a folder; OSError where it cannot be opened."""
        if Path(file).is_dir():
            return cls(Path(file), b"")
        with Path(file).open("rb") as stream:
            return cls(Path(file), stream.read(BYTES))

    @property
    def suffix(self) -> str:
        """The ending of its name in lower case, with the dot."""
        return self.file.suffix.lower()

    @cached_property
    def text(self) -> str | None:
        """The beginning as text, None where it is not text."""
        if b"\0" in self.content:
            return None
        try:
            text = self.content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = self.content.decode("latin-1")
        return text.replace("\r\n", "\n").replace("\r", "\n")

    @cached_property
    def lines(self) -> list[str]:
        """Its lines with content."""
        return [line for line in (self.text or "").split("\n") if line.strip(' \t,;"')]

    @property
    def first_cell(self) -> str:
        """What stands before the first comma, semicolon or tab; empty where there is no text."""
        return re.split(r"[,;\t]", self.lines[0])[0].strip().strip('"') if self.lines else ""


@dataclass(frozen=True)
class Stated:
    """What a file says of itself in its header, whether or not the rest of it can be read."""

    version: str | None = None
    units: dict[str, str] = field(default_factory=dict)  # quantity → unit as the file states it
    facts: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Format:
    """One format of files: a module-level ``FORMAT`` declares it."""

    name: str  # as a person calls it
    kind: Kind
    read: Callable
    # whether a file begins like one; None: it looks like any other, so that an option names it
    recognises: Callable[[Head], bool] | None = None
    states: Callable[[Path], Stated] = lambda file: Stated()
    option: str | None = None  # the name by which an option of the dataset chooses it
    endings: tuple[str, ...] = ()  # of the names of its files, where frames are told by them
    fallback: bool = False  # recognises what more specific formats begin like too: asked last


@cache
def formats_in(package: ModuleType, *kinds: Kind) -> tuple[Format, ...]:
    """The formats of the ``kinds`` (of all, where none is named) among the modules of ``package``
    and of the packages in it, in the order of the modules' names, those of last resort last.
    """
    modules = walk_packages(package.__path__, f"{package.__name__}.")
    declared = [getattr(resolve_name(module.name), "FORMAT", None) for module in modules]
    chosen = [one for one in declared if one is not None and (not kinds or one.kind in kinds)]
    return tuple(sorted(chosen, key=lambda one: one.fallback))


def recognised(head: Head, formats: Sequence[Format]) -> Format | None:
    """The first of the ``formats`` that the file begins like."""
    return next((one for one in formats if one.recognises and one.recognises(head)), None)


def format_of(file: Path, formats: Sequence[Format]) -> Format | None:
    """The first of the ``formats`` that ``file`` begins like; RecordingError where it cannot be
    opened.
    """
    try:
        return recognised(Head.read(file), formats)
    except OSError as error:
        raise RecordingError(f"the file cannot be read ({error.strerror})", file=file) from None


def begins(*marks: bytes) -> Callable[[Head], bool]:
    """A recogniser: the file begins with one of the ``marks``."""
    return lambda head: head.content.startswith(marks)


def is_xml(*names: str) -> Callable[[Head], bool]:
    """A recogniser: the file is XML in which an element has one of the ``names``."""
    elements = re.compile(rf"<({'|'.join(names)})[\s>]")
    return lambda head: (
        bool(head.lines)
        and head.lines[0].lstrip().startswith("<")
        and elements.search(head.text) is not None
    )
