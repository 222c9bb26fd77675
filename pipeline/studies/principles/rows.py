"""Each principle of the laboratory as rows: what is measured, what it is held against, whether
it is kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.laboratory.options import TrajectoryOptions
from pipeline.models.norm import frobenius
from pipeline.studies.principles.motion import Moved, correlations, lasting
from pipeline.studies.published import Published

COLUMNS = ["principle", "quantity", "unit", "limit", "value", "kept"]
NEAR = 0.1  # of a correlation to the published one
ALIKE = 1.5  # factor between standard deviations
BEST = 0.02  # share of the random paths that may have a smaller misfit
FRAME = 1 / 30  # s, between two frames of a depth camera

Row = tuple[str, str, str, float, float, bool]


def path_rows(chain: PlanarChain, motion: TrajectoryOptions, u: float) -> list[Row]:
    """The path's speed, conditioning (bound ``u`` in 1/m and 1 mixed) and rest."""
    start, end = np.array(motion.folded), np.array(motion.extended)
    moving = motion.duration / 2 - 2 * motion.rest
    peak = float(np.abs(end - start).max() / (moving - motion.ramp))
    q = start + np.linspace(0, 1, 101)[:, None] * (end - start)
    norm, limit = float(frobenius(chain.inverse_jacobian(q)).max()), float(chain.max_speed.min())
    path = "path at the speed limit, well conditioned"
    return [
        (path, "peak speed of the joints", "rad/s", limit, peak, 0.95 * limit <= peak <= limit),
        (path, "greatest norm of the inverse Jacobian", "1/m and 1 mixed", u, norm, norm <= u),
        (path, "share of the steps at rest", "1", np.nan, 4 * motion.rest / motion.duration, True),
    ]


def choice_rows(own: float, others: Sequence[float]) -> list[Row]:
    """The place of the path's misfit ``own`` among the ``others`` of random paths."""
    better = sum(other < own for other in others) / max(len(others), 1)
    choice = "path on which a sway can have the published covariance"
    return [
        (choice, "random paths that the arm can take", "1", np.nan, float(len(others)), True),
        (choice, "share of them with a smaller misfit", "1", BEST, better, better <= BEST),
    ]


def left_for_clearance(covariance: np.ndarray) -> float:
    """Share of the last joint's variance in ``covariance`` (n, n) that the others leave open."""
    first, last = covariance[:-1, :-1], covariance[:-1, -1]
    return float(1 - last @ np.linalg.solve(first, last) / covariance[-1, -1])


def noise_rows(arm: Moved, stated: Published) -> list[Row]:
    """Correlations and sizes of the noise, and the share that is left to the clearance."""
    n, rows, wanted = len(arm.covariance), [], stated.covariance
    noise = "noise correlated as published, sized alike"
    pairs = [f"{i + 1}{j + 1}" for i in range(n) for j in range(i + 1, n)]
    both = zip(correlations(wanted), correlations(arm.covariance), strict=True)
    for pair, (other, own) in zip(pairs, both, strict=True):
        near = bool(abs(own - other) <= NEAR)
        rows.append((noise, f"correlation {pair} of ω", "1", other, own, near))
    sizes = zip(stated.spread, np.sqrt(np.diag(arm.covariance)), strict=True)
    for j, (other, own) in enumerate(sizes, start=1):
        alike = bool(abs(np.log(own / other)) <= np.log(ALIKE))
        rows.append((noise, f"standard deviation {j} of ω", "rad", other, own, alike))
    left = left_for_clearance(wanted)
    own = left_for_clearance(arm.covariance) * arm.covariance[-1, -1] / wanted[-1, -1]
    quantity = "variance of joint 3 that the others do not explain, over the published one"
    rows.append(
        ("clearance at most what is left for it", quantity, "1", left, own, bool(own <= left))
    )
    return rows


def drive_rows(
    joints: Sequence[str], greatest: np.ndarray, mean: np.ndarray, std: np.ndarray
) -> list[Row]:
    """The motors' ``greatest`` torques (n,) against ``mean`` and ``std`` (K, n) of what the motion
    asks, in N·m.
    """
    needed = (np.abs(mean) + std).mean(axis=0)
    return [
        (
            "sway that the motors can drive",
            f"torque of {name} at full speed: mean and one standard deviation",
            "N·m",
            most,
            own,
            bool(own <= most),
        )
        for name, most, own in zip(joints, greatest, needed, strict=True)
    ]


def lasting_rows(joints: Sequence[str], arm: Moved, rate: float) -> list[Row]:
    """How much of a deviation is left a step and a frame of a depth camera later; no limit, as it
    is a free choice: the survey varies it.
    """
    steps = np.array([1, round(FRAME * rate)])
    later = ("a step", "a depth camera's frame")
    return [
        (
            "deviations that last as the servo lets them",
            f"correlation of the deviation of {name} with itself {what} later",
            "1",
            np.nan,
            own,
            True,
        )
        for what, row in zip(later, lasting(arm.deviation, steps), strict=True)
        for name, own in zip(joints, row, strict=True)
    ]
