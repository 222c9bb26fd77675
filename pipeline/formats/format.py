"""File formats: their declaration, discovery and recognition, and patterns of file names.

A format is a module below this folder with a ``FORMAT`` (or a tuple of several). All such modules
are found: ``inspect`` recognises a new format, ``new-dataset`` proposes it, the stages read it.
"""

import codecs
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from types import ModuleType
from typing import Any

from pipeline.core.bounds import ReaderFailure, Sandbox, read_whole, require_content
from pipeline.core.errors import ConfigError, RecordingError

BYTES = 1 << 16  # size of a file's head: labels and rows of some hundred columns
BAG_SUFFIXES = (".bag", ".mcap", ".db3")


class Kind(StrEnum):
    """Content of a file; all formats of one kind have the same signature of ``read``."""

    MOTION = "motion"  # read(file, unit) → pipeline.formats.motion.take.MotionTake
    JOINTS = "joints"  # read(file, options) → pipeline.formats.joints.log.JointLog
    FORCE = "force"  # read(file, options) → pipeline.formats.force.record.ForceRecord
    # read(file) → pipeline.formats.force.calibration.Calibration
    CALIBRATION = "calibration"
    IMAGE = "image"  # read(file, shape=) → pipeline.formats.depth.image.RawDepth
    CLOUD = "cloud"  # read(file) → pipeline.formats.depth.cloud.PointCloud
    SEQUENCE = "sequence"  # read(file) → pipeline.formats.depth.image.DepthIndex
    # read(file, width=, height=) → pipeline.formats.depth.intrinsics.Intrinsics
    INTRINSICS = "intrinsics"
    TRAJECTORY = "trajectory"  # read(file) → table t, x:*, v:*
    BAG = "bag"  # read(file) → pipeline.formats.rosbag.Summary
    TABLE = "table"  # read(file, key=) → pipeline.formats.number_sheet.Sheet


def decoded(content: bytes) -> str | None:
    """Return ``content`` (UTF-8, UTF-16, else Latin-1) with line feeds; None if it is not text."""
    encoding = "utf-8-sig"
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif b"\0" in content and not any(content[1:400:2]):
        encoding = "utf-16-le"  # without byte-order mark: every second byte is zero
    elif b"\0" in content:  # zeros behind the last line, where the power failed
        content = content.rstrip(b"\0")
        if b"\n" not in content:
            return None
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(content)
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if "\0" in text:
        return None
    return text.replace("\r\n", "\n").replace("\r", "\n")


@dataclass(frozen=True)
class Head:
    """The beginning of a file."""

    file: Path
    content: bytes

    @classmethod
    def read(cls, file: Path) -> "Head":
        """Return the first BYTES of ``file``, none of a folder; RecordingError for a pointer."""
        if Path(file).is_dir():
            return cls(Path(file), b"")
        with Path(file).open("rb") as stream:
            return cls(Path(file), require_content(stream.read(BYTES), file))

    @property
    def suffix(self) -> str:
        """Ending of the file's name in lower case, with the dot."""
        return self.file.suffix.lower()

    @cached_property
    def text(self) -> str | None:
        """The beginning as text, None if it is not text."""
        return decoded(self.content)

    @cached_property
    def lines(self) -> list[str]:
        """Lines that are not blank."""
        return [line for line in (self.text or "").split("\n") if line.strip(' \t,;"')]


@dataclass(frozen=True)
class Format:
    """One file format, declared by a module-level ``FORMAT``."""

    name: str  # name in reports
    kind: Kind
    read: Callable
    # returns whether a file has the format; None if only an option of the dataset selects it
    recognises: Callable[[Head], bool] | None = None
    option: str | None = None  # name of the format in options of the dataset


@cache
def formats_in(package: ModuleType, *kinds: Kind) -> tuple[Format, ...]:
    """Return the formats of the ``kinds`` (default all) in and below ``package``, in the order of
    their modules, but tables last, since files of other formats also look like tables.
    """
    formats: list[Format] = []
    for place in walk_packages(package.__path__, f"{package.__name__}."):
        module = import_module(place.name)
        declared = getattr(module, "FORMAT", ())
        formats += declared if isinstance(declared, tuple) else [declared]
    if kinds:
        formats = [form for form in formats if form.kind in kinds]
    return tuple(sorted(formats, key=lambda form: form.kind == Kind.TABLE))


def recognised(head: Head, formats: Sequence[Format]) -> Format | None:
    """Return the first of the ``formats`` that recognises ``head``, or None."""
    for form in formats:
        if form.recognises and form.recognises(head):
            return form
    return None


