"""Files of sensors and robots that instruments and other programs write: each kind in a small file
written here, and the same from ../shared where it lies beside the project.
"""

from __future__ import annotations

import os
import runpy
import struct
from pathlib import Path

import numpy as np
import pytest

from pipeline.arm.model import chain_of
from pipeline.core.errors import PipelineError
from pipeline.core.options.dataset import Robot
from pipeline.formats.motion.c3d import read_c3d
from pipeline.tools.inspect.command import as_table, inspect

CASES = Path(__file__).parents[3] / "shared" / "cases"


def seen(file: Path) -> str:
    """What ``inspect`` prints of ``file``."""
    return as_table(inspect(file), file.parent)


def c3d(
    labels: list[str],
    points: int = 2,
    *,
    frames: int = 5,
    first: int = 1,
    groups: dict[str, list[str]] | None = None,
    start: int | None = None,
    processor: int = 84,
) -> bytes:
    """A C3D of Intel's floating point: point j is at 100·(j + 1) + k, 200, 300 mm in frame k."""

    def parameter(group: int, name: str, kind: int, sizes: list[int], data: bytes) -> bytes:
        body = struct.pack("<bB", kind, len(sizes)) + bytes(sizes) + data + b"\0"
        return struct.pack("<bb", len(name), group) + name.encode() + (
            struct.pack("<H", len(body) + 2) + body
        )  # fmt: skip

    def texts(group: int, name: str, items: list[str]) -> bytes:
        data = b"".join(item.encode().ljust(16) for item in items)
        return parameter(group, name, -1, [16, len(items)], data)

    def group(number: int, name: str) -> bytes:
        return struct.pack("<bb", len(name), -number) + name.encode() + struct.pack("<HB", 3, 0)

    def words(values: list[int]) -> bytes:
        return struct.pack(f"<{len(values)}H", *values)

    body = group(1, "POINT") + parameter(1, "USED", 2, [], words([points]))
    body += parameter(1, "SCALE", 4, [], struct.pack("<f", -1))
    body += parameter(1, "RATE", 4, [], struct.pack("<f", 100))
    body += parameter(1, "DATA_START", 2, [], words([4]))
    body += parameter(1, "FRAMES", 2, [], words([frames]))
    body += texts(1, "LABELS", labels[:255]) + parameter(1, "UNITS", -1, [4], b"mm  ")
    if labels[255:]:
        body += texts(1, "LABELS2", labels[255:])
    for name, items in (groups or {}).items():
        body += texts(1, name, items)
    body += group(2, "ANALOG") + parameter(2, "USED", 2, [], words([0]))
    body += group(3, "FORCE_PLATFORM") + parameter(3, "USED", 2, [], words([0]))
    if start is not None:
        low, high = start % 2**16, start >> 16
        body += group(4, "TRIAL") + parameter(4, "ACTUAL_START_FIELD", 2, [2], words([low, high]))
    blocks = -(-(len(body) + 6) // 512)
    at = body.index(b"DATA_START") + len("DATA_START") + 4
    body = body[:at] + words([2 + blocks]) + body[at + 2 :]
    head = struct.pack("<BB4HHfHHf", 2, 80, points, 0, first, first + frames - 1, 10, -1.0,
                       2 + blocks, 0, 100.0)  # fmt: skip
    data = b"".join(
        struct.pack("<4f", 100 * (j + 1) + k, 200, 300, 0)
        for k in range(frames)
        for j in range(points)
    )
    parameters = (bytes([1, 80, blocks, processor]) + body).ljust(blocks * 512, b"\0")
    return head.ljust(512, b"\0") + parameters + data


AB = ["Arm:a", "Arm:b"]
C3DS = {  # file, markers, first frame, counts
    "plain": (c3d(AB), AB, 1, {}),
    "labels padded with blanks": (c3d([*AB, "", "", ""]), AB, 1, {"skipped_labels": 3}),
    "labels of points that are not there": (c3d([*AB, "Arm:c"]), AB, 1, {"skipped_labels": 1}),
    "labels in two parameters": (
        c3d([f"m{j}" for j in range(300)], 260), [f"m{j}" for j in range(260)], 1,
        {"skipped_labels": 40},
    ),
    "first frame 0": (c3d(AB, first=0), AB, 0, {}),
    "first frame 6674": (c3d(AB, first=6674), AB, 6674, {}),
    "first frame 72210": (c3d(AB, first=72210 % 2**16, start=72210), AB, 72210, {}),
    "first frame of another trial": (c3d(AB, first=7, start=72210), AB, 7, {}),
    "moments and angles": (
        c3d([*AB, "HipMoment", "HipAngles"], 4,
            groups={"MOMENTS": ["HipMoment"], "ANGLES": ["HipAngles"]}),
        AB, 1, {"skipped_model_outputs": 2},
    ),
    "forces, powers and scalars of a subject": (
        c3d([*AB, "Arm:F", "Arm:P", "Arm:S"], 5,
            groups={"FORCES": ["F"], "POWERS": ["Arm:P"], "SCALARS2": ["S"]}),
        AB, 1, {"skipped_model_outputs": 3},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", C3DS)
def test_a_c3d_of_another_program_is_read(tmp_path, name):
    content, markers, first, counts = C3DS[name]
    (tmp_path / "t.c3d").write_bytes(content)
    take = read_c3d(tmp_path / "t.c3d")
    assert list(take.markers) == markers and take.frame[0] == first
    assert {key: take.counts[key] for key in counts} == counts
    skipped = {key for key in take.counts if key.startswith("skipped_")} - {"skipped_frames"}
    assert skipped == set(counts)
    assert f"first frame {first};" in seen(tmp_path / "t.c3d")
    np.testing.assert_allclose(take.markers[markers[1]][2], [0.202, 0.2, 0.3], rtol=1e-6)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (c3d(AB, processor=86), "big-endian MIPS"),
        (c3d(AB, groups={"ANGLES": AB}), "all 2 points are outputs of a model"),
        (c3d(AB)[:-20], "truncated"),
    ],
)
def test_a_c3d_that_is_not_read_says_what_to_do(tmp_path, content, words):
    (tmp_path / "t.c3d").write_bytes(content)
    assert words in seen(tmp_path / "t.c3d")


def test_a_name_in_latin_1_is_no_damage(tmp_path):
    file = Path(os.fsdecode(os.fsencode(tmp_path) + b"/Messung_\xfcber.c3d"))
    file.write_bytes(c3d(AB))
    assert list(read_c3d(file).markers) == AB
    assert "markers Arm:a, Arm:b" in seen(file) and "Messung_" in seen(file)


LINKS = '<link name="base"/><link name="upper"/><link name="{0}"/><link name="jaw"/>'
JOINT = (
    '<joint name="{}" type="revolute"><origin xyz="0 0 {}"/><parent link="{}"/><child link="{}"/>'
    '<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
)


def shared_name_urdf(joint: str, link: str) -> str:
    joints = JOINT.format("shoulder", 0.1, "base", "upper") + JOINT.format(
        "elbow", 0.2, "upper", link
    )
    joints += JOINT.format(joint, 0.3, link, "jaw")
    end = '<link name="tip"/><joint name="tip" type="fixed"><origin xyz="0 0 0.4"/>'
    end += '<parent link="jaw"/><child link="tip"/></joint>'
    return f'<robot name="r">{LINKS.format(link)}{joints}{end}</robot>'


@pytest.mark.parametrize("link", ["wrist", "elbow", "universe", "hand"])
@pytest.mark.parametrize("held", [False, True])
def test_the_tip_is_where_forward_kinematics_puts_it_whatever_names_are_shared(
    tmp_path, link, held
):
    (tmp_path / "r.urdf").write_text(shared_name_urdf("wrist", link))
    joints = ["shoulder", "elbow"] if held else ["shoulder", "elbow", "wrist"]
    locked = {"wrist": 0.4} if held else {}
    chain = chain_of(Robot(str(tmp_path / "r.urdf"), joints, "tip", locked=locked, task=["x", "z"]))
    q = np.array([0.3, -0.7, 0.4])
    a, b, c = np.cumsum(q)
    expected = [
        0.2 * np.sin(a) + 0.3 * np.sin(b) + 0.4 * np.sin(c),
        0,
        0.1 + 0.2 * np.cos(a) + 0.3 * np.cos(b) + 0.4 * np.cos(c),
    ]
    np.testing.assert_allclose(chain.pose(q[None, : len(joints)])[0, :3], expected, atol=1e-12)
    assert "joints revolute (shoulder, elbow, wrist)" in seen(tmp_path / "r.urdf")


PLAIN = shared_name_urdf("wrist", "hand")
XACRO = "a xacro: expand it with xacro r.urdf > arm.urdf"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLAIN.replace('lower="-2"', 'lower="${-pi}"'), XACRO),
        (PLAIN.replace('xyz="0 0 0.1"', 'xyz="0 0 ${h}"'), XACRO),
        (PLAIN.replace("<link", '<xacro:property name="a" value="1"/><link', 1)
         .replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"', 1), XACRO),
        (PLAIN.replace('lower="-2"', 'lower="two"', 1), "the joint shoulder has 'two' as lower"),
        (PLAIN.replace('type="fixed"', 'type="welded"'), "the joint tip is of the type 'welded'"),
        (PLAIN.replace('name="upper"', 'name="jaw"', 1), "two links are named 'jaw'"),
        (PLAIN[:-30], "this is no URDF"),
    ],
)  # fmt: skip
def test_what_is_no_urdf_says_so_in_one_message(tmp_path, capfd, text, words):
    (tmp_path / "r.urdf").write_text(text)
    assert words in seen(tmp_path / "r.urdf")
    assert capfd.readouterr() == ("", "")  # nothing of Pinocchio's
    with pytest.raises(PipelineError):
        chain_of(Robot(str(tmp_path / "r.urdf"), ["shoulder", "elbow"], "tip", task=["x", "z"]))


