"""Files as other programs write them, each read right or refused by its name: small ones written
here, and, where they are beside the project, the public cases that they stand for.
"""

import runpy
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import joint_kinds
import numpy as np
import other_kinds
import pandas as pd
import pytest
from kinds import CASES, kind
from numpy.testing import assert_allclose
from scipy.io import savemat
from written_logs import seen

from pipeline.arm.model import chain_of
from pipeline.core.options.dataset import Robot
from pipeline.core.typed_yaml import read_yaml

TIME = np.arange(60) / 125
Q = np.stack([np.sin(3 * TIME), 0.2 + 0.5 * TIME**2], axis=1)
ECHO = "".join(f"{k / 125},elbow,{k % 7}.5,0.{k}\n" for k in range(60))


def urdf(link: str) -> str:
    """An arm whose joint ``wrist`` moves the link after ``link``."""
    links, kinds = ["base", "upper", link, "jaw", "tip"], ["revolute"] * 3 + ["fixed"]
    joints = [
        other_kinds.joint(name, *links[k : k + 2], kind=kinds[k], height=(k + 1) / 10)
        for k, name in enumerate(("shoulder", "elbow", "wrist", "tool"))
    ]
    return '<?xml version="1.0"?>\n' + other_kinds.urdf(links, joints)


PAIRED = {"time": TIME, "q": Q, "q_target": Q}
BOTH = ("joints 2", "signals actual, target")


def columns() -> pd.DataFrame:
    """The signals of PAIRED, one column for each joint."""
    signals = {name: PAIRED[name] for name in ("q", "q_target")}
    return pd.DataFrame(
        {f"{name}_{j}": q[:, j] for name, q in signals.items() for j in (0, 1)},
    )


def write_objects(file: Path) -> None:
    np.savez(file, **PAIRED, about=np.array([{}], object))


def write_lists(file: Path) -> None:
    lists = {name: [*values] for name, values in PAIRED.items()}
    pd.DataFrame(lists).to_parquet(file)


def write_one_column(file: Path) -> None:
    file.write_text("".join(f"{angle}\n" for angle in Q[:, 0]))


WRITTEN = {  # file: what writes it, what inspect says of it
    "v4.mat": (partial(savemat, mdict=PAIRED, format="4"), BOTH),
    "struct.mat": (
        partial(savemat, mdict={"rec": PAIRED}),
        ("0.472 s; samples 60", *BOTH),
    ),
    "objects.npz": (write_objects, BOTH),
    "index.parquet": (
        columns().set_index(TIME).rename_axis("t").to_parquet,
        BOTH,
    ),
    "lists.parquet": (write_lists, BOTH),
    "echo.csv": (ECHO, ("columns without numbers 1 (words)",)),
    "one.txt": (write_one_column, ("the table has one column: for one",)),
    "bom.urdf": (
        "\ufeff" + urdf("hand"),
        ("joints revolute (shoulder, elbow, wrist)",),
    ),
    "floating.urdf": (
        urdf("a").replace("revolute", "floating", 1),
        ("joints floating (sh",),
    ),
}
TEXTS = read_yaml(Path(__file__).with_name("unusual_files.yaml"))


def place_of(number: str, folder: Path) -> Path:
    """The folder of a public case, its files made in ``folder`` if it has a make.py."""
    place = next(iter(CASES.glob(f"{number}-*")), None)
    if place is None:
        pytest.skip(f"../shared/cases is absent at {CASES}: it lies beside the project")
    if not (place / "make.py").is_file():
        return place
    shutil.copyfile(place / "make.py", folder / "make.py")
    arguments = sys.argv
    sys.argv = ["make.py", str(folder)]
    try:
        runpy.run_path(str(folder / "make.py"), run_name="__main__")
    finally:
        sys.argv = arguments
    return folder


