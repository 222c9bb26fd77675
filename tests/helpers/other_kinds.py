"""Kinds of files other than joint logs: see :func:`kinds.kind`."""

import json
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from c3d_files import c3d, points
from depth_files import CALIBRATIONS, CLOUDS, SMALL, encoded
from kinds import kind
from motive_files import START, frame_row, random_take, rows_file
from ros_bags import Message, write_bag
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from scipy.io import savemat

from pipeline.formats.motion.motive import write_motive

PNG = encoded(".png", SMALL)
ASKED = "rate is not stated: dataset.depth.rate"


def frames(*names: str, content: bytes = PNG) -> Callable[[Path], None]:
    """A function that writes frames of the ``names``."""
    return lambda folder: (
        [(folder / name).write_bytes(content) for name in names] and None
    )


CLOUD = CLOUDS["ascii.pcd"]
GRABBED = [f"frame_20111121T101112.{us}.pcd" for us in ("123456", "387167", "650001")]
NAMES = [
    kind("22", frames(*[f"145000000{k // 20}.{k % 20 * 50000:06d}.png" for k in range(1, 31)]),
        "20 Hz; 1.45 s", "times in the names; frames 30", at="", never=("dropped",)),
    kind("22", frames(*GRABBED, content=CLOUD), "3.798 Hz; 0.5265 s", "frames 3",
        never=("dropped",)),
    kind("22", frames(*[f"{1573820104123 + 40 * k}.png" for k in (0, 1, 2, 4)]),
        "25 Hz; 0.16 s; 1 dropped frames"),
    kind("22", frames(*[f"d-{1294886360 + k / 30:.6f}-{2996770081 + 7 * k}.png"
        for k in range(4)]), "30 Hz; 0.1 s", "frames 4", never=("dropped",)),
    kind("22", frames(*[f"cam_{33333 * k:09d}.png" for k in range(5)]),
        "the numbers step by 33333: state how many a second has", never=("dropped",)),
    kind("23", frames(*[f"cell [2]_{k:03d}.png" for k in range(5)]), "frames 5", ASKED, at=""),
    kind("23", frames(*[f"a*b?{k:02d}.png" for k in range(4)]), "frames 4"),
    kind("23", frames(*[f"[!x]{k}].png" for k in range(3)]), "frames 3"),
    kind("24", frames(*[f"{k:04d}_cam2.png" for k in range(4)], *[f"d_000{k}_8x6.png" for k in (0,
        1, 2, 3)]), "[0-9]*_cam2.png: depth", "d_[0-9]*_8x6.png: depth", "frames 4", at=""),
    kind("24", frames(*[f"cam{c}_{k:04d}.png" for k in range(4) for c in (1, 2)]),
        "cam*_[*-*]*.png (2): depth sequence"),
    kind("24", frames(*[f"frame-{k:06d}.depth16.png" for k in (0, 1, 3)]),
        "1 dropped frames; width 16; height 12; frames 3"),
]  # fmt: skip


def states(folder: Path, form: str = "mcap") -> Path:
    held = [
        (1 + k / 100, Message(
            "sensor_msgs/msg/JointState", 1 + k / 100, name=["a", "b"], velocity=np.zeros(0),
            position=np.array([k / 100, 0.0]), effort=np.zeros(0)))
        for k in range(20)
    ]  # fmt: skip
    return write_bag(folder, form, {"/joint_states": held})


EVENT = (
    "service_msgs/ServiceEventInfo info\nmy_msgs/srv/SetMode_Request[<=1] request\n"
    "my_msgs/srv/SetMode_Response[<=1] response\n"
)


def bag_with(
    topic: str, *, kind: str = "my_msgs/msg/A", form: str = "cdr", storage: str = "MCAP",
    definition: str = "float64 a\n", encoding: bytes = b"",
) -> Callable[[Path], None]:  # fmt: skip
    """A function that writes joint states beside a ``topic`` of another ``kind``."""

    def write(folder: Path) -> None:
        plain, bag = states(folder / "p", storage.lower()), folder / "run_1"
        with Writer(bag, version=9, storage_plugin=StoragePlugin[storage]) as writer:
            with Reader(plain) as reader:
                other = writer.add_connection(
                    topic, kind, msgdef=definition, rihs01="RIHS01_" + "1" * 64,
                    serialization_format=form)  # fmt: skip
                (one,) = reader.connections
                added = writer.add_connection(
                    one.topic, one.msgtype, msgdef=one.msgdef.data, rihs01=one.digest)  # fmt: skip
                writer.write(other, 10**9, b"\0" * 12)
                for _, stamp, raw in reader.messages():
                    writer.write(added, stamp, raw)
        shutil.rmtree(folder / "p")
        if encoding:  # of the schema
            (file,) = bag.glob("*.mcap")
            before = kind.encode() + b"\7\0\0\0ros2msg"
            content = file.read_bytes()
            assert before in content
            file.write_bytes(
                content.replace(before, kind.encode() + b"\7\0\0\0" + encoding)
            )

    return write


