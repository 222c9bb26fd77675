"""A folder of one small recording of every format."""

from pathlib import Path

import cv2
import ezc3d
import numpy as np
import pandas as pd
from depth_files import CLOUDS
from motive_files import START, random_take, rows_file
from numpy.random import default_rng
from ros_bags import camera_info, image, write_bag
from written_logs import CALIBRATION, write_joint_log, write_netft

from pipeline.core.columns import PLANE, columns
from pipeline.formats.depth.image import write_depth, write_index
from pipeline.formats.depth.intrinsics import Intrinsics, write_intrinsics
from pipeline.formats.force.daqft import ForceRecord, write_daqft
from pipeline.formats.joints.log import JointLog
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.trajectory import write_trajectory

SHAPE = (24, 32)
LINKS = ("base", "a", "b", "c", "tip")
JOINTS = "".join(
    f'<joint name="j{n}" type="{"revolute" if n < 4 else "fixed"}">'
    f'<parent link="{LINKS[n - 1]}"/><child link="{LINKS[n]}"/><origin xyz="0 0 0.2"/>\n'
    '<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>\n'
    for n in range(1, len(LINKS))
)
TEXTS = {
    "FT7.cal": CALIBRATION.replace("FT1", "FT7"),
    "sized.json": '{"width": 32, "height": 24, "fx": 30, "fy": 30, "cx": 16, "cy": 12}',
    "cloud.ply": CLOUDS["ascii.ply"].decode(),
    "cloud.pcd": CLOUDS["ascii.pcd"].decode(),
    "three.urdf": '<robot name="three">'
    + "".join(f'<link name="{name}"/>' for name in LINKS) + f"\n{JOINTS}</robot>\n",
    "dataset.yaml": "about: {subject: a, source: b, licence: c}\nrecordings: ???\n"
    "mocap: {training: a.csv}\n",
    "notes.md": "Recorded on a Monday.\n",
    "payload.pkl": "cos\nsystem\n(S'touch pwned'\ntR.",
}  # fmt: skip


def frames(folder: Path, count: int = 4) -> list[str]:
    """Depth images 0000.png … in ``folder``, values 900 to 1100 and a tenth without depth."""
    folder.mkdir(parents=True)
    rng = default_rng(5)
    for number in range(count):
        depth = rng.integers(900, 1101, SHAPE).astype(np.uint16)
        depth[rng.random(SHAPE) < 0.1] = 0
        write_depth(folder / f"{number:04d}.png", depth)
    return [f"{number:04d}.png" for number in range(count)]


def write_takes(folder: Path) -> None:
    """Takes of motion capture of Motive in both grammars and as C3D."""
    take = random_take(50)
    take.markers["Link1:Marker1"][10:15] = np.nan
    write_motive(folder / "columns.csv", take, start=START)

    rows = []
    for k in range(30):
        rows.append(f"frame,{k},{k / 120:.6f},1,1,{0.1 * k},0,1,0,0,0,1,0,0,0,0")
    rows_file(folder, "rigidbody,Hand,1,0", *rows)

    c3d = ezc3d.c3d()
    point = c3d["parameters"]["POINT"]
    point["UNITS"]["value"] = ["mm"]
    point["RATE"]["value"] = [100]
    point["LABELS"]["value"] = ["A", "B", "C"]
    homogeneous = default_rng(3).normal(size=(4, 3, 20))
    homogeneous[3] = 1.0
    c3d["data"]["points"] = homogeneous
    c3d.write(str(folder / "take.c3d"))


def write_forces(folder: Path) -> None:
    """Logs of a force transducer by both programs of ATI."""
    time = np.arange(500) / 100
    felt = default_rng(4).normal(size=(2, 500, 3))
    record = ForceRecord(time, *felt, 100.0, "FT7", START, {})
    write_daqft(folder / "points.csv", record)
    write_daqft(folder / "commas.csv", record, decimal=",")
    write_netft(folder / "netft.csv", record)


def write_images(folder: Path) -> None:
    """Depth images by themselves, by an index and by numbers, and their camera."""
    write_depth(folder / "single.png", np.full(SHAPE, 1000, np.uint16))
    cv2.imwrite(str(folder / "metres.tiff"), np.full(SHAPE, 1.5, np.float32))
    frames(folder / "numbered")

    names = tuple(f"depth/{name}" for name in frames(folder / "indexed" / "depth"))
    times = np.array([0.0, 0.1, 0.2, 0.4])
    write_index(folder / "indexed" / "depth.txt", times, names)

    camera = Intrinsics(30.0, 30.0, 16.0, 12.0, *SHAPE[::-1])
    write_intrinsics(folder / "camera.yaml", camera)


def write_bags(folder: Path) -> None:
    """Bags of two topics of images and of their camera."""
    pictures = []
    for k in range(3):
        pixels = np.full(SHAPE, 900 + k, np.uint16)
        pictures.append((k / 10, image(pixels, 1 + k / 10)))
    camera = camera_info([30, 0, 16, 0, 30, 12, 0, 0, 1], [0] * 5, SHAPE[::-1])
    topics = {"/depth": pictures, "/other": pictures, "/info": [(0.0, camera)]}

    for form in ("ros1", "sqlite3", "mcap"):
        (folder / form).mkdir()
        write_bag(folder / form, form, topics)


def write_joints(folder: Path) -> None:
    """A joint log and a commanded trajectory."""
    angles = {"actual": default_rng(5).normal(size=(30, 6))}
    write_joint_log(folder / "q.csv", JointLog(np.arange(30) / 125, angles, {}))

    path = pd.DataFrame({"t": np.arange(6) / 100})
    for name in columns("x", PLANE) + columns("v", PLANE):
        path[name] = path["t"]
    write_trajectory(folder / "path.csv", path)


def write_zoo(folder: Path) -> None:
    """One recording of every format, and two files of no format."""
    for name, text in TEXTS.items():
        (folder / name).write_text(text)
    write_takes(folder)
    write_forces(folder)
    write_images(folder)
    write_bags(folder)
    write_joints(folder)