PAIR = "signals actual (q_0, q_1), target (q_target_0, q_target_1)"
PUBLIC = {  # case, file: what inspect says of it
    ("06", "actual_wraps/run.csv"): "16 unwrapped jumps",
    ("08", "gripper_on_the_same_topic"): "60 messages of other joints",
    ("08", "order_of_joints_changes"): "samples 59; joints 2; signals actual, target",
    ("08", "same_stamp_other_values"): "the time does not increase",
    ("08", "without_stamps"): "the message has no time in its header",
    ("01", "arm.urdf"): "joints revolute (shoulder, elbow, wrist)",
    ("11", "arm.urdf.xacro"): "a xacro: expand it with xacro arm.urdf.xacro > arm.urdf",
    ("11", "unexpanded_limits.urdf"): "a xacro: expand it",
    ("11", "meshes_package.urdf"): "joints continuous (j1), revolute (j2)",
    ("11", "mimic_and_gazebo.urdf"): "prismatic (g1, g2)",
    ("12", "euler_xyz.csv"): "bodies Arm; markers Arm:Marker 001, Arm:Marker 002",
    ("12", "semicolon_comma.csv"): "cells are separated by semicolons",
    ("12", "inches.csv"): "'Inches' by Length Units",
    ("12", "euler_keys_stripped.csv"): "export the take with quaternions",
}


REFUSED = (  # files of PUBLIC that are refused
    "same_stamp_other_values",
    "without_stamps",
    "arm.urdf.xacro",
    "unexpanded_limits.urdf",
    "semicolon_comma.csv",
    "inches.csv",
    "euler_keys_stripped.csv",
)


def writes(name: str, content: object) -> Callable[[Path], object]:
    """A function that writes the file ``name`` of the ``content``, or calls it with the file."""
    call = (
        content
        if callable(content)
        else partial(Path.write_text, data=content, newline="")
    )
    return lambda folder: call(folder / name)


KINDS = [*joint_kinds.KINDS, *other_kinds.KINDS]
for name, (content, words) in WRITTEN.items():
    KINDS.append(kind("program", writes(name, content), *words))
for name, text in TEXTS.items():
    make = writes(name, text["content"])
    KINDS.append(kind("program", make, text["says"], stops=text["stops"]))
for (number, name), words in PUBLIC.items():
    stops = name in REFUSED
    KINDS.append(kind(number, None, words, at=name, stops=stops))
SLOW = ("06", "35")  # cases that take seconds
ROWS = []
for case in KINDS:
    marks = [pytest.mark.slow] if case.number in SLOW else []
    for public in (False, True):
        if case.public if public else case.make:
            kind_of_file = "case " if public else ""
            name = f"{kind_of_file}{case.number} {case.says[0][:30]}"
            ROWS.append(pytest.param(case, public, id=name.strip(), marks=marks))


@pytest.mark.parametrize(("case", "public"), ROWS)
def test_a_file_is_read_or_refused_as_its_kind_says(tmp_path, case, public):
    folder = tmp_path
    if public:
        folder = place_of(case.number, tmp_path)
    else:
        case.make(tmp_path)
    said = seen(folder / case.place)
    assert [words for words in case.says if words not in said] == [], said
    assert [words for words in case.never if words in said] == [], said
    assert ("! " in said) == case.stops, said


def test_numbered_files_of_two_robots_are_two_findings_and_copies_are_one(tmp_path):
    texts = urdf("hand"), urdf("hand"), urdf("hand").replace("elbow", "knee")
    for number, text in enumerate(texts, start=1):
        (tmp_path / f"arm_{number}.urdf").write_text(text)
    findings = seen(tmp_path)
    assert "arm_*.urdf (2): URDF" in findings and "(shoulder, elbow" in findings
    assert "arm_3.urdf: URDF" in findings and "(shoulder, knee" in findings


@pytest.mark.parametrize("link", ["wrist", "elbow", "universe", "hand"])
@pytest.mark.parametrize("locked", [{}, {"wrist": 0.4}])
def test_the_tip_is_where_forward_kinematics_puts_it_whatever_names_are_shared(
    tmp_path,
    link,
    locked,
):
    file = tmp_path / "r.urdf"
    file.write_text(urdf(link))
    joints = [joint for joint in ("shoulder", "elbow", "wrist") if joint not in locked]
    chain = chain_of(Robot(str(file), joints, "tip", locked=locked, task=["x", "z"]))
    q, lengths = np.array([0.3, -0.7, 0.4]), np.array([0.2, 0.3, 0.4])
    turned = np.cumsum(q)
    x, z = lengths @ np.sin(turned), 0.1 + lengths @ np.cos(turned)
    assert_allclose(chain.pose(q[None, : len(joints)])[0, :3], [x, 0, z], atol=1e-12)
    assert "joints revolute (shoulder, elbow, wrist)" in seen(file)
