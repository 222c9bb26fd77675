"""Files as other programs write them, each read right or refused by its name: small ones written
here, and, where they are beside the project, the public cases that they stand for.
"""

import runpy
import shutil
import sys
from pathlib import Path

import joint_kinds
import numpy as np
import other_kinds
import pytest
from numpy.testing import assert_allclose
from written_logs import seen

from pipeline.arm.model import chain_of
from pipeline.core.options.dataset import Robot

CASES = Path(__file__).parents[3] / "shared/cases"  # public cases beside the project
SLOW = ("06", "35")  # cases that take seconds


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


ROWS = []
for kind in [*joint_kinds.KINDS, *other_kinds.KINDS]:
    marks = [pytest.mark.slow] if kind.number in SLOW else []
    name = f"{kind.number} {kind.says[0][:30]}"
    if kind.make:
        ROWS.append(pytest.param(kind, False, id=name, marks=marks))
    if kind.public:
        ROWS.append(pytest.param(kind, True, id=f"case {name}", marks=marks))


@pytest.mark.parametrize(("kind", "public"), ROWS)
def test_a_file_is_read_or_refused_as_its_kind_says(tmp_path, kind, public):
    folder = tmp_path
    if public:
        folder = place_of(kind.number, tmp_path)
    else:
        kind.make(tmp_path)

    said = seen(folder / kind.place)

    assert [words for words in kind.says if words not in said] == [], said
    assert [words for words in kind.never if words in said] == [], said
    assert ("! " in said) == kind.stops, said


def test_numbered_files_of_two_robots_are_two_findings_and_copies_are_one(tmp_path):
    arm = other_kinds.planar_arm()
    for number, text in enumerate([arm, arm, arm.replace("elbow", "knee")], start=1):
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
    file.write_text(other_kinds.planar_arm(link))
    joints = [joint for joint in ("shoulder", "elbow", "wrist") if joint not in locked]
    robot = Robot(str(file), joints, "tip", locked=locked, task=["x", "z"])
    q = np.array([0.3, -0.7, 0.4])
    lengths = np.array([0.2, 0.3, 0.4])

    tip = chain_of(robot).pose(q[None, : len(joints)])[0, :3]

    turned = np.cumsum(q)
    x = lengths @ np.sin(turned)
    z = 0.1 + lengths @ np.cos(turned)
    assert_allclose(tip, [x, 0, z], atol=1e-12)
    assert "joints revolute (shoulder, elbow, wrist)" in seen(file)
