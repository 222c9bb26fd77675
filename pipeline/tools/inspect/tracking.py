"""Units, tracking error and motions of the measured and commanded angles of a joint log."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil, comb, log2

import numpy as np

from pipeline.core.angles import MOST_TURNS, TURN, unwrap, whole_turns
from pipeline.core.errors import PipelineError, RecordingError
from pipeline.core.options.dataset import JointLogSection
from pipeline.formats.delimited import ANGLE_UNITS, TIME_UNITS
from pipeline.formats.depth.frame_names import EPOCH
from pipeline.formats.depth.image import dropped_frames
from pipeline.formats.joints.log import ANGLES, JointLog
from pipeline.recordings import commands, movement
from pipeline.recordings.lags import lag
from pipeline.recordings.repetitions import excursions
from pipeline.tools.inspect.finding import Finding

RATES = 5.0, 5000.0  # Hz, range of the rates of controllers' logs
ORDER = 6  # order of the differences that estimate noise
LEAST_NOISE = 1e-8  # rad, least estimate of the noise


def in_units(
    finding: Finding,
    log: JointLog,
    timed: object = False,
    angled: object = False,
) -> JointLog:
    """Return ``log`` in s and rad; ask for units that are not stated (``timed``, ``angled``)."""
    second = 1.0 if timed else _likely_second(finding, log.time)
    radian = 1.0 if angled else _likely_radian(finding, log.signals)
    signals = {name: values * radian for name, values in log.signals.items()}
    if "actual" in signals:
        sound = movement.without_damage(signals["actual"])
        finding.facts["range"] = [
            ends(axis=0).tolist() for ends in (sound.min, sound.max)
        ]
    return replace(log, time=log.time * second, signals=signals)


def _likely_second(finding: Finding, time: np.ndarray) -> float:
    """Return the likely unit of ``time`` (N,) in s, 1 if no unit gives the rate of a controller;
    ask for it.
    """
    step = float(np.median(np.diff(time)))
    for unit, second in TIME_UNITS.items():
        usual_rate = RATES[0] <= 1 / (step * second) <= RATES[1]
        if usual_rate and time[-1] * second < EPOCH.stop:
            finding.ask("time_unit", unit, step=f"{step:g}")
            return second
    limits = f"at a rate from {RATES[0]:g} to {RATES[1]:g} Hz in none of the units"
    finding.ask("time_unit", None, step=f"{step:g}, {limits}")
    return 1.0


def _likely_radian(finding: Finding, signals: Mapping[str, np.ndarray]) -> float:
    """Return the likely unit of all angles in rad, by the measured angles without damaged cells;
    ask for it.
    """
    angles = signals.get("actual")
    if angles is None:
        angles = np.hstack([*signals.values()])
    greatest = float(np.abs(movement.without_damage(angles)).max())
    if greatest <= MOST_TURNS * TURN:
        finding.ask("angle_unit", "rad", greatest=greatest)
        return 1.0
    if (angles % 1).any():
        finding.ask("angle_unit", "deg", greatest=greatest)
        return ANGLE_UNITS["deg"]
    counts = 2 ** ceil(log2(greatest + 1))
    ends = {"least": angles.min(), "greatest": angles.max()}
    finding.facts["counts_per_turn"] = counts
    finding.ask("encoder_counts", counts=counts, angle=TURN / counts, **ends)
    return TURN / counts


def add_tracking(
    finding: Finding,
    log: JointLog,
    labels: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Add the tracking error of the measured and commanded angles of ``log`` in s and rad, the
    command's motions, and options for which the signals agree. ``labels`` of the columns of each
    signal stand in errors for the names of the joints.
    """
    time = log.time - log.time[0]
    steps = np.diff(time)
    without_gaps = steps[steps < 2 * np.median(steps)]
    rate = float(f"{1 / without_gaps.mean():.4g}")
    if not RATES[0] / 100 < rate <= RATES[1]:  # the times are in an unknown unit
        return
    labels = labels or {}
    try:
        actual, target = _continuous_angles(finding, log, time, rate, labels)
        movement.require_fresh(actual, target, rate)
    except PipelineError as error:
        finding.stops.append(str(error))
        return
    actual = actual + TURN * whole_turns(target, actual)

    pairing = commands.find_pairing(actual, target, rate)
    suspects = commands.suspects(pairing, actual, target, rate)
    for quantity, option, value, without in suspects:
        finding.ask("pairing", value, quantity=quantity, without=without, option=option)
    actual, target = pairing.apply(actual, target)
    if fault := commands.standing_arm(actual, target):
        finding.stops.append(fault)
        return
    joints = [*labels.get("target", log.joints)]
    joints = joints or [f"joint {n}" for n in range(1, actual.shape[1] + 1)]
    if wrong := commands.wrong_commands(actual, target):
        finding.count({"wrong_commands": len(wrong)})
        finding.facts["wrong_command"] = wrong[0].reason(joints, rate)
    finding.count({"missing_samples": dropped_frames(time)})
    _add_command(finding, actual, target, rate, joints)
    _add_motions(finding, actual, target, rate)


