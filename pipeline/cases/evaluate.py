"""Cases worked out: the models fitted, realised and scored, the filters run, and the evidence of
each case; what several cases have in common is worked out once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pipeline.cases.case import KINDS, Case, FilterCase, ModelCase
from pipeline.cases.evidence import Evidence, case_evidence
from pipeline.cases.fits import Outcome, outcome
from pipeline.cases.recordings import Camera, Takes
from pipeline.core import filters as names
from pipeline.core import rng
from pipeline.core.errors import DegenerateFilterError, ModelDomainError, SingularJacobianError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, Start, particle_filter
from pipeline.models.closed_loop import mean_path
from pipeline.models.model import Commands, MotionModel, open_loop

Loop = tuple[MotionModel, Commands]  # a fitted model and what it is commanded
# number of the take, what bears on its filter, the loop, the take's measurements
Trial = tuple[int, FilterCase, Loop, Measurements]
Run = Callable[[Callable, Sequence], Iterable]  # as the built-in map: trials, in order


@dataclass(frozen=True)
class Recordings:
    """What every case is worked out from, and how large and with which random numbers."""

    takes: Takes
    cameras: Mapping[str, Camera]  # by clock or name; none where there is no depth camera
    rate: float  # 1/s, of the motion
    filtered: int  # takes that the filter runs on
    realizations: int
    stream: tuple[int, str]  # seed and name of the random numbers

    @property
    def start(self) -> Start:
        """The law of the first pose."""
        first = self.takes.poses[:, 0]
        return Start(first.mean(axis=0), np.cov(first.T))


def evaluate(
    cases: Sequence[Case], recordings: Recordings, run: Run
) -> list[tuple[Evidence, list[str]]]:
    """The evidence of every case, and what its models and filters refused; ``run`` maps a function
    over trials. Filters run with the paper's models alone.
    """
    cameras = recordings.cameras
    takes = list(next(iter(cameras.values())).takes) if cameras else []
    parts = [case.model_case(name) for case in cases for name in case.models]
    # options are no keys of a dict; what is written like another is equal to it
    models = {repr(part): part for part in parts}
    function = partial(_outcome, recordings=recordings)
    outcomes = dict(zip(models, run(function, list(models.values())), strict=True))
    trials: dict[str, Trial] = {}
    for case in cases:
        for name in filter(case.models.__contains__, KINDS):
            loops = _loops(outcomes[repr(case.model_case(name))], recordings)
            for take in case.batch_of(takes, recordings.filtered):
                measured = cameras[case.clock].takes[take]
                for closed, loop in loops.items():
                    part = case.filter_case(name, take, closed)
                    trials[repr(part)] = (takes.index(take), part, loop, measured)
    function = partial(_posterior, recordings=recordings)
    posteriors = dict(zip(trials, run(function, list(trials.values())), strict=True))
    results = []
    for case in cases:
        batch = case.batch_of(takes, recordings.filtered)
        fared = {name: outcomes[repr(case.model_case(name))] for name in case.models}
        filtered = {
            names.closed(name) if closed else name: {
                take: posteriors[repr(case.filter_case(name, take, closed))] for take in batch
            }
            for name in fared
            if name in KINDS
            for closed in _loops(fared[name], recordings)
        }
        camera = cameras.get(case.clock)
        dt = 1 / recordings.rate
        results.append(case_evidence(case, recordings.takes, fared, camera, filtered, dt))
    return results


def _outcome(case: ModelCase, recordings: Recordings) -> Outcome:
    # equal numbers in every case, so that what differs is the case's
    seed, name = recordings.stream
    stream = rng.stream(seed, f"{name}.{case.options.kind}", case.draw)
    return outcome(case, recordings.takes, recordings.realizations, stream)


def _loops(fared: Outcome, recordings: Recordings) -> dict[bool, Loop]:
    """The loops that a model is filtered in, by whether they are closed."""
    recorded, loops = recordings.takes.training, {}
    if fared.model is not None:
        loops[False] = (fared.model, open_loop(recorded.v))
    if fared.closed is not None:
        commands = mean_path(recorded).commands(fared.closed.share)
        loops[True] = (fared.closed.estimate.model, commands)
    return loops


def _posterior(trial: Trial, recordings: Recordings) -> Posterior | str:
    """The filter's posterior on one take, or the reason why there is none."""
    (number, case, (model, commands), measured), (seed, name) = trial, recordings.stream
    kind, dt = case.model.options.kind, 1 / recordings.rate
    filtered = names.closed(kind) if case.model.closed else kind
    stream = rng.stream(seed, f"{name}.filter.{filtered}", case.model.draw, number)
    try:
        loop = (model, recordings.takes.training.chain, commands, dt)
        return particle_filter(*loop, recordings.start, measured, case.options, stream)
    except (DegenerateFilterError, ModelDomainError, SingularJacobianError) as error:
        return str(error)
