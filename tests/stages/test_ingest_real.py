"""From the raw logs of real arms of six and of seven joints to the tables and the process noise:
what is left is the arm's.
"""

from pathlib import Path

import numpy as np
import pytest
from joint_logs import ROOT, ingested, quality
from numpy.testing import assert_allclose, assert_array_equal
from omegaconf import OmegaConf
from planar_poses import load_arm

from pipeline.configuration import datasheet
from pipeline.core import contracts
from pipeline.core.columns import members, values
from pipeline.stages import ingest, track


def recordings(dataset: str) -> Path:
    folder = ROOT / OmegaConf.load(datasheet.path_of(dataset)).recordings
    if not folder.is_dir():
        pytest.skip(f"the recordings of {dataset} are not at {folder}")
    return folder.resolve()


@pytest.fixture(scope="session")
def ur5() -> Path:
    return recordings("ur5")


@pytest.fixture(scope="session")
def lwr4() -> Path:
    return recordings("lwr4")


def spread_of(noise: np.ndarray) -> np.ndarray:
    """(n,) rad, standard deviation over the takes of ``noise`` (takes, M, n) over all its steps."""
    takes = len(noise)
    varying = (noise - noise.mean(axis=0)) * np.sqrt(takes / (takes - 1))
    return np.sqrt(np.mean(varying**2, axis=(0, 1)))


def process_noise(
    log_project,
    dataset: str,
    ur5: Path,
) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of the takes, joint angles and process noise by the stages."""
    log_project(dataset, ur5)
    ingest.run("motion")
    track.run()
    joints = contracts.read("joints", Path("data/track"))
    assert set(joints["part"]) == {"training"}
    _, w = contracts.stacked(contracts.read("process_noise", Path("data/track")), "w")
    return *contracts.stacked(joints, "q"), w


@pytest.mark.parametrize(
    ("dataset", "steps", "cut_off", "others"),
    [("ur5_planar", 372, 1, 3), ("ur5_rounds", 361, 0, 20)],
)
def test_the_real_logs_go_from_raw_files_to_process_noise(
    ur5,
    log_project,
    dataset,
    steps,
    cut_off,
    others,
):
    names, q, w = process_noise(log_project, dataset, ur5)
    assert q.shape == (4, steps + 1, 3) and len(set(names)) == 4
    assert quality("excursions_cut_off", "Movement") == cut_off
    assert quality("excursions_other_motion", "Movement") == others
    assert all(0 < quality("command_deviation", take) < 1.3e-4 for take in names)
    assert all(0.3e-3 < quality("lag_behind_command", take) < 1.0e-3 for take in names)

    trajectory = contracts.read("trajectory", Path("data/ingest/motion"))
    velocity = values(trajectory, "v")[:-1]
    pose = values(trajectory, "x")
    still = ~velocity.any(axis=1)

    assert still[:34].all() and still[-35:].all() and not still[34:-35].any()
    assert_allclose(np.diff(pose, axis=0), velocity / 125, atol=1e-12)

    joints = ["joint_2", "joint_3", "joint_4"]
    chain = load_arm("pipeline/arm/ur5.urdf", joints, "wrist_centre", {}).chain
    assert_allclose(chain.coordinates(q.mean(axis=0)), pose, atol=2e-3)
    # as was found on this and other movements of the robot: at most 24 µrad at rest, 43 to 145 µrad
    # moving
    assert np.all(spread_of(w[:, still]) < 24e-6)
    moving = spread_of(w[:, ~still])
    assert np.all(moving > 40e-6) and np.all(moving < 145e-6)

    # a position-controlled arm does not wander: what one step adds the next takes back
    varying = (w - w.mean(axis=0))[:, ~still]
    recoil = np.sum(varying[:, 1:] * varying[:, :-1], axis=(0, 1)) / np.sum(
        varying**2,
        axis=(0, 1),
    )
    assert np.all(recoil < -0.3)


def test_all_six_joints_and_the_pose_in_space(ur5, log_project):
    log_project("ur5_rounds", ur5)
    ingest.run("motion")
    names, planar = ingested()
    result, q, w = process_noise(log_project, "ur5", ur5)

    # the same motion as the three joints' alone, to the row
    assert result == names and q.shape == (4, 362, 6)
    assert_array_equal(q[..., 1:4], planar)

    trajectory = contracts.read("trajectory", Path("data/ingest/motion"))
    assert members(trajectory, "v") == ("x", "y", "z", "rx", "ry", "rz")
    assert not members(trajectory, "u")  # as many joints as rows
    # joint 1 is at rest, the others move: as was found on this and other movements of the robot
    spread = spread_of(w)
    assert spread[0] < 24e-6 and np.all((spread[1:] > 40e-6) & (spread[1:] < 145e-6))


TAKES = [f"measurements_{file}_{number}" for file in (1, 2) for number in (1, 2)]


def test_the_logs_of_seven_joints_go_from_raw_files_to_process_noise(lwr4, log_project):
    log_project("lwr4", lwr4)
    ingest.run("motion")
    names, q = ingested()

    assert names == TAKES and q.shape == (4, 1101, 7)
    # the second repetition starts between two rows, and its command is the same to a nanoradian
    assert all(quality("command_deviation", take) < 1e-9 for take in names)

    # what is left of the delays is the arm's: as was found on these recordings, 0.4 and 2.1 ms
    lags = [1e3 * quality("lag_behind_command", take) for take in names]
    assert_allclose(lags, [0.4, 0.4, 2.1, 2.1], atol=0.15)
    assert quality("uneven_rows", "measurements") == 19

    trajectory = contracts.read("trajectory", Path("data/ingest/motion"))
    speeds = values(trajectory, "u")[:-1]
    assert_allclose(speeds, np.diff(q.mean(axis=0), axis=0) * 200, atol=0.02)
    assert len(members(trajectory, "v")) == 6
    resampled = [quality("resampled_rows", take) for take in names]
    assert resampled == [0, 1101, 0, 1101]

    track.run()
    _, w = contracts.stacked(contracts.read("process_noise", Path("data/track")), "w")
    spread = spread_of(w)
    assert np.all(spread > 3e-6) and np.all(spread < 15e-6)