def fewer_messages(folder: Path) -> None:
    metadata = states(folder, "sqlite3") / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace("message_count: 20", "message_count: 21")
    )


READ = ("100 Hz; 0.19 s; samples 20; joints 2", "passed over /")
BAGS = [
    kind("25", bag_with("/set_mode/_service_event", kind="my_msgs/srv/SetMode_Event",
        definition=EVENT), "passed over /set_mode/_service_event", at="run_1", never=("damaged",)),
    kind("25", bag_with("/a", encoding=b'ros1msg'), *READ, inside="run_1"),
    kind("25", bag_with("/a", encoding=b'protobf'), *READ, inside="run_1"),
    kind("25", bag_with("/a", form="protobuf"), *READ, inside="run_1"),
    kind("25", bag_with("/a", form="json", storage="SQLITE3"), *READ, inside="run_1"),
    kind("25", bag_with("/a", definition="float64 a\nnot_there/B b\n"), *READ, inside="run_1"),
]  # fmt: skip

OID = "oid sha256:" + "ab12" * 16
XACRO = "http://www.ros.org/wiki/xacro"
POINTER = f"version https://git-lfs.github.com/spec/v1\n{OID}\nsize 982345\n"
ANNEX = "../.git/annex/objects/5x/Pm/MD5E-s3--acbd18.c3d/MD5E-s3--acbd18.c3d\n"
PAGE = "<!DOCTYPE html>\n<html><head><title>Sign in</title></head></html>\n"


def texts(files: dict[str, str]) -> Callable[[Path], None]:
    return lambda folder: (
        [(folder / name).write_text(text) for name, text in files.items()] and None
    )


ENDINGS = ("run_1.c3d", "run_1.csv", "run_1.parquet")
POINTERS = [
    kind("26", texts(dict.fromkeys(ENDINGS, POINTER)), "run_1.c3d: unknown", "run_1.csv: unknown",
        "run_1.parquet: unknown",
        "! a pointer of Git LFS in place of the file: run `git lfs pull`", at="", never=("damaged",
        "cut short"), stops=True),
    kind("26", texts({"a.bag": POINTER, "b.mat": ANNEX, "c.npz": POINTER, "d.urdf": POINTER}),
        "a.bag: ROS bag ! a pointer of Git LFS", "c.npz: unknown ! a pointer of Git LFS",
        "! a pointer of git-annex in place of the file: run `git annex get`", never=("damaged",),
        stops=True),
    kind("26", texts({"take.csv": PAGE, "log.mat": PAGE, "index.html": PAGE}),
        "take.csv: unknown ! a web page in place of", "log.mat: unknown ! a web page",
        "index.html", stops=True),
    kind("36", texts({"macros.xacro": '<root xmlns:xacro="x"><xacro:macro name="m"/></root>'}),
        "macros.xacro: xacro ! xacro is not read: expand it with xacro", at="macros.xacro",
        stops=True),
    kind("36", texts({"x.urdf": '<!-- of an arm -->\n<links xmlns:xacro="x"><xacro:a/></links>'}),
        "x.urdf: xacro ! xacro is not read", stops=True),
    kind("36", texts({"x.xml": '<?xml version="1.0"?>\n<robot><xacro:if value="a"/></robot>'}),
        "a xacro: expand it with xacro x.xml > arm.urdf", stops=True),
    kind("36", texts({"x.xacro": f'?xml version="1.0"?>\n<robot xmlns:xacro="{XACRO}" name="a"/>'}),
        "x.xacro: xacro ! xacro is not read", stops=True),
    kind("36", texts({"x.urdf": f'<robot xmlns:xacro="{XACRO}"><xacro:arm n="l"/></robot>'}),
        "a xacro: expand it with xacro x.urdf > arm.urdf", stops=True),
]  # fmt: skip


