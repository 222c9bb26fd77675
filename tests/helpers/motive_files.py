"""Small Motive files for tests."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.formats.motion.take import MotionTake, RigidBody

START = "2024-03-05 10.15.00.000 AM"
TOP = (
    "Format Version,1.23,Take Name,t,Capture Frame Rate,100.0,Export Frame "
    "Rate,100.0,Rotation Type,{rotation},Length Units,{unit}"
)
MARKER = (
    ",Type,Marker,Marker,Marker\n,Name,A,A,A\n,ID,1,1,1\n,,Position,Position,Position\n"
    "Frame,Time (Seconds),X,Y,Z\n"
)
POSE = ("Rotation",) * 4 + ("Position",) * 3


def columns(
    *assets: tuple[str, str, str],
    quantities: tuple[str, ...] = ("Position",) * 3,
) -> str:
    """Rows of labels of assets of a type, name and ID, each with X, Y, Z (W) of the quantities."""
    cells = [asset for asset in assets for _ in quantities]
    rows = [
        [f",{label}", *(cell[i] for cell in cells)]
        for i, label in enumerate(("Type", "Name", "ID"))
    ]
    axes = "XYZ" if len(quantities) == 3 else "XYZWXYZ"
    rows += [
        [",", *quantities * len(assets)],
        ["Frame,Time (Seconds)", *axes * len(assets)],
    ]
    return "".join(",".join(row) + "\n" for row in rows)


def random_take(
    frames: int = 321,
    markers: int = 9,
    seed: int = 1,
    *,
    body: bool = True,
    first: int = 0,
) -> MotionTake:
    """Markers ``Link1:Marker1`` … of normal positions, and a body ``Base`` of random poses."""
    generator = np.random.default_rng(seed)
    frame = np.arange(first, first + frames)
    names = [f"Link{1 + n // 3}:Marker{1 + n % 3}" for n in range(markers)]
    points = {name: generator.normal(size=(frames, 3)) for name in names}
    turns = Rotation.random(frames, random_state=seed).as_quat()
    pose = RigidBody(generator.normal(size=(frames, 3)), turns)
    bodies = {"Base": pose} if body else {}
    return MotionTake(
        "Take 1",
        "1.23",
        100.0,
        frame,
        np.arange(frames) / 100,
        points,
        bodies,
        {},
    )


def columns_file(
    folder: Path,
    body: str,
    *,
    rotation: str = "Quaternion",
    unit: str = "Meters",
) -> Path:
    """A file of the columnar grammar with ``body`` after its first two lines."""
    file = folder / "take.csv"
    file.write_bytes(
        (TOP.format(rotation=rotation, unit=unit) + "\n\n" + body).encode(),
    )
    return file


def rows_file(
    folder: Path,
    *rows: str,
    head: str = "righthanded\ninfo,version,1.1\n",
) -> Path:
    """A file of the row-typed grammar."""
    file = folder / "rows.csv"
    file.write_bytes((head + "\n".join(rows) + "\n").encode())
    return file


# rows of the row-typed grammar
TRACKED = "7,{0}.5,2,3,0,0,0,1,0,0,0"
DEFINITION = 'rigidbody,"Arm",7,2,0.1,0,0,-0.1,0,0'


def frame_row(k: int, markers: str = "0", *, tracked: bool = True) -> str:
    pose = "1," + TRACKED.format(k % 100) if tracked else "0"
    return f"frame,{k},{k / 100:.8f},{pose},{markers}"


def seen_row(k: int) -> str:
    return frame_row(k, f"2,{k},0,1,2,Arm-Marker 1,{k},5,5,40{k},Marker-40{k}")
