"""Takes of motion capture and the commanded trajectory as tables, in every form, or refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from marker_takes import PLACES, marker_places
from motive_files import START
from numpy.testing import assert_allclose
from sample_options import made
from scipy.spatial.transform import Rotation
from space_arms import LWR4, UR5, YOUBOT, motion

from pipeline.arm.model import arm_of, chain_of
from pipeline.core.columns import members, spread, values
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Body, Dataset, Mocap, Motion, Pose
from pipeline.formats.motion.motive import write_motive
from pipeline.formats.motion.take import MotionTake, RigidBody
from pipeline.formats.trajectory import write_trajectory
from pipeline.perception.markers import JointTrack, track
from pipeline.perception.posture import points_in_plane
from pipeline.recordings.motion_capture import find_takes, marker_rows, trajectory_rows

cases = cases_beside(__file__)
STEPS = 40
ARM = arm_of(YOUBOT)
JOINTS = np.linspace([1.6, -4.8, 2.0], [2.2, -4.2, 2.6], STEPS + 1)
TEMPLATE = {
    f"link{j}": {f"{name}{j}": at for name, at in zip("abc", link, strict=True)}
    for j, link in enumerate(PLACES.tolist(), 1)
}
BASE = Pose([0.4, 0.3, -0.2], [-np.pi / 2, 0.0, 0.0])
MOUNT = Pose([0.01, -0.05, 0.06], [0.3, -0.2, 1.1])
STATED = {
    "training": "*.csv",
    "base": BASE,
    "markers": TEMPLATE,
    "gate": 0.012,
    "max_gap": 20,
}


def dataset(**mocap) -> Dataset:
    return made(Dataset, motion=Motion(100.0, STEPS), mocap=Mocap(**STATED | mocap))


def carried(template: np.ndarray) -> np.ndarray:
    """(N, 3, K, 3) m in the world, where the arm carries the points at ``template`` (3, K, 3)."""
    turn = Rotation.from_euler("xyz", BASE.rpy).as_matrix()
    in_base = ARM.to_base(marker_places(JOINTS, template, ARM.chain))
    return in_base @ turn.T + BASE.position


def markers_of() -> dict[str, np.ndarray]:
    """Positions (N, 3) in m of the markers of TEMPLATE by their names."""
    positions = carried(PLACES)
    markers = {}
    for number, link in enumerate(TEMPLATE.values()):
        for k, name in enumerate(link):
            markers[name] = positions[:, number, k]
    return markers


def bodies_of() -> dict[str, RigidBody]:
    """Bodies B1 to B3, each mounted to its link by MOUNT, in poses made of four points of the
    segment that MOUNT's axes lead to.
    """
    axes = Rotation.from_euler("xyz", MOUNT.rpy).as_matrix().T
    tips = np.vstack([np.zeros(3), axes]) + MOUNT.position
    links = carried(np.tile(tips, (3, 1, 1))).swapaxes(0, 1)

    bodies = {}
    for name, link in zip(("B1", "B2", "B3"), links, strict=True):
        position = link[:, 0]
        axes = link[:, 1:] - link[:, :1]
        rotation = Rotation.from_matrix(axes.swapaxes(1, 2))
        bodies[name] = RigidBody(position, rotation.as_quat())
    return bodies


def written(
    folder: Path,
    markers: dict,
    bodies: dict | None = None,
    first=0,
    rate=100.0,
) -> Path:
    """Motive's file t.csv of a take: of its ``rate`` in Hz, from the frame ``first`` on."""
    frame = first + np.arange(STEPS + 1)
    take = MotionTake(
        "t",
        "1.23",
        rate,
        frame,
        (frame - first) / rate,
        markers,
        bodies or {},
        {},
    )
    write_motive(folder / "t.csv", take, start=START)
    return folder / "t.csv"


def tracked(rows: pd.DataFrame) -> JointTrack:
    labelled = rows[rows.link > 0].sort_values(["link", "marker", "k"], kind="stable")
    by_marker = labelled[["x", "y", "z"]].to_numpy().reshape(9, STEPS + 1, 3)
    positions = by_marker.transpose(1, 0, 2)
    return track(positions, points_in_plane(ARM, PLACES, 0.012), max_gap=20)


def read(file: Path, part: str = "training", **mocap):
    """Rows of the take in ``file``, and a function of its quality."""
    rows, quality = marker_rows("t", file, part, dataset(**mocap))
    return rows, {row["quantity"]: row["value"] for row in quality}.__getitem__


