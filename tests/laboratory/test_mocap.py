"""The motion capture: exact without noise, faults that are counted and follow their laws; rigid
bodies on an arm of seven joints.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from space_arms import LWR4, link_poses
from synthetic_session import ARM

from pipeline.arm.model import chain_of, link_chains
from pipeline.laboratory import mocap
from pipeline.laboratory.options import MocapOptions

TEMPLATE = np.array([[0.03, -0.04, 0.02], [-0.02, -0.04, 0.1], [0.01, 0.04, 0.06]]) * [
    [[scale]] for scale in (1.0, 0.9, 1.1)
]
WORLD = Rotation.from_euler("xyz", [-1.4, 0.3, 0.2]).as_matrix()
ORIGIN = np.array([0.4, 0.9, -1.2])
RATES = dict.fromkeys(("occlusion_rate", "swap_rate", "lost_label_rate"), 0)
SILENT = MocapOptions(noise_std=0, placement_std=0, **RATES)
NAMES = [f"link{link}_{label}" for link in (1, 2, 3) for label in "abc"]


def planar_angles(frames: int) -> np.ndarray:
    way = np.linspace(0, 1, frames)[:, None]
    return (
        np.deg2rad([120.0, -11.0, 92.5]) * (1 - way)
        + np.deg2rad([20.0, -81.0, 12.5]) * way
    )


def take(options: MocapOptions, frames: int) -> dict[str, np.ndarray]:
    """Markers of the planar arm."""
    q, rng = planar_angles(frames), default_rng(5)
    return mocap.capture(ARM, q, TEMPLATE, (WORLD, ORIGIN), options, rng)


def labelled(markers: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([markers[name] for name in NAMES], axis=1)


def test_markers_without_noise_give_back_the_joint_angles() -> None:
    q = planar_angles(25)
    positions = labelled(take(SILENT, 25)).reshape(25, 3, 3, 3)
    plane = ARM.to_plane((positions - ORIGIN) @ WORLD)
    psi = np.empty((25, 3))
    for n, j in np.ndindex(25, 3):
        body, observed = (
            points - points.mean(axis=0) for points in (TEMPLATE[j], plane[n, j])
        )
        axis_z = Rotation.align_vectors(observed, body)[0].apply([0.0, 0.0, 1.0])
        assert abs(axis_z[1]) < 1e-9
        psi[n, j] = np.arctan2(axis_z[0], axis_z[2])

    assert_allclose(ARM.chain.joints_from_segments(psi), q, atol=1e-9)


def test_noise_and_errors_of_placement_have_the_stated_deviations():
    options = replace(SILENT, noise_std=2e-4)
    noise = labelled(take(options, 4000)) - labelled(take(SILENT, 4000))
    # 108 000 draws: the deviation's standard error is 0.22 %
    assert noise.std() == pytest.approx(2e-4, rel=0.01)
    assert not noise.std() == pytest.approx(2.1e-4, rel=0.01)
    assert abs((noise[1:] * noise[:-1]).mean()) < 4 * 2e-4**2 / np.sqrt(noise.size)

    # the error of placement is drawn once
    options, rng = MocapOptions(placement_std=1e-3), default_rng(3)
    errors = np.stack(
        [mocap.place_markers(TEMPLATE, options, rng) - TEMPLATE for _ in range(400)],
    )

    assert errors.std() == pytest.approx(1e-3, rel=0.03)
    assert errors.mean(axis=0) == pytest.approx(0.0, abs=4e-3 / 20)


def expected_share(rate: float, frames: float) -> float:
    """Share of frames inside a burst, bursts of geometric length starting independently and
    overlapping at will.
    """
    ages = np.arange(10_000)
    return 1 - np.prod(1 - rate * (1 - 1 / frames) ** ages)


def test_occlusions_cover_the_share_of_their_law():
    options = replace(SILENT, noise_std=1e-4, occlusion_rate=0.02, occlusion_frames=8)
    result = take(options, 40_000)
    missing = np.isnan(labelled(result))
    assert np.all(missing.all(axis=2) == missing.any(axis=2))

    share = missing[..., 0].mean()
    # 360 000 marker-frames in stretches of about 10 frames: one standard error is about 0.002
    assert abs(share - expected_share(0.02, 8)) < 0.006
    assert abs(share - expected_share(0.02, 9)) > 0.006


def test_swaps_exchange_two_labels_of_one_link():
    options = replace(SILENT, swap_rate=0.01, swap_frames=4)
    result = take(options, 2000)
    observed = labelled(result).reshape(2000, 3, 3, 3)
    true = labelled(take(SILENT, 2000)).reshape(2000, 3, 3, 3)
    moved = np.any(observed != true, axis=3)

    assert set(np.unique(moved.sum(axis=2))) == {0, 2}
    assert moved.any(axis=2).sum() > 0
    assert_array_equal(np.sort(observed, axis=2), np.sort(true, axis=2))

    pairs = np.unique(moved[moved.any(axis=2)], axis=0)
    assert len(pairs) == 3


def test_lost_labels_reappear_as_unlabeled_columns():
    options = replace(SILENT, lost_label_rate=0.005, lost_label_frames=5)
    result = take(options, 3000)
    observed, true = labelled(result), labelled(take(SILENT, 3000))
    strays = {name: column for name, column in result.items() if name not in NAMES}

    assert list(strays) == [f"Unlabeled {1000 + i}" for i in range(len(strays))]

    for column in strays.values():
        at = np.flatnonzero(~np.isnan(column[:, 0]))
        assert_array_equal(at, np.arange(at[0], at[-1] + 1))
        (owner,) = np.flatnonzero(np.all(true[at] == column[at][:, None], axis=(0, 2)))
        assert np.isnan(observed[at, owner]).all()
        observed[at, owner] = column[at]

    # with the strays put back nothing is missing
    assert strays
    assert_array_equal(observed, true)


def test_a_hidden_marker_loses_no_label_and_begins_no_unlabeled_column():
    options = replace(
        SILENT,
        lost_label_rate=0.02,
        lost_label_frames=8,
        occlusion_rate=0.02,
    )
    result = take(options, 3000)
    hidden = np.isnan(labelled(take(replace(options, lost_label_rate=0), 3000))[..., 0])
    strays = [column for name, column in result.items() if name not in NAMES]
    seen = np.stack([~np.isnan(column[:, 0]) for column in strays])

    assert hidden.any() and np.all(seen.any(axis=1))
    # a column is one stretch without a gap: it ends where the marker is hidden
    assert all(np.all(np.diff(np.flatnonzero(row)) == 1) for row in seen)


def test_without_noise_a_body_is_where_pinocchio_carries_its_mount(rng):
    places = np.array(
        [[0.08, 0.0, 0.01], [-0.01, 0.08, 0], [-0.07, -0.03, 0.01], [0, -0.05, 0.02]],
    )
    mount, q = (places.mean(axis=0), [0.2, -0.4, 1.1]), rng.uniform(-1.5, 1.5, (20, 7))
    for link, chain in link_chains(LWR4, ["link_5", "flange"], "markers").items():
        body = {link: mocap.MarkerCluster(chain, places, mocap.in_body(places, *mount))}
        (where, quaternion) = mocap.capture_bodies(
            body,
            q,
            (WORLD, ORIGIN),
            SILENT,
            rng,
        )[link]
        rotation, position = link_poses(LWR4, link, q)
        at = (position + rotation @ mount[0]) @ WORLD.T + ORIGIN
        turn = WORLD @ rotation @ Rotation.from_euler("xyz", mount[1]).as_matrix()
        assert_allclose(where, at, atol=1e-12)
        assert_allclose(
            Rotation.from_quat(quaternion).as_matrix(),
            turn,
            atol=1e-12,
        )


def test_the_body_of_a_link_is_carried_by_the_arm_as_built():
    nominal, (link,) = chain_of(LWR4), link_chains(LWR4, ["link_5"], "key").values()
    longer, joints = 1.1 * nominal.placements, len(link.lower)
    built = mocap.as_built(link, replace(nominal, placements=longer))

    # the link's frame is the drawing's
    expected = [
        *longer[:joints],
        link.placements[joints],
    ]

    assert_array_equal(built.placements, expected)
