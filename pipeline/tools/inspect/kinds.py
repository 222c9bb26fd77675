"""What describes a file: a recording by the kind of its format, a robot's description and a
datasheet each on its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pipeline import formats
from pipeline.formats.format import Format, Head, Kind, begins, formats_in, is_xml
from pipeline.tools.inspect import bag, depth, force, joints, motion, robot, sequence, table
from pipeline.tools.inspect.finding import DATASHEET, ROBOT, UNKNOWN, Finding
from pipeline.tools.inspect.unrecognised import unrecognised

WIDE = "text in UTF-16"
DESCRIBE: dict[Kind, Callable[[Format, Path], Finding]] = {
    Kind.MOTION: motion.take,
    Kind.TRAJECTORY: motion.trajectory,
    Kind.JOINTS: joints.log,
    Kind.FORCE: force.log,
    Kind.CALIBRATION: force.calibration,
    Kind.IMAGE: depth.image,
    Kind.CLOUD: depth.cloud,
    Kind.INTRINSICS: depth.intrinsics,
    Kind.SEQUENCE: sequence.indexed,
    Kind.BAG: bag.bag,
    Kind.TABLE: table.numbers,
}


@dataclass(frozen=True)
class Known:
    """A sort of file that is known: its name, its kind, what begins like it, what describes it."""

    name: str
    kind: str
    recognises: Callable[[Head], bool]
    describe: Callable[[Path], Finding]


def known_as(file: Path) -> Known:
    """What ``file`` is by its beginning; OSError where it cannot be opened."""
    head = Head.read(file)
    return next(known for known in _known() if known.recognises(head))


def _known() -> list[Known]:
    """All sorts in the order in which they are asked; the last one is any file."""
    recordings = [
        Known(form.name, form.kind, form.recognises, partial(DESCRIBE[form.kind], form))
        for form in formats_in(formats)
        if form.recognises
    ]
    return [
        Known(WIDE, UNKNOWN, begins(b"\xff\xfe", b"\xfe\xff"), _wide),
        Known("URDF", ROBOT, is_xml("robot"), robot.urdf),
        Known("datasheet", DATASHEET, robot.is_datasheet, robot.datasheet),
        *recordings,
        Known(UNKNOWN, UNKNOWN, lambda head: True, unrecognised),
    ]


def _wide(file: Path) -> Finding:
    return Finding(file, WIDE, stops=["two bytes a letter; export it as UTF-8 text"])
