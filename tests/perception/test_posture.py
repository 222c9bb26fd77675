"""Joint angles of takes: least-squares postures of any chain, exact, as SciPy and Pinocchio have
them; labels of a planar arm put right, gaps; refusals.
"""

import numpy as np
import pinocchio as pin
import pytest
from marker_takes import PLACES, marker_places
from numpy.random import default_rng
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from space_arms import LWR4, MARKERS, START, UR5, YOUBOT, mocap, motion, points

from pipeline.arm.model import arm_of
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.perception.markers import JointTrack, fill_gaps, track
from pipeline.perception.posture import points_in_plane, points_in_space

# m
FRAMES = 120
NOISE = 5e-5
UPPER = slice(0, 3)
FORE = slice(3, 6)
HAND = slice(6, 9)


Q = motion(FRAMES)  # of the UR5
MEASURED = points(UR5, MARKERS, Q)  # exact


SINGLE = {  # markers on many links
    "shoulder": {"s": [0.05, 0.06, 0.0]},
    "upper_arm": {"a": [-0.2, 0.06, 0.05]},
    "forearm": {"d": [-0.3, 0.05, 0.05]},
    "wrist_2": {"w": [0.03, 0.02, 0.05]},
    "flange": {"g": [0.0, 0.07, 0.01], "h": [0.06, 0.0, 0.02]},
}


def tracked(positions: np.ndarray, markers: dict = MARKERS, robot=UR5, **options):
    postures = points_in_space(robot, mocap(markers, **options))
    return track(positions, postures, max_gap=20, take="t")


def with_changed(frames: slice, markers: slice, change) -> np.ndarray:
    """MEASURED with ``change`` added to some ``markers`` in some ``frames``."""
    positions = MEASURED.copy()
    positions[frames, markers] += change
    return positions


def test_exact_points_give_exact_angles():
    result = tracked(MEASURED)
    assert_allclose(result.q, Q, atol=1e-9)
    assert result.residual.max() < 1e-10
    assert not any(result.counts.values())


ARM = arm_of(YOUBOT)
MODEL = pin.buildModelFromUrdf(YOUBOT.urdf)
BENT = np.array([[2.0, -4.2, 1.2]])


def test_single_markers_on_many_links_give_exact_angles():
    observed = points(UR5, SINGLE, Q)
    result = tracked(observed, SINGLE, posture=START.round(1).tolist())
    assert_allclose(result.q, Q, atol=1e-9)


def of_youbot(q: np.ndarray) -> np.ndarray:
    """(9, 3) m, where Pinocchio has the youBot's markers at ``q`` (3,) rad: fixed to its joints as
    the segments hold them at zero.
    """
    data = MODEL.createData()
    held = pin.neutral(MODEL)
    joints = [MODEL.getJointId(name) for name in YOUBOT.joints]
    for name, angle in YOUBOT.locked.items():
        held[MODEL.joints[MODEL.getJointId(name)].idx_q] = angle

    def placed(angles: np.ndarray) -> list[pin.SE3]:
        at = held.copy()
        at[[MODEL.joints[joint].idx_q for joint in joints]] = angles
        pin.forwardKinematics(MODEL, data, at)
        return [data.oMi[joint].copy() for joint in joints]

    zero = ARM.to_base(marker_places(np.zeros(3), PLACES, ARM.chain))
    frames = zip(placed(np.zeros(3)), placed(q), zero, strict=True)
    places = []
    for before, now, markers in frames:
        moved = now * before.inverse()
        places += [moved.act(marker) for marker in markers]
    return np.array(places)


def of_ur5(q: np.ndarray) -> np.ndarray:
    """(9, 3) m, where Pinocchio has the UR5's markers at ``q`` (6,) rad."""
    (places,) = points(UR5, MARKERS, q[None])
    return places


SOLVERS = {  # how the points are solved, where they are by Pinocchio, and a pose
    "plane": (points_in_plane(ARM, PLACES, 0.005), of_youbot, BENT[0]),
    "space": (points_in_space(UR5, mocap()), of_ur5, Q[60]),
}


@pytest.mark.parametrize("place", SOLVERS)
def test_a_noisy_frame_is_solved_as_scipy_solves_it_through_pinocchio(place):
    solver, carry, q = SOLVERS[place]
    assert_allclose(solver.carry(q[None])[0], carry(q), atol=1e-12)
    frame = carry(q) + NOISE * default_rng(1).standard_normal((9, 3))

    def residuals(angles: np.ndarray) -> np.ndarray:
        return (carry(angles) - frame).ravel()

    ends = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15)
    reference = least_squares(residuals, q, "3-point", x_scale=0.1, **ends)
    frames = solver.solve(frame[None], q[None] + 0.05)
    solution = type(frames)(*(array[0] for array in frames))

    assert_allclose(solution.q, reference.x, atol=2e-8)
    squares = (solution.distances**2).sum()
    assert squares == pytest.approx(2 * reference.cost, rel=1e-9)
    normal = reference.jac.T @ reference.jac
    assert_allclose(solution.normal, normal, rtol=0, atol=1e-5)
    # SciPy's derivatives limit it; the step that is left by central differences does not
    slopes = []
    for nudge in 1e-5 * np.eye(len(q)):
        ahead, behind = (residuals(solution.q + step) for step in (nudge, -nudge))
        slopes.append((ahead - behind) / 2e-5)
    left, *_ = np.linalg.lstsq(np.transpose(slopes), -residuals(solution.q))
    assert np.abs(left).max() < 1e-10
    # control: the exact angles are no minimum of the noisy points
    assert np.abs(solution.q - q).max() > 1e-5


