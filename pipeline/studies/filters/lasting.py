"""Filters beside no filter and the yardstick where a deviation lasts longer or shorter than in the
dataset: the arm alone, with white noise of both instruments.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pipeline.core import rng
from pipeline.core.filters import NONE, closed
from pipeline.filtering.particle_filter import FilterOptions, Start, particle_filter
from pipeline.models import kinds
from pipeline.models.closed_loop import mean_path
from pipeline.models.closed_loop_fit import fit_closed_loop
from pipeline.models.options import Options
from pipeline.statistics.filters import Filtered, no_filter
from pipeline.studies.filters.deviations import Deviations, deviations
from pipeline.studies.filters.linear import Filmed, linear_filters
from pipeline.studies.filters.scores import scored
from pipeline.studies.survey.conditions import Factors, disturbed
from pipeline.studies.survey.robots import Laboratory, observe


@dataclass(frozen=True)
class Sweep:
    """What every duration is filtered with."""

    laboratory: Laboratory  # its one trajectory has the name ""
    model: str  # whose closed loop is filtered
    options: Options  # of it
    filter: FilterOptions
    training: int  # takes
    test: int
    seed: int


def lasted(factor: float, sweep: Sweep) -> pd.DataFrame:
    """Rows of the table ``filters_lasting``: every lag of sway and play ``factor`` times as long.

    Equal random numbers at every factor, so that what differs is the duration.
    """
    laboratory, factors = sweep.laboratory, Factors(lasting=factor)
    dynamics, motion = disturbed(laboratory.dynamics, factors), laboratory.trajectories[""]
    takes, camera = observe(laboratory, "", factors, sweep.seed, sweep.training, sweep.test)
    # what was put in is known
    pose = laboratory.pose_noise
    recorded = replace(takes.training, known_measurement=2 * pose)
    path = mean_path(recorded)
    law = deviations(laboratory.chain, motion, dynamics, path.poses)
    filmed = Filmed(
        takes.poses,
        np.stack(list(takes.test.values())),
        list(camera.takes.values()),
        pose,
        1 / motion.rate,
        laboratory.chain,
    )
    fit = fit_closed_loop(recorded, sweep.options, kinds.estimate(recorded, sweep.options))
    first = takes.poses[:, 0]
    start, posteriors = Start(first.mean(axis=0), np.cov(first.T)), []
    for number, measured in enumerate(filmed.frames):
        stream = rng.stream(sweep.seed, "filters.lasting", number)
        posteriors.append(
            particle_filter(
                fit.estimate.model,
                laboratory.chain,
                path.commands(fit.share),
                filmed.dt,
                start,
                measured,
                sweep.filter,
                stream,
            )
        )
    lag = round(motion.rate / laboratory.clock.rate)
    filters = {
        NONE: no_filter(filmed.training, filmed.test),
        closed(sweep.model): Filtered(
            np.stack([posterior.mean for posterior in posteriors]) - filmed.test,
            np.stack([posterior.covariance for posterior in posteriors]),
            filmed.pose,
        ),
    } | linear_filters(filmed, law, lag)
    resting = np.append(~np.any(recorded.v, axis=1), True)
    rows = scored(filters, laboratory.joints, resting)
    kept = left(law, lag)
    by_joint = dict(zip(laboratory.joints, kept, strict=True))
    return rows.assign(
        factor=factor,
        sway_time=dynamics.sway_time,
        share=fit.share,
        left=rows["joint"].map(by_joint).fillna(kept.min()),
    )


def left(law: Deviations, steps: int) -> np.ndarray:
    """(n,) correlation of each joint's deviation with itself so many ``steps`` later, over the
    motion.
    """
    power = np.einsum("kiki->i", law.covariance)
    return np.einsum("kiki->i", law.covariance[:-steps, :, steps:]) / power
