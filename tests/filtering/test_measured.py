"""What the test takes are filtered by: readings of encoders, and poses of the tip with the noise
that their points make.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from space_arms import LWR4, link_poses, points

from pipeline.core import contracts
from pipeline.core.columns import spread
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Dataset, Motion
from pipeline.core.options.instruments import Encoders, Mocap, Pose
from pipeline.filtering.measured import MOTION, TRACK, measured_takes, tip_poses

HAND = {
    "a": [0.08, 0.0, 0.01],
    "b": [-0.01, 0.085, 0.015],
    "c": [-0.075, -0.035, 0.01],
    "d": [0.01, -0.08, 0.035],
}
MOCAP = Mocap(
    training="*",
    base=Pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    markers={"link_5": {"x": [0.0, 0.1, 0.1]}, "flange": HAND},
    gate=0.01,
    deviation=1e-3,
    max_gap=20,
)
DATASET = Dataset(
    name="t",
    recordings=".",
    robot=LWR4,
    mocap=MOCAP,
    encoders=Encoders(training="*", test="*", actual=[]),
    motion=Motion(rate=100.0, steps=4),
    measurement="tip",
)


def rows(q: np.ndarray, take: str = "test_1", noise: np.ndarray | float = 0.0) -> pd.DataFrame:
    """Of the table ``markers``."""
    places = points(LWR4, MOCAP.markers, q) + noise
    k = np.arange(len(q))
    names = [(1, 1), *((2, number) for number in range(1, 5))]
    each = [
        pd.DataFrame(
            {"take": take, "part": "test", "k": k, "t": k / 100, "link": link, "marker": marker}
        ).assign(**dict(zip("xyz", places[:, i].T, strict=True)))
        for i, (link, marker) in enumerate(names)
    ]
    return pd.concat(each, ignore_index=True)


def test_exact_points_give_pinocchios_poses():
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 7))
    take = tip_poses("t", rows(q), MOCAP, "flange")
    rotation, position = link_poses(LWR4, "flange", q)
    np.testing.assert_allclose(take.y[:, :3], position, atol=1e-12)
    np.testing.assert_allclose(take.y[:, 3:].reshape(-1, 3, 3), rotation, atol=1e-12)
    assert take.tip and not take.bias.any()


def test_the_covariance_is_that_of_poses_from_noisy_points():
    q, rng = np.repeat([[0.3, 0.9, -0.3, -1.6, 0.4, 1.0, 0.2]], 20_000, axis=0), np.random
    noise = 1e-3 * rng.default_rng(2).standard_normal((len(q), 5, 3))
    take = tip_poses("t", rows(q, noise=noise), MOCAP, "flange")
    exact = tip_poses("t", rows(q[:1]), MOCAP, "flange")
    turn = take.y[:, 3:].reshape(-1, 3, 3) @ exact.y[0, 3:].reshape(3, 3).T
    vector = np.stack(
        [
            turn[:, 2, 1] - turn[:, 1, 2],
            turn[:, 0, 2] - turn[:, 2, 0],
            turn[:, 1, 0] - turn[:, 0, 1],
        ],
        axis=1,
    )
    errors = np.hstack([take.y[:, :3] - exact.y[0, :3], vector / 2])
    white = np.linalg.solve(np.linalg.cholesky(exact.covariance[0]), errors.T)
    np.testing.assert_allclose(np.cov(white), np.eye(6), atol=5 * np.sqrt(2 / len(q)))
    # control: position and turn are correlated, as the pivot is not the points' centre
    assert np.abs(np.cov(white / np.sqrt(2)) - np.eye(6)).max() > 0.3


def test_frames_that_show_fewer_than_three_points_are_left_out_and_three_are_noisier():
    table = rows(np.zeros((10, 7)) + 0.3)
    table.loc[(table.link == 2) & (table.marker < 3) & (table.k == 4), ["x", "y", "z"]] = np.nan
    table.loc[(table.link == 2) & (table.marker == 1) & (table.k == 6), ["x", "y", "z"]] = np.nan
    take = tip_poses("t", table, MOCAP, "flange")
    np.testing.assert_allclose(take.t * 100, [0, 1, 2, 3, 5, 6, 7, 8, 9])
    trace = np.trace(take.covariance, axis1=1, axis2=2)
    assert np.flatnonzero(trace > 1.05 * trace[0]).tolist() == [5]


@pytest.fixture
def tables(tmp_path, monkeypatch):
    """Two test takes and a training one in the current folder."""
    monkeypatch.chdir(tmp_path)
    MOTION.mkdir(parents=True), TRACK.mkdir(parents=True)
    q, k = np.full((5, 7), 0.3), np.arange(5)
    trained = [f"train_{number}" for number in range(1, 31)]
    takes = {"test_2": "test", "test_1": "test"} | dict.fromkeys(trained, "training")
    joints = [
        pd.DataFrame({"take": take, "part": part, "k": k, "t": k / 100}).assign(
            **spread("q", LWR4.joints, q), residual=0.0
        )
        for take, part in takes.items()
    ]
    contracts.write(pd.concat(joints, ignore_index=True), "joints", TRACK)
    markers = [rows(q, take) for take in ("test_1", "test_2", "test_3")]
    contracts.write(pd.concat(markers, ignore_index=True), "markers", MOTION)
    read = [
        pd.DataFrame({"take": take, "part": "test", "t": np.arange(9) / 200}).assign(
            **spread("q", LWR4.joints, np.full((9, 7), 0.3 + number))
        )
        for number, take in enumerate(("test_1", "test_2", "test_3"))
    ]
    # errors of which the first joint's is off by 0.02 rad all the same
    t, rng = np.arange(9) / 200, np.random.default_rng(1)
    for take in trained:
        off = 2e-3 * rng.standard_normal((9, 7)) + [0.02, 0, 0, 0, 0, 0, 0]
        frame = pd.DataFrame({"take": take, "part": "training", "t": t})
        read.append(frame.assign(**spread("q", LWR4.joints, 0.3 + off)))
    contracts.write(pd.concat(read, ignore_index=True), "encoders", MOTION)


def test_the_takes_that_stay_are_measured_by_the_instrument_that_is_chosen(tables):
    by_tip = measured_takes(DATASET)
    assert [take.take for take in by_tip] == ["test_1", "test_2"]  # test_3 was left out by track
    assert by_tip[0].y.shape == (5, 12)
    by_encoders = measured_takes(replace(DATASET, measurement="encoders"))
    assert [take.take for take in by_encoders] == ["test_1", "test_2"]
    second = by_encoders[1]
    # every second reading: one a step of the motion
    assert (second.y == 1.3).all() and second.y.shape == (5, 7) and not second.tip
    np.testing.assert_allclose(second.t, np.arange(5) / 100)
    np.testing.assert_allclose(second.bias.mean(axis=0), [0.02] + [0.0] * 6, atol=8e-4)
    np.testing.assert_allclose(second.covariance[2], 4e-6 * np.eye(7), atol=2e-6)
    assert measured_takes(replace(DATASET, measurement="depth")) == []


def test_what_the_dataset_does_not_have_is_refused_with_one_message(tables):
    for changed, words in (
        ({"measurement": "encoders", "encoders": None}, "what the dataset does not have"),
        ({"mocap": None}, "what the dataset does not have"),
        ({"mocap": replace(MOCAP, deviation=None)}, "needs its markers or body"),
        ({"mocap": replace(MOCAP, markers={"link_5": HAND})}, "'flange' needs its markers"),
        ({"robot": replace(LWR4, plane=True)}, "not of one in a plane"),
    ):
        with pytest.raises(ConfigError, match=words):
            measured_takes(replace(DATASET, **changed))
    with pytest.raises(ConfigError, match="should be 'depth', 'encoders' or 'tip', got 'lidar'"):
        replace(DATASET, measurement="lidar")
    file = MOTION / "encoders.parquet"
    table = pd.read_parquet(file)
    for take in ("test_2", "train_7"):
        contracts.write(table[table["take"] != take], "encoders", Path(MOTION))
        with pytest.raises(ConfigError, match=f"nothing is measured of the takes {take}"):
            measured_takes(replace(DATASET, measurement="encoders"))
