"""Noise of one run over the commanded speed, with blocks of the run in place of takes.

A block is at least twice as long as the autocorrelation time of the squared noise, so that blocks
are nearly independent, and has fast and slow steps of the run. Each block compares its own fast
and slow steps: a disturbance that lasts longer than a block enlarges both.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from scipy.special import chdtri, nctdtr, stdtrit

from pipeline.core.errors import ModelDomainError
from pipeline.statistics.curves import RECOGNISED, VARYING, WINDOWS, variation
from pipeline.statistics.densities import SPACING, autocorrelation_time
from pipeline.statistics.takes import TAILS, Difference, paired_difference

MOST_BLOCKS = 40
LEAST_BLOCKS = 4
LEAST_SHARE = (
    0.1  # of a block, of the run's fastest and of its slowest third of the steps
)
TWICE = np.log(2.0)  # ln of the ratio whose detection the power states


class SpeedEffect(NamedTuple):
    """Noise of a joint over its speed: ``difference`` is the mean over the blocks of ln σ_fast −
    ln σ_slow between the block's steps of the fastest and of the slowest third of the run, with
    Student's interval; ``power`` is the probability that twice the standard deviation at fast steps
    is detected. ``variation`` is the variation of the standard deviation over WINDOWS parts.
    """

    blocks: int
    difference: Difference
    power: float
    variation: float


def speed_effect(noise: ndarray, speeds: ndarray, margin: float) -> SpeedEffect:
    """Return the effect of ``speeds`` (M,) ≥ 0 on ``noise`` (M,) in rad, where ``margin`` ≥ 0 is
    the least ln of a ratio that is detected. A run without LEAST_BLOCKS blocks has no difference
    (NaN) and no power.
    """
    parts = [part.std() for part in np.array_split(noise, WINDOWS)]
    over_parts = variation(np.array(parts))
    thirds = slowest_and_fastest_third(speeds)
    blocks = blocks_of_run(noise, thirds)
    if not blocks:
        return SpeedEffect(0, Difference(np.nan), 0.0, over_parts)

    logs = []
    for steps in thirds:
        stds = [noise[block][steps[block]].std() for block in blocks]
        with np.errstate(divide="ignore"):  # no noise
            logs.append(np.log(stds))
    slow, fast = logs
    difference = paired_difference(fast, slow)
    power = 0.0
    if np.isfinite(difference.standard_error):
        power = detection_power(TWICE - margin, difference)
    return SpeedEffect(len(blocks), difference, power, over_parts)


def blocks_of_run(noise: ndarray, thirds: ndarray) -> list[slice]:
    """Return the greatest number of equal blocks of ``noise`` (M,), at most MOST_BLOCKS, that are
    nearly independent and have LEAST_SHARE of each of the ``thirds`` (2, M) of the steps; [] if
    fewer than LEAST_BLOCKS are possible.
    """
    try:
        time = autocorrelation_time((noise - noise.mean())[:, None] ** 2)
    except ModelDomainError:  # no noise
        return []
    most = min(MOST_BLOCKS, int(len(noise) / (SPACING * time)))
    for count in range(most, LEAST_BLOCKS - 1, -1):
        ends = np.linspace(0, len(noise), count + 1).astype(int)
        shares = np.add.reduceat(thirds, ends[:-1], axis=1, dtype=int) / np.diff(ends)
        if shares.min() >= LEAST_SHARE:
            return [slice(*pair) for pair in pairwise(ends)]
    return []


def slowest_and_fastest_third(speeds: ndarray) -> ndarray:
    """Return the masks (2, M) of the slowest and of the fastest third of the steps."""
    third = len(speeds) // 3
    order = np.argsort(speeds, kind="stable")
    masks = np.zeros((2, len(speeds)), dtype=bool)
    masks[0, order[:third]] = True
    masks[1, order[-third:]] = True
    return masks


def detection_power(effect: float, difference: Difference) -> float:
    """Return the probability that Student's interval of a mean with the standard error of
    ``difference`` is above 0 where the true mean is ``effect``.
    """
    quantile = stdtrit(difference.degrees, TAILS[1])
    centre = effect / difference.standard_error
    return float(1.0 - nctdtr(difference.degrees, centre, quantile))


def least_variation(joints: int) -> float:
    """Return the limit that the variation of WINDOWS independent values with the true variation
    VARYING falls short of with a probability of 1 − RECOGNISED in any of ``joints``.
    """
    chi_squared = chdtri(WINDOWS - 1, RECOGNISED ** (1 / joints))
    return float(VARYING * np.sqrt(chi_squared / WINDOWS))