def _continuous_angles(
    finding: Finding,
    log: JointLog,
    time: np.ndarray,
    rate: float,
    labels: Mapping[str, Sequence[str]],
) -> list[np.ndarray]:
    """Return measured and commanded angles (N, n) without jumps of whole turns, which are counted;
    raises RecordingError for angles that no arm can follow.
    """
    sound = [movement.without_damage(log.signals[name]) for name in ANGLES]
    pairing = commands.find_pairing(*sound, rate)
    factors = {"actual": 1.0, "target": abs(pairing.factor[0])}
    angles = []
    for name, factor in factors.items():
        joints = tuple(labels.get(name, log.joints))
        values = log.signals[name] * factor
        where = {"signal": name, "lines": log.lines}
        movement.require_plausible(values, time, joints, True, "rad", **where)
        values, removed = unwrap(values, time, joints, **where)
        removed += finding.gaps.get(movement.UNWRAPPED, 0)
        finding.count({movement.UNWRAPPED: removed})
        angles.append(values / factor)
    return angles


def _add_command(
    finding: Finding,
    actual: np.ndarray,
    target: np.ndarray,
    rate: float,
    joints: Sequence[str],
) -> None:
    """Add tracking error, lag and the joints that stand still; a stop if the signals disagree."""
    standing = commands.standing_joints(actual, target)
    moving = ~standing
    names = np.array(joints)[moving]
    pair = actual[:, moving], target[:, moving], rate, JointLogSection.mismatch
    try:
        commands.require_pair(*pair, names)
    except RecordingError as error:
        finding.stops.append(error.message)
    late = lag(target, actual, rate)
    if np.isfinite(late):
        missing = commands.tracking_errors(actual, target)[moving].max(initial=0.0)
        error = f"{missing:.2g} of the motion (0.9 quantile), lag {1e3 * late:.2g} ms"
        finding.facts["command"] = f"tracking error {error}"
    else:
        error = np.abs(actual - target).max()
        finding.facts["command"] = f"at rest, tracking error {error:.2g} rad"
    if standing.any():
        numbers = np.flatnonzero(standing) + 1
        finding.facts["joints_that_stand_still"] = numbers.tolist()


def _add_motions(
    finding: Finding,
    actual: np.ndarray,
    target: np.ndarray,
    rate: float,
) -> None:
    """Add the number of whole motions; the noise of the angles if the command never rests."""
    lacks = [run.lack(len(target)) for run in excursions(target, rate)]
    finding.facts["motions"] = f"{lacks.count('')} whole"
    finding.count({"motions_cut_off": sum("cut off" in lack for lack in lacks)})
    if not any("never rests" in lack for lack in lacks):
        return
    finding.ask("rest", "0")
    if len(actual) > ORDER:
        differences = np.diff(actual, ORDER, axis=0)
        power = np.mean(differences**2, axis=0).max()
        noise = float(np.sqrt(power / comb(2 * ORDER, ORDER)))
        finding.ask("pose_noise", f"{max(noise, LEAST_NOISE):.1e}")