def test_a_urdf_that_xacro_expanded_is_read(tmp_path):
    expanded = PLAIN.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"', 1)
    (tmp_path / "r.urdf").write_text(expanded)
    assert "!" not in seen(tmp_path / "r.urdf")


def written(folder: Path, case: str, name: str) -> Path:
    """The file of a case, which its make.py writes where it is not there."""
    place = next(iter(CASES.glob(f"{case}-*")), None)
    if place is None:
        pytest.skip("../shared/cases is absent: it lies beside the project")
    if not (place / name).exists():
        script = folder / "make.py"
        script.write_bytes((place / "make.py").read_bytes())
        runpy.run_path(str(script), run_name="__main__")
        return folder / name
    return place / name


ONE_EACH = {  # case, file: what inspect says of it
    ("01", "arm.urdf"): "joints revolute (shoulder, elbow, wrist)",
    ("04", "control.c3d"): "markers Arm:a, Arm:b; steps 4; first frame 1",
    ("04", "first_frame_0.c3d"): "markers Arm:a, Arm:b; steps 4; first frame 0",
    ("04", "labels_padded_with_blanks.c3d"): "3 skipped labels",
    ("04", "labels_with_further_names.c3d"): "1 skipped labels",
    ("05", "nexus_moments.c3d"): "2 skipped model outputs",
    ("11", "arm.urdf.xacro"): "a xacro: expand it with xacro arm.urdf.xacro > arm.urdf",
    ("11", "unexpanded_limits.urdf"): "a xacro: expand it",
    ("11", "axis_of_length_two.urdf"): "joints revolute (j1, j2)",
    ("11", "inf_limits.urdf"): "joints revolute (j1, j2)",
    ("11", "meshes_package.urdf"): "joints continuous (j1), revolute (j2)",
    ("11", "mimic_and_gazebo.urdf"): "prismatic (g1, g2)",
    ("12", "control.csv"): "bodies Arm; markers Arm:Marker 001, Arm:Marker 002",
    ("12", "timecode.csv"): "bodies Arm; markers Arm:Marker 001, Arm:Marker 002",
    ("12", "euler_xyz.csv"): "bodies Arm; markers Arm:Marker 001, Arm:Marker 002",
    ("12", "frame_twice.csv"): "1 repeated rows",
    ("12", "semicolon_comma.csv"): "cells are separated by semicolons",
    ("12", "frame_back.csv"): "the frame number does not increase",
    ("12", "inches.csv"): "Length Units are 'Inches'",
    ("12", "euler_keys_stripped.csv"): "export the take with quaternions",
    ("14", "control.pcd"): "points 20; organised 5 × 4",
    ("14", "kinect_by_pcl.pcd"): "turned by 180° about 1 0 0, not applied",
    ("16", "no_line_end.pcd"): "points 3",
}


@pytest.mark.parametrize(("case", "name"), ONE_EACH)
def test_a_file_of_the_cases_is_read_as_its_readme_says(tmp_path, case, name):
    words = seen(written(tmp_path, case, name))
    assert ONE_EACH[case, name] in words
    assert ("!" in words) == any(
        stop in ONE_EACH[case, name]
        for stop in ("xacro", "separated", "increase", "Inches", "quaternions")
    )


@pytest.mark.parametrize("folder", ["kinect", "motive"])
def test_no_sample_of_a_real_instrument_is_unknown(folder):
    place = CASES.parent / "samples" / folder
    if not place.exists():
        pytest.skip("../shared/samples is absent: it lies beside the project")
    findings = inspect(place)
    assert len(findings) == len(list(place.iterdir()))
    assert {finding.kind for finding in findings} <= {"motion", "image", "cloud", "intrinsics"}
    stopped = {finding.file.name for finding in findings if finding.stops}
    assert stopped <= {"motive_v1.23_empty.csv"}
