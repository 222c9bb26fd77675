"""Joint angles of takes of a planar arm: exactness, labels put right, gaps, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from marker_takes import PLACES as TEMPLATE
from marker_takes import marker_places
from scipy.spatial.transform import Rotation

from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import Arm
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.perception import markers
from pipeline.perception.markers import JointTrack, fill_gaps
from pipeline.perception.posture import points_in_plane

ARM = Arm(
    PlanarChain(
        origin=np.array([0.009, 0.115]),
        links=np.array([[-0.1405, 0.0655], [0.1333, 0.0211], [-0.0642, 0.1574]]),
        signs=np.array([1.0, 1.0, -1.0]),
        lower=np.array([0.0, -5.18, -3.6]),
        upper=np.array([2.7, 0.0, 0.0]),
        max_speed=np.full(3, np.pi / 2),
    ),
    Rotation.from_euler("zyx", [0.4, 0.02, -0.03]).as_matrix(),
    np.array([0.3, -0.2, 0.1]),
)
# out and back, 1.5 rad a joint in 3.2 s
PHASE = (1 - np.cos(np.linspace(0, 2 * np.pi, 321))) / 2
MOTION = np.array([0.5, -2.8, -2.4]) + PHASE[:, None] * np.array([1.5, 1.3, 1.4])


def recording(noise: float = 0.0, seed: int = 3) -> np.ndarray:
    """(321, 9, 3) m in the base frame."""
    places = ARM.to_base(marker_places(MOTION, TEMPLATE, ARM.chain)).reshape(-1, 9, 3)
    return places + noise * np.random.default_rng(seed).standard_normal(places.shape)


def track(positions: np.ndarray, template: np.ndarray = TEMPLATE, take: str = "") -> JointTrack:
    return markers.track(positions, points_in_plane(ARM, template, 0.01), max_gap=10, take=take)


def test_without_noise_the_joint_angles_are_exact_where_a_link_is_hidden_too():
    positions = recording()
    exact = track(positions)
    np.testing.assert_allclose(exact.q, MOTION, atol=1e-10)
    assert exact.residual.max() < 1e-10 and not any(exact.counts.values())
    assert exact.samples == positions.shape[0] * 9
    positions[40:90, 3:6] = np.nan
    hidden = track(positions)
    np.testing.assert_allclose(hidden.q, MOTION, atol=1e-10)
    assert hidden.counts["missing"] == 150 and not hidden.counts["interpolated"]
    # a base that is registered wrongly shows in the residual
    shifted = track(np.add(recording(), [1e-3, 0.0, 0.0]))
    assert 1e-4 < np.median(shifted.residual) < 1e-3
    assert np.abs(shifted.q - MOTION).max() > 1e-3


def test_labels_swapped_within_and_between_links_are_put_right_and_counted():
    clean = recording(2e-4)
    swapped, reference = clean.copy(), track(clean)
    swapped[40:90, [0, 1]] = clean[40:90, [1, 0]]
    swapped[150:230, 5], swapped[150:230, 6] = clean[150:230, 6], clean[150:230, 5]
    swapped[:10, [6, 7, 8]] = clean[:10, [8, 6, 7]]
    repaired = track(swapped)
    np.testing.assert_allclose(repaired.q, reference.q, atol=1e-9)
    assert repaired.counts == {**reference.counts, "relabelled": 2 * 50 + 2 * 80 + 3 * 10}


def test_a_reflection_with_a_label_is_rejected_and_the_rest_of_the_markers_decide():
    ghost = recording()
    ghost[200:205, 7] += 0.05
    solved = track(ghost)
    np.testing.assert_allclose(solved.q, MOTION, atol=1e-10)
    assert (solved.counts["rejected"], solved.counts["two_marker_fits"]) == (5, 5)


def test_short_gaps_are_filled_linearly_counted_and_have_no_residual():
    gap = recording()
    gap[50:60, 6:] = np.nan
    gap[:3] = np.nan
    filled = track(gap)
    share = (np.arange(50, 60) - 49)[:, None] / 11
    line = (1 - share) * MOTION[49] + share * MOTION[60]
    np.testing.assert_allclose(filled.q[50:60], line, atol=1e-10)
    np.testing.assert_allclose(filled.q[:3], np.tile(MOTION[3], (3, 1)), atol=1e-10)
    assert (filled.counts["interpolated"], filled.counts["held"]) == (10, 3)
    assert np.isnan(filled.residual).sum() == 13
    gap[60, 6:] = np.nan
    with pytest.raises(RecordingError, match=r"take-7.*50 to 60"):
        track(gap, take="take-7")


def test_gaps_of_turning_joints_are_filled_the_short_way_round_and_of_sliding_ones_as_they_are():
    q = np.array([[3.1, 0.0], [np.nan, np.nan], [-3.1, 3.8]])
    solved, sliding = np.array([True, False, True]), np.array([False, True])
    filled, counts = fill_gaps(q, solved, sliding, 1, "t")
    np.testing.assert_allclose(filled, [[3.1, 0.0], [np.pi, 1.9], [2 * np.pi - 3.1, 3.8]])
    assert counts == {"interpolated": 1, "held": 0}


LINE = np.array([TEMPLATE[0], [[0, 0, 0.02], [0, 0, 0.06], [0, 0, 0.1]], TEMPLATE[2]])


@pytest.mark.parametrize(
    ("positions", "template", "error", "words"),
    [
        (recording()[:20] * 1000, TEMPLATE, RecordingError, "fit the arm"),
        (recording()[:20, ::-1], TEMPLATE, RecordingError, "check the template, the labels"),
        (np.full((5, 9, 3), np.nan), TEMPLATE, RecordingError, "fit the arm"),
        (recording()[:0], TEMPLATE, RecordingError, "no frame"),
        (recording()[:20], LINE, ConfigError, "in line"),
        (recording()[:20], TEMPLATE[:2], ConfigError, "three markers"),
    ],
)
def test_markers_that_never_fit_and_templates_that_decide_no_angle_are_refused(
    positions, template, error, words
):
    with pytest.raises(error, match=words):
        track(positions, template)