def test_a_link_is_missed_where_the_rest_decides():
    result = tracked(with_changed(slice(30, 60), FORE, np.nan))
    assert_allclose(result.q, Q, atol=1e-9)
    assert (result.counts["missing"], result.counts["interpolated"]) == (90, 0)


def test_a_gap_is_filled_where_the_rest_does_not_decide():
    result = tracked(with_changed(slice(30, 40), HAND, np.nan))
    assert result.counts["interpolated"] == 10
    assert np.isnan(result.residual[30:40]).all()
    # the motion is a straight line
    assert_allclose(result.q, Q, atol=1e-9)
    with pytest.raises(RecordingError, match="longer than 20 frames"):
        tracked(with_changed(slice(30, 55), HAND, np.nan))


def test_a_take_that_starts_in_the_dark_is_followed_backwards():
    measured = with_changed(slice(15), FORE, np.nan)
    measured[:5] = np.nan
    result = tracked(measured)
    assert_allclose(result.q[5:], Q[5:], atol=1e-9)
    assert result.counts["held"] == 5


SLIP = [0.03, -0.02, 0.01]  # m


def test_a_body_that_slips_is_left_out_of_its_frames():
    result = tracked(with_changed(slice(40, 50), FORE, SLIP))
    assert_allclose(result.q, Q, atol=1e-9)
    assert (result.counts["rejected"], result.counts["interpolated"]) == (30, 0)


def test_of_two_bodies_apart_nobody_knows_which_is_right_and_the_hand_is_needed():
    result = tracked(with_changed(slice(40, 50), HAND, SLIP))
    assert result.counts["interpolated"] == 10


@pytest.mark.parametrize(
    ("links", "joints"),
    [
        (["upper_arm"], "joint_3, joint_4, joint_5, joint_6:"),
        (["upper_arm", "forearm"], "joint_4, joint_5, joint_6:"),
    ],
)
def test_joints_that_no_point_shows_are_named(links, joints):
    markers = {link: MARKERS[link] for link in links}
    observed = MEASURED[:2, : 3 * len(links)]  # every frame is tried
    with pytest.raises(RecordingError, match=f"determine {joints}"):
        tracked(observed, markers)


def test_postures_that_fit_alike_are_refused_until_one_is_named():
    hand = {"flange": MARKERS["flange"]}
    q = motion(FRAMES)[:3]  # every frame is tried
    observed = points(UR5, hand, q)
    with pytest.raises(RecordingError, match="8 postures of the arm fit"):
        tracked(observed, hand)

    result = tracked(observed, hand, posture=(START + 0.1).tolist())
    assert_allclose(result.q, q, atol=1e-8)


def test_what_is_beyond_a_spherical_shoulder_fits_two_postures():
    beyond = dict.fromkeys(("link_3", "link_5"), MARKERS["forearm"])
    beyond |= {"flange": MARKERS["flange"]}
    q = np.array([[0.3, 0.9, -0.3, -1.6, 0.4, 1.0, 0.2]] * 3)
    with pytest.raises(RecordingError, match="2 postures"):
        tracked(points(LWR4, beyond, q), beyond, LWR4)

    with_link_1 = {"link_1": {"x": [0.1, 0.0, 0.1]}} | beyond
    result = tracked(points(LWR4, with_link_1, q), with_link_1, LWR4)
    assert_allclose(result.q, q, atol=1e-9)


def test_whole_turns_are_those_of_the_posture_that_is_named():
    turns = -2 * np.pi * np.eye(6)[5]
    result = tracked(MEASURED, posture=(START + turns).tolist())
    assert_allclose(result.q, Q + turns, atol=1e-9)


EXCHANGED = MEASURED[:3, [0, 1, 2, 6, 7, 8, 3, 4, 5]]  # forearm and hand


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        (EXCHANGED, "no posture of the arm has all markers"),
        (np.full_like(MEASURED, np.nan), "no posture"),
    ],
    ids=["exchanged", "missing"],
)
def test_points_that_never_fit_are_refused(positions, words):
    with pytest.raises(RecordingError, match=words):
        tracked(positions)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"markers": {"forearm": {}}}, "forearm needs markers"),
        ({"posture": [0.0] * 7}, "7 angles for an arm of 6 joints"),
    ],
)
def test_points_and_postures_that_are_not_of_the_arm_are_refused(options, words):
    with pytest.raises(ConfigError, match=words):
        points_in_space(UR5, mocap(**options))