def take(**options: object) -> Callable[[Path], None]:
    """A function that writes a C3D of ``frames`` (default 5), cut off after ``length`` bytes; see
    :func:`c3d_files.c3d`.
    """

    def write(
        folder: Path, *, frames=5, markers=1, length=None, **options: object
    ) -> None:
        xyz = points(frames, markers) / 1e3
        (folder / "take.c3d").write_bytes(
            c3d(["arm:a"][:markers], xyz, **options)[:length]
        )

    return partial(write, **options)


def cut_motive(folder: Path) -> None:
    write_motive(folder / "take.csv", random_take(50, 1), start=START)
    lines = (folder / "take.csv").read_text().splitlines(keepends=True)
    (folder / "take.csv").write_text("".join(lines[: 7 + 30]))


def cut_rows(folder: Path) -> None:
    rows = [frame_row(k, f"1,{k},0.5,1,{k + 7},a", tracked=False) for k in range(5)]
    rows_file(folder, *rows, head="righthanded\ninfo,version,1.1\ninfo,framecount,9\n")


LONG, CAPPED = {"frames": 68000, "start": 1}, {"frames": 68000, "last": 65535}
TAKES = [
    kind("27", take(markers=0, frames=300, analogs={"F1": 10, "F2": 10}),
        "2 analog channels (F1, F2) of 3000 samples", at="", never=("truncated",), stops=True),
    kind("27", take(markers=0), "the file has no points: no take", stops=True),
    kind("27", take(markers=0, analogs={"EMG": 1}), "1 analog channels (EMG) of 5 samples",
        stops=True),
    kind("28", take(**LONG, last=65535, end=68000), "680 s", "frames 68000", at=""),
    kind("28", take(**LONG, last=2464, end=68000), "frames 68000"),
    kind("28", take(**CAPPED, long_frames=68000), "frames 68000"),
    kind("28", take(**CAPPED), "frames 68000"),
    kind("28", take(**CAPPED | {"frames": 66000}, long_frames=68000),
        "the file announces 68000 frames and holds 66000", stops=True),
    kind("28", take(frames=65535), "frames 65535"),
    kind("28", take(**CAPPED, length=700), "bytes or more; the file has 700", stops=True),
    kind("29", cut_motive, "lacking frames", "frames", at="take.csv"),
    kind("unit", lambda folder: (write_motive(file := folder / "take.csv", random_take(9, 2,
        body=False), start=START), file.write_text(
        re.sub(r",-?\d\.(\d{6})", r",0.\1", file.read_text()).replace("Meters", "Millimeters"))),
        "markers lie within", stops=True),
    kind("29", cut_rows, "dataset.mocap.unit", "4 lacking frames"),
    kind("29", fewer_messages, "announces 21 messages and holds 20", inside="take", stops=True),
    kind("29", frames("a.pcd", content=CLOUD[: CLOUD[:-1].rindex(b"\n") + 1]),
        "announces 12 points and holds 11", stops=True),
]  # fmt: skip


def joint(
    name: str, parent: str, child: str, *, kind="revolute", lower="-1", height=0.1
) -> str:
    limit = f'<limit lower="{lower}" upper="1" velocity="1" effort="1"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    place = f'<origin xyz="0 0 {height}"/><axis xyz="0 1 0"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{place}{limit}</joint>'


def urdf(links: list[str], joints: list[str]) -> str:
    parts = [*(f'<link name="{name}"/>' for name in links), *joints]
    return f'<robot name="many">{"".join(parts)}</robot>'


def robot(folder: Path, links: list[str], joints: list[str]) -> None:
    (folder / "robot.urdf").write_text(urdf(links, joints))