def require_angles(rows: pd.DataFrame) -> None:
    assert_allclose(tracked(rows).q, JOINTS, rtol=0, atol=5e-5)


def test_markers_and_bodies_give_back_the_joints_that_carried_them(tmp_path):
    rows, count = read(written(tmp_path, markers_of(), first=72210))
    require_angles(rows)
    assert count("missing_samples") == count("unlabelled_markers") == 0

    bodies = {link: Body(f"B{j}", MOUNT) for j, link in enumerate(TEMPLATE, 1)}
    rows, _ = read(written(tmp_path, {}, bodies_of()), bodies=bodies)
    require_angles(rows)
    assert np.nanmax(tracked(rows).residual) < 1e-5

    # the control: the same bodies, taken to be mounted otherwise
    mount = Pose(MOUNT.position, [0.3, -0.1, 1.1])
    remounted = {link: Body(body.name, mount) for link, body in bodies.items()}
    rows, _ = read(tmp_path / "t.csv", bodies=remounted)
    assert np.abs(tracked(rows).q - JOINTS).max() > 0.01


def test_bodies_and_markers_mix_link_by_link_and_lost_poses_are_missing_markers(
    tmp_path,
):
    bodies = bodies_of()
    markers = markers_of()
    bodies["B2"].position[5:8] = bodies["B2"].quaternion[5:8] = np.nan
    bodies["B2"].quaternion[20:] *= -1  # the same rotations
    on_others = {n: points for n, points in markers.items() if not n.endswith("2")}
    file = written(tmp_path, on_others | {"stray": markers["a2"]}, bodies)

    rows, count = read(file, "test", bodies={"link2": Body("B2", MOUNT)})

    require_angles(rows)
    assert (count("missing_samples"), count("unlabelled_markers")) == (9, 0)
    assert count("missing_poses") == 3


def test_names_stand_without_their_asset_unless_two_assets_share_them(tmp_path):
    markers = {f"Arm:{name}": points for name, points in markers_of().items()}
    require_angles(read(written(tmp_path, markers))[0])
    file = written(tmp_path, markers | {"Leg:a1": markers["Arm:a1"] + 1})
    with pytest.raises(RecordingError, match="'a1' may be Arm:a1 or Leg:a1"):
        read(file)

    first = {"Arm:a1": TEMPLATE["link1"]["a1"]} | TEMPLATE["link1"]
    del first["a1"]
    rows, count = read(file, markers=TEMPLATE | {"link1": first})

    require_angles(rows)
    assert count("unlabelled_markers") == 1


def test_a_body_that_the_take_lacks_or_that_has_no_link_is_named(tmp_path):
    file = written(tmp_path, markers_of(), bodies_of())
    words = "no rigid body named X in the take; it has B1, B2, B3"

    with pytest.raises(RecordingError, match=words):
        read(file, bodies={"link1": Body("X", MOUNT)})
    with pytest.raises(ConfigError, match="no link arm; there are link1, link2, link3"):
        read(file, bodies={"arm": Body("B1", MOUNT)})
    absent = {"x8": [0.0, 0.0, 0.0], "x9": [0.0, 0.0, 0.0]}
    words = "no marker named x8, x9 in the take; it has a1, a2"
    with pytest.raises(RecordingError, match=words):
        read(file, markers=TEMPLATE | {"link1": absent})


# cm for m, m for cm, inches for cm
@pytest.mark.parametrize("size", [100, 0.01, 1 / 2.54])
def test_takes_in_another_unit_are_refused(tmp_path, size):
    markers = {name: size * xyz for name, xyz in markers_of().items()}
    words = f"{size:.3g} times as far apart as in the"
    with pytest.raises(RecordingError, match=words):
        read(written(tmp_path, markers))


def test_takes_of_another_rate_or_length_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="at 120"):
        read(written(tmp_path, markers_of(), rate=120.0))

    file = written(tmp_path, markers_of())
    *lines, _ = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines))
    with pytest.raises(RecordingError, match=r"spans 40 frames .* the motion has 41"):
        read(file)


def test_a_file_of_no_format_is_refused(tmp_path):
    file = tmp_path / "walk.own"
    file.write_text("OWN\n1 2 3\n4 5 6\n")
    words = "no take of motion capture in C3D or Motive CSV"
    with pytest.raises(RecordingError, match=words):
        read(file)


