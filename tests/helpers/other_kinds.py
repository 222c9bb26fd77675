"""Kinds of files other than joint logs, as other_kinds.yaml lists them: see
:class:`kinds.FileKind`.
"""

import json
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from c3d_files import c3d, points
from depth_files import CALIBRATIONS, CLOUDS, SMALL, encoded
from kinds import FileKind, read_kinds
from motive_files import START, frame_row, random_take, rows_file
from ros_bags import Message, write_bag
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from scipy.io import savemat

from pipeline.formats.motion.motive import write_motive

CLOUD = CLOUDS["ascii.pcd"]
LAST_POINT = CLOUD[:-1].rindex(b"\n") + 1  # its first byte
CONTENTS = {
    "png": encoded(".png", SMALL),
    "cloud": CLOUD,
    "cloud without a point": CLOUD[:LAST_POINT],
}


def write_frames(folder: Path, names: Sequence[str], content: str = "png") -> None:
    """Write frames of the ``names``, all of a content of CONTENTS."""
    for name in names:
        (folder / name).write_bytes(CONTENTS[content])


def write_stamped_frames(folder: Path) -> None:
    """Write 30 frames whose names are times that step by 0.05 s."""
    write_frames(folder, [f"{1.45e9 + k / 20:.6f}.png" for k in range(1, 31)])


def write_states(folder: Path, form: str = "mcap") -> Path:
    """Write a bag of joint states of two joints; return its path."""
    messages = []
    for k in range(20):
        time = 1 + k / 100
        angles = np.array([k / 100, 0.0])
        empty = np.zeros(0)
        state = Message(
            "sensor_msgs/msg/JointState",
            time,
            name=["a", "b"],
            position=angles,
            velocity=empty,
            effort=empty,
        )
        messages.append((time, state))
    return write_bag(folder, form, {"/joint_states": messages})


def write_bag_beside(
    folder: Path,
    topic: str,
    kind: str = "my_msgs/msg/A",
    form: str = "cdr",
    storage: str = "MCAP",
    definition: str = "float64 a\n",
    encoding: str = "",
) -> None:
    """Write a bag of joint states beside a ``topic`` of another ``kind``."""
    states = write_states(folder / "states", storage.lower())
    bag = folder / "run_1"
    with Writer(bag, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        unknown = writer.add_connection(
            topic,
            kind,
            msgdef=definition,
            rihs01="RIHS01_" + "1" * 64,
            serialization_format=form,
        )
        with Reader(states) as reader:
            (joints,) = reader.connections
            added = writer.add_connection(
                joints.topic,
                joints.msgtype,
                msgdef=joints.msgdef.data,
                rihs01=joints.digest,
            )
            writer.write(unknown, 10**9, b"\0" * 12)
            for _, stamp, raw in reader.messages():
                writer.write(added, stamp, raw)
    shutil.rmtree(folder / "states")
    if encoding:
        replace_schema_encoding(bag, kind, encoding)


def replace_schema_encoding(bag: Path, kind: str, encoding: str) -> None:
    """Replace the encoding of the schema of a ``kind`` in an MCAP file."""
    (file,) = bag.glob("*.mcap")
    schema = kind.encode() + b"\7\0\0\0"
    content = file.read_bytes()
    assert schema + b"ros2msg" in content
    edited = content.replace(schema + b"ros2msg", schema + encoding.encode())
    file.write_bytes(edited)


def write_fewer_messages(folder: Path) -> None:
    """Write a bag that announces a message more than it holds."""
    metadata = write_states(folder, "sqlite3") / "metadata.yaml"
    text = metadata.read_text().replace("message_count: 20", "message_count: 21")
    metadata.write_text(text)


def write_texts(folder: Path, files: Mapping[str, str]) -> None:
    """Write text files."""
    for name, text in files.items():
        (folder / name).write_text(text)


def write_opencv(folder: Path) -> None:
    """Write the calibration of a camera by OpenCV in one line."""
    (folder / "c.xml").write_text(CALIBRATIONS["opencv.xml"].replace("\n", ""))


def write_take(
    folder: Path,
    frames: int = 5,
    markers: int = 1,
    length: int | None = None,
    **options: object,
) -> None:
    """Write a C3D file, cut off after ``length`` bytes; see :func:`c3d_files.c3d`."""
    xyz = points(frames, markers) / 1e3
    content = c3d(["arm:a"][:markers], xyz, **options)
    (folder / "take.c3d").write_bytes(content[:length])


def write_cut_motive(folder: Path) -> None:
    """Write an export of Motive that is cut after 30 frames."""
    file = folder / "take.csv"
    write_motive(file, random_take(50, 1), start=START)
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(lines[: 7 + 30]))


def write_wrong_unit(folder: Path) -> None:
    """Write an export of Motive in m whose header says millimetres."""
    file = folder / "take.csv"
    write_motive(file, random_take(9, 2, body=False), start=START)
    within_a_metre = re.sub(r",-?\d\.(\d{6})", r",0.\1", file.read_text())
    file.write_text(within_a_metre.replace("Meters", "Millimeters"))


def write_cut_rows(folder: Path) -> None:
    """Write rows of an old export of Motive that announces more frames."""
    rows = [frame_row(k, f"1,{k},0.5,1,{k + 7},a", tracked=False) for k in range(5)]
    rows_file(folder, *rows, head="righthanded\ninfo,version,1.1\ninfo,framecount,9\n")


def joint(
    name: str,
    parent: str,
    child: str,
    *,
    kind="revolute",
    lower="-1",
    height=0.1,
) -> str:
    limit = f'<limit lower="{lower}" upper="1" velocity="1" effort="1"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    place = f'<origin xyz="0 0 {height}"/><axis xyz="0 1 0"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{place}{limit}</joint>'