# out and back, 1.5 rad a joint in 3.2 s
PHASE = (1 - np.cos(np.linspace(0, 2 * np.pi, 321))) / 2
MOTION = np.array([0.6, -4.6, 0.6]) + PHASE[:, None] * np.array([1.5, 1.3, 1.4])


def recording(noise: float = 0.0, seed: int = 3) -> np.ndarray:
    """(321, 9, 3) m in the base frame."""
    places = ARM.to_base(marker_places(MOTION, PLACES, ARM.chain)).reshape(-1, 9, 3)
    return places + noise * default_rng(seed).standard_normal(places.shape)


def of_plane(
    positions: np.ndarray,
    template: np.ndarray = PLACES,
    take: str = "",
) -> JointTrack:
    return track(positions, points_in_plane(ARM, template, 0.01), max_gap=10, take=take)


def test_without_noise_the_joint_angles_are_exact_where_a_link_is_hidden_too():
    positions = recording()
    exact = of_plane(positions)
    positions[40:90, 3:6] = np.nan
    hidden = of_plane(positions)

    assert_allclose(exact.q, MOTION, atol=1e-10)
    assert exact.residual.max() < 1e-10
    assert not any(exact.counts.values())
    assert exact.samples == positions.shape[0] * 9
    assert_allclose(hidden.q, MOTION, atol=1e-10)
    assert hidden.counts["missing"] == 150 and not hidden.counts["interpolated"]


def test_a_base_that_is_registered_wrongly_shows_in_the_residual():
    shifted = of_plane(recording() + np.array([1e-3, 0.0, 0.0]))
    assert 1e-4 < np.median(shifted.residual) < 1e-3
    assert np.abs(shifted.q - MOTION).max() > 1e-3


def test_labels_swapped_within_and_between_links_are_put_right_and_counted():
    clean = recording(2e-4)
    swapped = clean.copy()
    for frames, markers, labels in (
        (slice(40, 90), [0, 1], [1, 0]),
        (slice(150, 230), [5, 6], [6, 5]),
        (slice(10), [6, 7, 8], [8, 6, 7]),
    ):
        swapped[frames, markers] = clean[frames, labels]
    reference = of_plane(clean)
    repaired = of_plane(swapped)

    assert_allclose(repaired.q, reference.q, atol=1e-9)
    relabelled = 2 * 50 + 2 * 80 + 3 * 10
    assert repaired.counts == reference.counts | {"relabelled": relabelled}


def test_a_reflection_with_a_label_is_rejected_and_the_rest_of_the_markers_decide():
    ghost = recording()
    ghost[200:205, 7] += 0.05
    solved = of_plane(ghost)
    assert_allclose(solved.q, MOTION, atol=1e-10)
    assert (solved.counts["rejected"], solved.counts["two_marker_fits"]) == (5, 5)


def test_short_gaps_are_filled_linearly_counted_and_have_no_residual():
    gap = recording()
    gap[50:60, 6:] = np.nan
    gap[:3] = np.nan
    filled = of_plane(gap)

    line = np.linspace(MOTION[49], MOTION[60], 12)[1:-1]
    assert_allclose(filled.q[50:60], line, atol=1e-10)
    for first in filled.q[:3]:
        assert_allclose(first, MOTION[3], atol=1e-10)
    assert (filled.counts["interpolated"], filled.counts["held"]) == (10, 3)
    assert np.isnan(filled.residual).sum() == 13

    gap[60, 6:] = np.nan
    with pytest.raises(RecordingError, match=r"take-7.*50 to 60"):
        of_plane(gap, take="take-7")


def test_gaps_of_turning_joints_are_filled_the_short_way_round_and_of_sliding_ones_as_they_are():
    turning = [3.1, np.nan, -3.1]
    sliding = [0.0, np.nan, 3.8]
    q = np.stack([turning, sliding], axis=1)
    solved = np.array([True, False, True])
    is_sliding = np.array([False, True])

    filled, counts = fill_gaps(q, solved, is_sliding, 1, "t")

    assert_allclose(filled[:, 0], [3.1, np.pi, 2 * np.pi - 3.1])
    assert_allclose(filled[:, 1], [0.0, 1.9, 3.8])
    assert counts == {"interpolated": 1, "held": 0}


LINE = np.array([PLACES[0], [[0, 0, 0.02], [0, 0, 0.06], [0, 0, 0.1]], PLACES[2]])


CLEAN = recording()[:20]


@pytest.mark.parametrize(
    ("positions", "template", "error", "words"),
    [
        (CLEAN * 1000, PLACES, RecordingError, "fit the arm"),
        (CLEAN[:, ::-1], PLACES, RecordingError, "check the template, the labels"),
        (np.full((5, 9, 3), np.nan), PLACES, RecordingError, "fit the arm"),
        (CLEAN[:0], PLACES, RecordingError, "no frame"),
        (CLEAN, LINE, ConfigError, "in line"),
        (CLEAN, PLACES[:2], ConfigError, "three markers"),
    ],
)
def test_markers_that_never_fit_and_templates_that_decide_no_angle_are_refused(
    positions,
    template,
    error,
    words,
):
    with pytest.raises(error, match=words):
        of_plane(positions, template)