def format_of(file: Path, formats: Sequence[Format]) -> Format | None:
    """Return the first of ``formats`` that recognises ``file``; RecordingError if unreadable."""
    with readable(file):
        return recognised(Head.read(file), formats)


@contextmanager
def readable(file: Path) -> Iterator[None]:
    """Raise RecordingError with the ``file`` in place of an OSError in the context."""
    try:
        yield
    except OSError as error:
        message = (
            f"the file cannot be read ({error.strerror}); copy it again, or take it out"
        )
        raise RecordingError(message, file=file) from None


def file_content(file: Path) -> bytes:
    """Return all bytes of ``file``; RecordingError if it is unreadable or too large."""
    with readable(file):
        return read_whole(file)


def read_alone(function: Callable, *arguments: object, file: Path, advice: str) -> Any:
    """Return ``function(*arguments)`` from a separate process with bounds on time and memory;
    RecordingError with the ``advice`` where the function or its process fails on the ``file``.
    """
    with advised(advice, file=file), Sandbox() as sandbox:
        return sandbox.call(function, *arguments)


@contextmanager
def advised(advice: str, **evidence: object) -> Iterator[None]:
    """Add ``evidence`` to a RecordingError of a sandbox, and ``advice`` if a library failed."""
    try:
        yield
    except RecordingError as error:
        message = error.message
        if isinstance(error, ReaderFailure):
            message += f"; the file may be damaged: {advice}"
        raise type(error)(message, **evidence | error.evidence) from None


def compare_announced(
    items: str,
    announced: float | None,
    number: int,
    refusal: str = "",
    **where: object,
) -> dict[str, int]:
    """Return the counts ``announced_ITEMS`` (None: not stated), ``found_ITEMS`` (the ``number``
    that is there) and, unless 0, ``lacking_ITEMS`` or ``surplus_ITEMS``; RecordingError (``where``)
    in their place with the advice ``refusal`` of a format in which the numbers must agree.
    """
    if announced is None:
        return {f"found_{items}": number}
    announced = int(announced)
    if announced != number and refusal:
        message = (
            f"the file announces {announced} {items} and holds {number}: {refusal}"
        )
        raise RecordingError(message, **where)
    counts = {f"announced_{items}": announced, f"found_{items}": number}
    if announced > number:
        counts[f"lacking_{items}"] = announced - number
    elif announced < number:
        counts[f"surplus_{items}"] = number - announced
    return counts


def begins(*marks: bytes) -> Callable[[Head], bool]:
    """Return a recogniser of files whose first bytes are one of the ``marks``."""
    return lambda head: head.content.startswith(marks)


def is_xml(*names: str) -> Callable[[Head], bool]:
    """Return a recogniser of XML with an element of one of the ``names``."""
    element = re.compile(rf"\s*<(?:.*?<)?(?:{'|'.join(names)})[\s>]", re.DOTALL)
    return lambda head: element.match(head.text or "") is not None


def is_bag(path: Path) -> bool:
    """Return whether ``path`` has a bag's suffix, or is a folder with ROS 2's metadata.yaml."""
    if os.path.isfile(path):  # False where access is denied, where Path.is_file raises
        return path.suffix in BAG_SUFFIXES
    return os.path.isfile(path / "metadata.yaml")


def paths_below(folder: Path) -> list[Path]:
    """Return the sorted paths below ``folder``; a link to a folder outside of it is followed."""
    root = os.path.realpath(folder)
    entered = {root}
    paths = []
    for place, folders, files in os.walk(folder, followlinks=True):
        paths += [Path(place, name) for name in [*folders, *files]]
        for name in [*folders]:
            path = os.path.join(place, name)
            real = os.path.realpath(path)
            inside = os.path.islink(path) and real.startswith(f"{root}/")
            if real in entered or inside:
                folders.remove(name)  # entered at its own place
            entered.add(real)
    return sorted(paths)


def matching(folder: Path, pattern: str, *, key: str) -> list[Path]:
    """Return the sorted matches of ``pattern``; ConfigError if it is not a relative glob."""
    try:
        return sorted(folder.glob(pattern))
    except (ValueError, NotImplementedError, IndexError):
        message = f"{pattern!r} must be a relative path below {folder.as_posix()}, with * as needed"
        raise ConfigError(message, key=key) from None


def is_literal(piece: str) -> bool:
    """Return whether a ``piece`` of a glob (between two slashes) has no wildcard."""
    return not any(mark in piece.replace("[[]", "") for mark in "*?[")