def urdf(links: list[str], joints: list[str]) -> str:
    elements = [*(f'<link name="{name}"/>' for name in links), *joints]
    return f'<robot name="many">{"".join(elements)}</robot>'


def planar_arm(link: str = "hand") -> str:
    """A URDF of the joints shoulder, elbow and wrist, which moves ``link``, and of a fixed tool."""
    links = ["base", "upper", link, "jaw", "tip"]
    joints = []
    for k, name in enumerate(["shoulder", "elbow", "wrist", "tool"]):
        kind = "fixed" if name == "tool" else "revolute"
        height = (k + 1) / 10
        joints.append(joint(name, links[k], links[k + 1], kind=kind, height=height))
    return '<?xml version="1.0"?>\n' + urdf(links, joints)


def write_planar_arm(folder: Path, head: str = "", kind: str = "revolute") -> None:
    """Write :func:`planar_arm` behind a ``head``, its first joint of another ``kind``."""
    text = planar_arm().replace("revolute", kind, 1)
    (folder / "arm.urdf").write_text(head + text)


def write_robot(
    folder: Path,
    links: list[str],
    joints: list[list[str]],
    **options: str,
) -> None:
    """Write a URDF of ``joints`` (name, parent, child) with equal ``options``."""
    elements = [joint(*names, **options) for names in joints]
    (folder / "robot.urdf").write_text(urdf(links, elements))


def write_serial(folder: Path, count: int, sensors: int = 0) -> None:
    """Write a URDF of a chain of joints, with ``sensors`` fixed to each of its links."""
    links = ["l0"]
    joints = []
    for k in range(count):
        link = f"l{k}"
        following = f"l{k + 1}"
        links.append(following)
        joints.append(joint(f"j{k}", link, following))
        for number in range(sensors):
            sensor = f"s{k}_{number}"
            links.append(sensor)
            joints.append(joint(f"f{sensor}", link, sensor, kind="fixed"))
    (folder / "robot.urdf").write_text(urdf(links, joints))


def write_links(folder: Path) -> None:
    """Write frames behind a link to their folder, and a link that makes a loop."""
    (folder / "exports").mkdir()
    (folder / "store").mkdir()
    write_frames(folder / "store", ["a_1.png", "a_2.png"])
    (folder / "exports/run_1").symlink_to("../store")
    (folder / "store/back").symlink_to("..")


def write_link_as_text(folder: Path) -> None:
    """Write what a checkout without links has in place of a link."""
    for name in ("exports", "store"):
        (folder / name).mkdir()
    (folder / "exports/run_1").write_text("../store")


def make_folder(folder: Path, name: str) -> None:
    """Make an empty folder."""
    (folder / name).mkdir(parents=True)


def write_camera(folder: Path, **values: object) -> None:
    """Write the intrinsics of a camera."""
    size = {"width": 640, "height": 480}
    matrix = {"fx": 525.5, "fy": 526.5, "cx": 319.25, "cy": 239.75}
    (folder / "camera.json").write_text(json.dumps(size | matrix | values))


TIME = np.arange(60) / 125  # s
Q = np.stack([np.sin(3 * TIME)] * 2, axis=1)  # rad
STAMPS = pd.to_datetime(1.7e9 + TIME, unit="s")


ARRAYS = {"time": TIME, "q": Q, "q_target": Q}


def table() -> pd.DataFrame:
    """Measured and commanded angles of two joints."""
    labels = ["q_0", "q_1", "q_target_0", "q_target_1"]
    return pd.DataFrame(np.hstack([Q, Q]), columns=labels)


def write_dates(folder: Path) -> None:
    """Write a Parquet file with dates as times."""
    table().assign(time=STAMPS).to_parquet(folder / "log.parquet")


def write_durations(folder: Path) -> None:
    """Write a Parquet file with durations as times."""
    table().assign(t=STAMPS - STAMPS[0]).to_parquet(folder / "a.parquet")


def write_times_as_index(folder: Path) -> None:
    """Write a Parquet file whose index is the time."""
    indexed = table().set_index(TIME).rename_axis("t")
    indexed.to_parquet(folder / "a.parquet")


def write_array_of_dates(folder: Path) -> None:
    """Write arrays of angles and of dates."""
    np.savez(folder / "a.npz", **ARRAYS | {"time": STAMPS.to_numpy()})


def write_array_of_times(folder: Path, struct: str = "", format: str = "5") -> None:
    """Write a MATLAB file of arrays, in a ``struct`` if it is named, in a version's ``format``."""
    arrays = {struct: ARRAYS} if struct else ARRAYS
    savemat(folder / "a.mat", arrays, format=format)


def write_objects_beside(folder: Path) -> None:
    """Write arrays beside one of objects, which are not loaded."""
    np.savez(folder / "objects.npz", **ARRAYS, about=np.array([{}], object))


WRITERS: dict[str, Callable[..., object]] = {
    "frames": write_frames,
    "stamped frames": write_stamped_frames,
    "bag beside": write_bag_beside,
    "fewer messages": write_fewer_messages,
    "texts": write_texts,
    "opencv": write_opencv,
    "take": write_take,
    "cut motive": write_cut_motive,
    "wrong unit": write_wrong_unit,
    "cut rows": write_cut_rows,
    "serial": write_serial,
    "robot": write_robot,
    "links": write_links,
    "link as text": write_link_as_text,
    "empty folder": make_folder,
    "camera": write_camera,
    "planar arm": write_planar_arm,
    "dates": write_dates,
    "durations": write_durations,
    "array of dates": write_array_of_dates,
    "array of times": write_array_of_times,
    "objects beside": write_objects_beside,
    "times as index": write_times_as_index,
}
KINDS: list[FileKind] = read_kinds("other_kinds.yaml", WRITERS)
