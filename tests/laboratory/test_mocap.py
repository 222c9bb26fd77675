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
from standard_errors import largest_score
from synthetic_session import ARM

from pipeline.arm.model import chain_of, link_chains
from pipeline.laboratory import mocap
from pipeline.laboratory.options import MocapOptions

PLACES = np.array([[0.03, -0.04, 0.02], [-0.02, -0.04, 0.1], [0.01, 0.04, 0.06]])
TEMPLATE = PLACES * np.array([1.0, 0.9, 1.1])[:, None, None]
WORLD = Rotation.from_euler("xyz", [-1.4, 0.3, 0.2]).as_matrix()
ORIGIN = np.array([0.4, 0.9, -1.2])
RATES = dict.fromkeys(("occlusion_rate", "swap_rate", "lost_label_rate"), 0)
SILENT = MocapOptions(noise_std=0, placement_std=0, **RATES)
NAMES = [f"link{link}_{label}" for link in (1, 2, 3) for label in "abc"]


def planar_angles(frames: int) -> np.ndarray:
    start, end = np.deg2rad([[120.0, -11.0, 92.5], [20.0, -81.0, 12.5]])
    return np.linspace(start, end, frames)


def captured(frames: int, **options) -> dict[str, np.ndarray]:
    """Markers of the planar arm, with ``options`` of the motion capture beside SILENT."""
    q = planar_angles(frames)
    rng = default_rng(5)
    chosen = replace(SILENT, **options)
    return mocap.capture(ARM, q, TEMPLATE, (WORLD, ORIGIN), chosen, rng)


def labelled(markers: dict[str, np.ndarray]) -> np.ndarray:
    """(frames, 9, 3) the markers that have their label."""
    return np.stack([markers[name] for name in NAMES], axis=1)


