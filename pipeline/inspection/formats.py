"""Which format a file has, by its content; the name settles it only where the content cannot."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.inspection import depth, force, motion, robot, table
from pipeline.inspection.finding import UNKNOWN, Finding
from pipeline.instruments.delimited import NUMBER
from pipeline.instruments.depth_intrinsics import DISTORTION, FOCAL, MATRIX
from pipeline.instruments.motive_rows import ROW_TYPES
from pipeline.instruments.trajectory import COLUMNS

HEAD = 16_384  # bytes
WIDE = "text in UTF-16"
FRAMES = (".png", ".tif", ".tiff", ".pgm", ".pcd", ".ply")
IMAGES = (b"\x89PNG\r\n\x1a\n", b"II*\0", b"MM\0*", b"P5")
BAGS = (b"#ROSBAG V", b"\x89MCAP0")
DAQFT = re.compile(r'^"?(Paused for|Skipped)\s+\d|Frequency\s*=|Averaging Level\s*=|F/T Serial Number\s*=|"?Force X\b')
CALIBRATED = re.compile(rf'(?:^|[{{,])\s*["<]?(?:{"|".join((*MATRIX, *DISTORTION))})\b"?\s*[:>\s]', re.MULTILINE)


@dataclass(frozen=True)
class Head:
    """The beginning of a file."""

    file: Path
    content: bytes

    @property
    def text(self) -> str | None:
        """The whole lines of it, None where it is not text."""
        if b"\0" in self.content:
            return None
        try:
            text = self.content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = self.content.decode("latin-1")
        return text.replace("\r\n", "\n").replace("\r", "\n")

    @property
    def lines(self) -> list[str]:
        """Its lines with content."""
        return [line for line in (self.text or "").split("\n") if line.strip(' \t,;"')]


@dataclass(frozen=True)
class Format:
    """A format by its name, what begins like it, and what describes a file of it."""

    name: str
    fits: Callable[[Head], bool]
    describe: Callable[[Path], Finding]


def format_of(file: Path) -> Format:
    """The format of ``file`` by its beginning, OTHER where it is none of those that are read."""
    with file.open("rb") as stream:
        head = Head(file, stream.read(HEAD))
    return next((form for form in FORMATS if form.fits(head)), OTHER)


def _starts(*marks: bytes) -> Callable[[Head], bool]:
    return lambda head: head.content.startswith(marks)


def _is_pcd(head: Head) -> bool:
    return head.content.startswith(b"# .PCD") or head.file.suffix.lower() == ".pcd"


def _is_c3d(head: Head) -> bool:
    return head.file.suffix.lower() == ".c3d" or (head.text is None and head.content[1:2] == b"\x50" and len(head.content) >= 512)


def _is_bag(head: Head) -> bool:
    return head.content.startswith(BAGS) or (head.file.suffix in (".db3", ".bag", ".mcap"))


def _first_cell(head: Head) -> str:
    return re.split(r"[,;\t]", head.lines[0])[0].strip().strip('"') if head.lines else ""


def _is_motive(head: Head) -> bool:
    # another program may have saved it with other separators, which its reader then says
    separated = any(re.search(r"[,;\t]", line) for line in head.lines[:2])
    return _first_cell(head) == "Format Version" or (_first_cell(head) in ROW_TYPES and separated)


def _is_trajectory(head: Head) -> bool:
    return bool(head.lines) and set(COLUMNS) <= {cell.strip().strip('"') for cell in head.lines[0].split(",")}


def _is_index(head: Head) -> bool:
    line = next((line.split(maxsplit=1) for line in head.lines if not line.lstrip().startswith("#")), [])
    return len(line) == 2 and NUMBER.fullmatch(line[0]) is not None and line[1].strip().lower().endswith(FRAMES)


def _is_netft(head: Head) -> bool:
    return any("RDT Sequence" in line for line in head.lines[:30])


def _is_daqft(head: Head) -> bool:
    return any(DAQFT.search(line) for line in head.lines[:4])


def _is_xml(*names: str) -> Callable[[Head], bool]:
    elements = re.compile(rf"<({'|'.join(names)})[\s>]")
    return lambda head: bool(head.lines) and head.lines[0].lstrip().startswith("<") and elements.search(head.text) is not None


def _is_datasheet(head: Head) -> bool:
    named = head.file.name == "dataset.yaml"
    return named or (head.file.suffix in (".yaml", ".yml") and re.search(r"(?m)^recordings:", head.text or "") is not None)


def _is_intrinsics(head: Head) -> bool:
    if head.file.suffix.lower() not in (".yaml", ".yml", ".json", ".xml"):
        return False
    text = head.text or ""
    return CALIBRATED.search(text) is not None or all(re.search(rf'(?m)(?:^|[{{,])\s*"?{name}"?\s*:', text) for name in FOCAL)


def _is_numbers(head: Head) -> bool:
    """Whether most of the last lines hold nothing but numbers, two or more of them."""
    lines = [line for line in head.lines[:-1] or head.lines if not line.lstrip().startswith(("#", "%"))][-20:]
    rows = [re.findall(r"[^\s,;]+", line.replace('"', " ")) for line in lines]
    return sum(len(row) > 1 and all(NUMBER.fullmatch(cell) or cell.lower() == "nan" for cell in row) for row in rows) > len(lines) / 2


INDEX = Format("depth sequence with index", _is_index, lambda file: depth.sequence(file)[0])
OTHER = Format(UNKNOWN, lambda head: True, lambda file: Finding(file, UNKNOWN))
FORMATS = (
    Format(
        WIDE, _starts(b"\xff\xfe", b"\xfe\xff"), lambda file: Finding(file, WIDE, stops=["two bytes a letter; export it as UTF-8 text"])
    ),
    Format("depth image", _starts(*IMAGES), depth.image),
    Format("point cloud, PLY", _starts(b"ply\n", b"ply\r\n"), depth.cloud),
    Format("point cloud, PCD", _is_pcd, depth.cloud),
    Format("ROS bag", _is_bag, depth.bag),
    Format("C3D", _is_c3d, motion.c3d),
    Format("URDF", _is_xml("robot"), robot.urdf),
    Format("ATI calibration", _is_xml("FTSensor", "Calibration", "UserAxis"), force.calibration),
    Format("Motive CSV", _is_motive, motion.motive),
    Format("commanded trajectory", _is_trajectory, motion.trajectory),
    INDEX,
    Format("ATI Net F/T log", _is_netft, force.netft),
    Format("ATI DAQ F/T log", _is_daqft, force.daqft),
    Format("datasheet", _is_datasheet, robot.datasheet),
    Format("camera intrinsics", _is_intrinsics, depth.intrinsics),
    Format("table of numbers", _is_numbers, table.numbers),
)