def serial(folder: Path, count: int, sensors: int = 0) -> None:
    """A chain of joints, with ``sensors`` fixed to each of its links."""
    joints = [joint(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(count)]
    fixed = [(f"l{k}", f"s{k}_{n}") for k in range(count) for n in range(sensors)]
    joints += [joint(f"f{child}", one, child, kind="fixed") for one, child in fixed]
    robot(
        folder,
        [*(f"l{k}" for k in range(count + 1)), *(child for _, child in fixed)],
        joints,
    )


TWO = [joint("j1", "l0", "l1"), joint("j2", "l2", "l3")]
ROBOTS = [
    kind("35", partial(serial, count=100, sensors=3), "robot many", "(100)", "? which",
        at="robot.urdf", never=("damaged",)),
    kind("35", partial(serial, count=120), "which three parallel joints"),
    kind("35", partial(serial, count=20000), "found 20000 joints, at most 1000 are allowed",
        "dataset.reading.joints", never=("damaged",), stops=True),
    kind("39", partial(robot, links=["l0", "l1", "l2", "l3"], joints=TWO), "2 root links (l0, l2)",
        at="robot.urdf", stops=True),
    kind("39", partial(robot, links=["l0", "l1", "l2"], joints=TWO[:1]), "2 root links (l0, l2)",
        stops=True),
    kind("39", partial(robot, links=["l0", "l1"], joints=[TWO[0], joint("j2", "l1", "l9")]),
        "joints name the link 'l9'", stops=True),
    kind("39", partial(robot, links=["l0", "l1"], joints=[joint("j", "l0", "l1", lower="nan")]),
        "limit or mimic of the joint j: nan", stops=True),
]  # fmt: skip


def linked(folder: Path) -> None:
    (folder / "exports").mkdir()
    (folder / "store").mkdir()
    frames("a_1.png", "a_2.png")(folder / "store")
    (folder / "exports/run_1").symlink_to("../store")
    (folder / "store/back").symlink_to("..")  # a loop


def link_as_text(folder: Path) -> None:
    """What a checkout without links has in place of a link."""
    for name in ("exports", "store"):
        (folder / name).mkdir()
    (folder / "exports/run_1").write_text("../store")


NOTHING = "! the folder holds no recordings"
FOLDERS = [
    kind("37", link_as_text, "run_1: unknown ! the text of a link to ../store", at="exports",
        stops=True),
    kind("37", linked, "run_1/a_[0-9]*.png", "frames 2", inside="exports"),
    kind("37", lambda folder: (folder / "empty").mkdir(), NOTHING, at="empty", stops=True),
    kind("37", lambda folder: (folder / "a/b").mkdir(parents=True), NOTHING, stops=True),
    kind("37", texts({"run.csv.dvc": "outs:\n- md5: 9f\n  size: 1\n  path: run.csv\n"}), NOTHING,
        stops=True),
]  # fmt: skip

CAMERA = {
    "width": 640,
    "height": 480,
    "fx": 525.5,
    "fy": 526.5,
    "cx": 319.25,
    "cy": 239.75,
}


def camera(**more: object) -> Callable[[Path], None]:
    return lambda folder: (
        (folder / "camera.json").write_text(json.dumps(CAMERA | more)) and None
    )


TIME, Q = np.arange(60) / 125, np.stack([np.sin(3 * np.arange(60) / 125)] * 2, axis=1)
STAMPS = pd.to_datetime(1.7e9 + TIME, unit="s")
TABLE = pd.DataFrame({f"{n}_{j}": Q[:, j] for n in ("q", "q_target") for j in (0, 1)})
DATED = ("125 Hz", "dataset.joint_log.angle_unit")
UNITS = [
    kind("41", camera(distortion=[0] * 5), "width 640; height 480; fx 525.5", at="camera.json"),
    kind("41", camera(coeffs=[0] * 5), "fx 525.5"),
    kind("41", texts({"c.xml": CALIBRATIONS["opencv.xml"].replace("\n", "")}), "fx 525.5"),
    kind("41", camera(lens_dist=[0] * 5), "no distortion; the file has", "D, d, with zeros",
        never=("no camera matrix",), stops=True),
    kind("42", lambda folder: TABLE.assign(time=STAMPS).to_parquet(folder / "log.parquet"), *DATED,
        at="log.parquet", never=("unit of the times",)),
    kind("42", lambda folder: np.savez(folder / "a.npz", time=STAMPS.to_numpy(), q=Q, q_target=Q),
        *DATED, never=("unit of the times",)),
    kind("42", lambda folder: TABLE.assign(t=STAMPS - STAMPS[0]).to_parquet(folder / "a.parquet"),
        *DATED, never=("unit of the times",)),
    kind("42", lambda folder: savemat(folder / "a.mat", {"time": TIME, "q": Q, "q_target": Q}),
        "125 Hz", "unit of the times is not stated"),
]  # fmt: skip

KINDS = [*NAMES, *BAGS, *POINTERS, *TAKES, *ROBOTS, *FOLDERS, *UNITS]