def stray_columns(markers: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The markers that lost their label, by the name of their column."""
    return {name: column for name, column in markers.items() if name not in NAMES}


def test_markers_without_noise_give_back_the_joint_angles() -> None:
    positions = labelled(captured(25)).reshape(25, 3, 3, 3)
    plane = ARM.to_plane((positions - ORIGIN) @ WORLD)
    psi = np.empty((25, 3))
    for n, j in np.ndindex(25, 3):
        body = TEMPLATE[j] - TEMPLATE[j].mean(axis=0)
        observed = plane[n, j] - plane[n, j].mean(axis=0)
        turn, _ = Rotation.align_vectors(observed, body)
        x, y, z = turn.apply([0.0, 0.0, 1.0])
        assert abs(y) < 1e-9
        psi[n, j] = np.arctan2(x, z)

    q = ARM.chain.joints_from_segments(psi)
    assert_allclose(q, planar_angles(25), atol=1e-9)


def expected_share(rate: float, frames: float) -> float:
    """Share of frames inside a burst, bursts of geometric length starting independently and
    overlapping at will.
    """
    ages = np.arange(10_000)
    return 1 - np.prod(1 - rate * (1 - 1 / frames) ** ages)


def test_noise_has_the_stated_deviation():
    noise = labelled(captured(4000, noise_std=2e-4)) - labelled(captured(4000))
    neighbours = noise[1:] * noise[:-1]

    # 108 000 draws: the deviation's standard error is 0.22 %
    assert noise.std() == pytest.approx(2e-4, rel=0.01)
    assert noise.std() != pytest.approx(2.1e-4, rel=0.01)
    assert largest_score(neighbours.ravel()) < 4


def test_the_error_of_placement_is_drawn_once_with_the_stated_deviation():
    options = MocapOptions(placement_std=1e-3)
    rng = default_rng(3)
    errors = []
    for _ in range(400):
        errors.append(mocap.place_markers(TEMPLATE, options, rng) - TEMPLATE)
    assert np.std(errors) == pytest.approx(1e-3, rel=0.03)
    assert largest_score(np.array(errors)) < 4


def test_occlusions_cover_the_share_of_their_law():
    bursts = {"occlusion_rate": 0.02, "occlusion_frames": 8}
    missing = np.isnan(labelled(captured(40_000, noise_std=1e-4, **bursts)))
    share = missing.mean()

    assert_array_equal(missing.all(axis=2), missing.any(axis=2))
    # 360 000 marker-frames in stretches of about 10 frames: one standard error is about 0.002
    assert abs(share - expected_share(0.02, 8)) < 0.006
    assert abs(share - expected_share(0.02, 9)) > 0.006


def test_swaps_exchange_two_labels_of_one_link():
    shape = 2000, 3, 3, 3
    observed = labelled(captured(2000, swap_rate=0.01, swap_frames=4)).reshape(shape)
    true = labelled(captured(2000)).reshape(shape)
    moved = np.any(observed != true, axis=3)
    pairs = np.unique(moved[moved.any(axis=2)], axis=0)

    assert {*moved.sum(axis=2).flat} == {0, 2}
    assert len(pairs) == 3
    assert_array_equal(np.sort(observed, axis=2), np.sort(true, axis=2))


def test_lost_labels_reappear_as_unlabeled_columns():
    markers = captured(3000, lost_label_rate=0.005, lost_label_frames=5)
    observed = labelled(markers)
    true = labelled(captured(3000))
    strays = stray_columns(markers)

    assert strays
    assert [*strays] == [f"Unlabeled {1000 + i}" for i in range(len(strays))]
    for column in strays.values():
        at = np.flatnonzero(~np.isnan(column[:, 0]))
        assert_array_equal(at, np.arange(at[0], at[-1] + 1))
        is_owner = np.all(true[at] == column[at][:, None], axis=(0, 2))
        (owner,) = np.flatnonzero(is_owner)
        assert np.isnan(observed[at, owner]).all()
        observed[at, owner] = column[at]
    # with the strays put back nothing is missing
    assert_array_equal(observed, true)


def test_a_hidden_marker_loses_no_label_and_begins_no_unlabeled_column():
    lost = {"lost_label_rate": 0.02, "lost_label_frames": 8}
    markers = captured(3000, occlusion_rate=0.02, **lost)
    hidden = np.isnan(labelled(captured(3000, occlusion_rate=0.02)))
    assert hidden.any()

    for column in stray_columns(markers).values():
        seen = np.flatnonzero(~np.isnan(column[:, 0]))
        # a column is one stretch without a gap: it ends where the marker is hidden
        assert seen.size > 0 and np.all(np.diff(seen) == 1)


BODY = np.array(
    [[0.08, 0.0, 0.01], [-0.01, 0.08, 0], [-0.07, -0.03, 0.01], [0, -0.05, 0.02]],
)
MOUNT = BODY.mean(axis=0), [0.2, -0.4, 1.1]  # m; rad about x, y and z


@pytest.mark.parametrize("link", ["link_5", "flange"])
def test_without_noise_a_body_is_where_pinocchio_carries_its_mount(rng, link):
    q = rng.uniform(-1.5, 1.5, (20, 7))
    (chain,) = link_chains(LWR4, [link], "markers").values()
    cluster = mocap.MarkerCluster(chain, BODY, mocap.in_body(BODY, *MOUNT))

    bodies = mocap.capture_bodies({link: cluster}, q, (WORLD, ORIGIN), SILENT, rng)

    place, angles = MOUNT
    rotation, position = link_poses(LWR4, link, q)
    expected = (position + rotation @ place) @ WORLD.T + ORIGIN
    turn = WORLD @ rotation @ Rotation.from_euler("xyz", angles).as_matrix()
    where, quaternion = bodies[link]
    assert_allclose(where, expected, atol=1e-12)
    assert_allclose(Rotation.from_quat(quaternion).as_matrix(), turn, atol=1e-12)


def test_the_body_of_a_link_is_carried_by_the_arm_as_built():
    nominal = chain_of(LWR4)
    (link,) = link_chains(LWR4, ["link_5"], "key").values()
    longer = 1.1 * nominal.placements

    built = mocap.as_built(link, replace(nominal, placements=longer))

    # the link's frame is the drawing's
    joints = len(link.lower)
    expected = [*longer[:joints], link.placements[joints]]
    assert_array_equal(built.placements, expected)
