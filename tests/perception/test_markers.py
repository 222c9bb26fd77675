"""Joint angles from markers: exactness, error statistics against a closed form, labels put right,
gaps.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.perception.markers import fit_segments, marker_places, track_joints

TEMPLATE = np.array(
    [
        [[0.03, -0.04, 0.02], [-0.025, -0.04, 0.07], [0.02, -0.05, 0.13]],
        [[-0.03, -0.04, 0.02], [0.025, -0.045, 0.06], [-0.02, -0.04, 0.115]],
        [[0.03, -0.04, 0.01], [-0.03, -0.04, 0.05], [0.01, -0.06, 0.10]],
    ]
)


@pytest.fixture(scope="module")
def arm() -> Arm:
    chain = PlanarChain(
        origin=np.array([0.009, 0.115]),
        links=np.array([[-0.1405, 0.0655], [0.1333, 0.0211], [-0.0642, 0.1574]]),
        signs=np.array([1.0, 1.0, -1.0]),
        lower=np.array([0.0, -5.18, -3.6]),
        upper=np.array([2.7, 0.0, 0.0]),
        max_speed=np.full(3, np.pi / 2),
    )
    turn = Rotation.from_euler("zyx", [0.4, 0.02, -0.03]).as_matrix()
    return Arm(chain, turn, np.array([0.3, -0.2, 0.1]))


def motion() -> np.ndarray:
    """Out and back, 1.5 rad a joint in 3.2 s."""
    phase = (1 - np.cos(np.linspace(0, 2 * np.pi, 321))) / 2
    return np.array([0.5, -2.8, -2.4]) + phase[:, None] * np.array([1.5, 1.3, 1.4])


def recording(arm: Arm, q: np.ndarray) -> np.ndarray:
    return arm.to_base(marker_places(q, TEMPLATE, arm.chain))


def test_without_noise_the_joint_angles_are_exact(arm: Arm) -> None:
    q = motion()
    track = track_joints(recording(arm, q), TEMPLATE, arm)
    np.testing.assert_allclose(track.q, q, atol=1e-12)
    assert track.residual.max() < 1e-12
    assert not any(track.counts.values())


def test_three_markers_are_fitted_as_scipy_fits_them(arm: Arm) -> None:
    generator = np.random.default_rng(1)
    markers = marker_places(motion()[::80], TEMPLATE, arm.chain) + generator.normal(
        scale=0.004, size=(5, 3, 3, 3)
    )
    psi, square = fit_segments(markers, TEMPLATE)
    for frame in range(5):
        for link in range(3):
            measured, reference = (
                x - x.mean(axis=0) for x in (markers[frame, link], TEMPLATE[link])
            )
            rotation, rssd = Rotation.align_vectors(measured, reference)
            quaternion = rotation.as_quat()
            twist = 2 * np.arctan2(quaternion[1], quaternion[3])
            assert np.angle(np.exp(1j * (psi[frame, link] - twist))) == pytest.approx(0.0, abs=1e-9)
            assert square[frame, link] == pytest.approx(rssd**2, rel=1e-9)


def predicted_variance(corners: np.ndarray) -> float:
    """Variance of the angle about the normal for unit noise: the (y, y) entry of the inverse of the
    inertia of the markers.
    """
    c = corners - corners.mean(axis=0)
    return np.linalg.inv(np.trace(c.T @ c) * np.eye(3) - c.T @ c)[1, 1]


@pytest.mark.parametrize("visible", [3, 2])
def test_the_angle_error_is_the_noise_over_the_lever(arm: Arm, visible: int) -> None:
    noise, frames = 2e-4, 4000
    q = np.broadcast_to(motion()[100], (frames, 3))
    generator = np.random.default_rng(2)
    markers = marker_places(q, TEMPLATE, arm.chain) + generator.normal(
        scale=noise, size=(frames, 3, 3, 3)
    )
    markers[:, :, visible:] = np.nan
    error = fit_segments(markers, TEMPLATE)[0] - arm.chain.segment_headings(q)
    pair = (TEMPLATE[:, 1] - TEMPLATE[:, 0])[:, [0, 2]]
    law = (
        [predicted_variance(corners) for corners in TEMPLATE]
        if visible == 3
        else 2 / (pair**2).sum(axis=1)
    )
    # the standard deviation of 4000 values is known to 1.1 %: four of those; the other number of
    # markers lies outside
    np.testing.assert_allclose(error.std(axis=0), noise * np.sqrt(law), rtol=0.045)
    wrong = (
        2 / (pair**2).sum(axis=1)
        if visible == 3
        else [predicted_variance(corners) for corners in TEMPLATE]
    )
    assert np.all(np.abs(error.std(axis=0) / (noise * np.sqrt(wrong)) - 1) > 0.045)


def test_a_tilted_base_frame_does_not_enter_the_angles_of_three_markers_but_of_two(
    arm: Arm,
) -> None:
    q = motion()[::6]
    leaning = (
        marker_places(q, TEMPLATE, arm.chain)
        @ Rotation.from_rotvec([0.02, 0.0, 0.03]).as_matrix().T
    )
    np.testing.assert_allclose(
        fit_segments(leaning, TEMPLATE)[0], arm.chain.segment_headings(q), atol=1e-12
    )
    leaning[:, :, 0] = np.nan
    assert np.abs(fit_segments(leaning, TEMPLATE)[0] - arm.chain.segment_headings(q)).max() > 1e-3


def test_labels_swapped_within_and_between_links_are_put_right_and_counted(arm: Arm) -> None:
    generator = np.random.default_rng(3)
    q = motion()
    clean = recording(arm, q) + generator.normal(scale=2e-4, size=(len(q), 3, 3, 3))
    swapped = clean.copy()
    swapped[40:90, 0, [0, 1]] = clean[40:90, 0, [1, 0]]
    swapped[150:230, 1, 2], swapped[150:230, 2, 0] = clean[150:230, 2, 0], clean[150:230, 1, 2]
    swapped[:10, 2, [0, 1, 2]] = clean[:10, 2, [2, 0, 1]]
    track, reference = track_joints(swapped, TEMPLATE, arm), track_joints(clean, TEMPLATE, arm)
    np.testing.assert_array_equal(track.q, reference.q)
    assert track.counts == {**reference.counts, "relabelled": 2 * 50 + 2 * 80 + 3 * 10}


def test_labels_wrong_in_every_frame_are_put_right_from_the_shape_of_the_links(arm: Arm) -> None:
    q = motion()[:60]
    generator = np.random.default_rng(4)
    clean = recording(arm, q) + generator.normal(scale=2e-4, size=(60, 3, 3, 3))
    order = generator.permutation(9)
    track = track_joints(clean.reshape(60, 9, 3)[:, order].reshape(60, 3, 3, 3), TEMPLATE, arm)
    np.testing.assert_array_equal(track.q, track_joints(clean, TEMPLATE, arm).q)
    assert track.counts["relabelled"] == 60 * int((order != np.arange(9)).sum())


def test_unlabelled_markers_fill_missing_labels_and_strangers_do_not(arm: Arm) -> None:
    q = motion()
    clean = recording(arm, q)
    broken, loose = clean.copy(), np.full((len(q), 4, 3), np.nan)
    broken[100:160, 1, :2] = np.nan
    loose[100:160, 2], loose[100:160, 0] = clean[100:160, 1, 0], clean[100:160, 1, 1]
    loose[:, 3] = arm.to_base(np.array([0.2, -0.04, 0.6]))
    track = track_joints(broken, TEMPLATE, arm, unlabelled=loose)
    np.testing.assert_allclose(track.q, q, atol=1e-12)
    assert track.counts["missing"] == track.counts["adopted"] == 120
    with pytest.raises(RecordingError, match="longer than 10 frames"):
        track_joints(broken, TEMPLATE, arm)


def test_a_reflection_with_a_label_is_rejected_and_the_link_solved_on_two_markers(arm: Arm) -> None:
    q = motion()
    ghost = recording(arm, q)
    ghost[200:205, 2, 1] += 0.05
    track = track_joints(ghost, TEMPLATE, arm)
    np.testing.assert_allclose(track.q, q, atol=1e-12)
    assert (track.counts["rejected"], track.counts["two_marker_fits"]) == (5, 5)


def test_short_gaps_are_filled_linearly_counted_and_have_no_residual(arm: Arm) -> None:
    q = motion()
    gap = recording(arm, q)
    gap[50:60, 0, 1:] = np.nan
    gap[:3] = np.nan
    track = track_joints(gap, TEMPLATE, arm)
    share = (np.arange(50, 60) - 49)[:, None] / 11
    np.testing.assert_allclose(track.q[50:60], (1 - share) * q[49] + share * q[60], atol=1e-12)
    np.testing.assert_allclose(track.q[:3], np.tile(q[3], (3, 1)), atol=1e-12)
    assert (track.counts["interpolated"], track.counts["held"]) == (10, 3)
    assert np.isnan(track.residual).sum() == 13
    gap[60, 0, 1:] = np.nan
    with pytest.raises(RecordingError, match=r"take-7.*50 to 60"):
        track_joints(gap, TEMPLATE, arm, take="take-7")


def test_markers_that_never_fit_and_a_template_in_line_are_refused(arm: Arm) -> None:
    markers, line = recording(arm, motion()[:20]), TEMPLATE.copy()
    with pytest.raises(RecordingError, match="fit the arm"):
        track_joints(markers * 1000, TEMPLATE, arm)
    line[1] = [[0, 0, 0.02], [0, 0, 0.06], [0, 0, 0.1]]
    with pytest.raises(ConfigError, match="in line"):
        track_joints(markers, line, arm)