@pytest.fixture
def takes(tmp_path) -> Path:
    """A folder of empty takes."""
    for name in ("train_1.csv", "train_2.c3d", "test_1.csv"):
        (tmp_path / name).touch()
    return tmp_path


def test_takes_are_found_by_part(takes):
    result = find_takes(takes, dataset(training="train_*", test="test_*").mocap)
    assert [(name, file.name, part) for name, file, part in result] == [
        ("train_1", "train_1.csv", "training"),
        ("train_2", "train_2.c3d", "training"),
        ("test_1", "test_1.csv", "test"),
    ]


@cases("refused patterns")
def test_patterns_that_name_no_take_or_one_twice_are_refused(takes, patterns, words):
    (takes / "train_1.c3d").touch()
    with pytest.raises((ConfigError, RecordingError), match=words):
        find_takes(takes, dataset(**patterns).mocap)


def test_a_name_that_is_not_utf_8_is_refused(takes):
    (takes / "test_1.csv").rename(takes / "t\udce9.csv")
    with pytest.raises(RecordingError, match="is not UTF-8"):
        find_takes(takes, dataset(training="t*.csv").mocap)


def test_a_link_to_nowhere_is_a_take_that_its_reader_names(takes):
    (takes / "link_1.csv").symlink_to("nowhere")
    assert len(find_takes(takes, dataset(training="link_*").mocap)) == 1


GRID = 30
TIME = np.arange(GRID + 1) / 100


@pytest.fixture
def file(tmp_path):
    table = pd.DataFrame({"t": TIME} | spread("q", UR5.joints, motion(GRID + 1)))
    write_trajectory(tmp_path / "t.csv", table)
    return tmp_path / "t.csv"


def test_angles_in_degrees_are_beyond_the_speed_of_the_arm(file):
    degrees = spread("q", UR5.joints, np.degrees(motion(GRID + 1)) / 9)
    write_trajectory(file, pd.DataFrame({"t": TIME} | degrees))
    with pytest.raises(RecordingError, match="check the unit of this joint"):
        trajectory_rows(file, commanded())


def commanded(robot=UR5, rate: float = 100.0) -> Dataset:
    return made(Dataset, robot=robot, motion=Motion(rate, GRID))


def test_the_steps_take_the_arm_from_each_commanded_pose_to_the_next(file):
    table = trajectory_rows(file, commanded())
    chain = chain_of(UR5)
    q = motion(GRID + 1)
    steps = chain.displacement(chain.pose(q[:-1]), chain.pose(q[1:]))

    assert_allclose(values(table, "v")[:-1] / 100, steps, atol=1e-12)
    assert members(table, "x") == chain.task and members(table, "u") == ()

    # an arm of more joints than rows is told its joints too
    table = trajectory_rows(file, commanded(replace(UR5, task=["x", "y", "z"])))
    assert values(table, "v").shape == (GRID + 1, 3)
    assert_allclose(
        values(table, "u")[:-1] / 100,
        np.diff(q, axis=0),
        atol=1e-12,
    )


@pytest.mark.parametrize(
    ("robot", "rate", "words"),
    [
        (LWR4, 100.0, "the trajectory has the joints joint_1"),
        (UR5, 50.0, "31 in 0.600000 s, at 50 per second"),
    ],
)
def test_another_arms_or_another_grids_trajectory_is_refused(file, robot, rate, words):
    with pytest.raises(RecordingError, match=words):
        trajectory_rows(file, commanded(robot, rate))


@pytest.mark.parametrize(("rate", "fits"), [(120.0, True), (121.0, False)])
def test_a_step_that_is_rounded_to_microseconds_has_the_rate_of_the_motion(
    tmp_path,
    rate,
    fits,
):
    q = motion(GRID + 1) / 2
    rounded = np.round(np.arange(GRID + 1) / 120, 6)
    file = tmp_path / "rounded.csv"
    write_trajectory(file, pd.DataFrame({"t": rounded} | spread("q", UR5.joints, q)))
    if fits:
        assert len(trajectory_rows(file, commanded(rate=rate))) == GRID + 1
        return

    with pytest.raises(RecordingError, match=r"in 0\.250000 s; .* at 121 per second"):
        trajectory_rows(file, commanded(rate=rate))
