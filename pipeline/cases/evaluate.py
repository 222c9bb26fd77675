"""Evaluation of cases: the models fitted, realised and scored, the filters run, and the evidence of
each case; parts that several cases have in common are evaluated once.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

from pipeline.cases.case import KINDS, Choices, Recordings
from pipeline.cases.evidence import Evidence, Outcome, case_evidence, outcome
from pipeline.core import filters as names
from pipeline.core import rng
from pipeline.core.errors import DegenerateFilterError, ModelDomainError, SingularJacobianError
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, particle_filter
from pipeline.models.closed_loop import mean_path
from pipeline.models.model import Commands, MotionModel, open_loop

Loop = tuple[MotionModel, Commands]  # a fitted model and its commands
# number of the take, its part of the case, the loop, the take's measurements
Trial = tuple[int, Choices, Loop, Measurements]
Run = Callable[[Callable, Sequence], Iterable]  # as the built-in map: trials, in order


def evaluate(
    cases: Sequence[Choices], recordings: Recordings, run: Run
) -> list[tuple[Evidence, list[str]]]:
    """Return the evidence and refusals of every case; only the paper's models are filtered."""
    cameras, dt, count = recordings.cameras, 1 / recordings.rate, recordings.filtered
    takes = list(next(iter(cameras.values())).takes) if cameras else []

    def mapped(function: Callable, trials: Mapping[str, object]) -> dict:
        results = run(partial(function, recordings=recordings), list(trials.values()))
        return dict(zip(trials, results, strict=True))

    # options are no keys of a dict; equal ones have equal representations
    models = {repr(part): part for case in cases for part in map(case.model_case, case.models)}
    outcomes = mapped(_outcome, models)
    loops = {key: _loops(fared, recordings) for key, fared in outcomes.items()}
    trials: dict[str, Trial] = {}
    filters: list[dict[str, dict[str, str]]] = []  # of each case: filter → take → key of its trial
    for case in cases:
        filters.append({})
        batch = takes[case.batch * count : (case.batch + 1) * count]
        for name in filter(KINDS.__contains__, case.models):
            for closed, loop in loops[repr(case.model_case(name))].items():
                own = filters[-1].setdefault(names.closed(name) if closed else name, {})
                part = case.filter_case(name, closed)
                for take in batch if len(batch) == count else []:
                    own[take], measured = f"{take} {part!r}", cameras[case.clock].takes[take]
                    trials[own[take]] = (takes.index(take), part, loop, measured)
    posteriors = mapped(_posterior, trials)
    results = []
    for case, by_filter in zip(cases, filters, strict=True):
        fared = {name: outcomes[repr(case.model_case(name))] for name in case.models}
        filtered = {
            name: {take: posteriors[key] for take, key in own.items()}
            for name, own in by_filter.items()
        }
        camera = cameras.get(case.clock)
        results.append(case_evidence(case, recordings.takes, fared, camera, filtered, dt))
    return results


def _outcome(case: Choices, recordings: Recordings) -> Outcome:
    # equal numbers in every case, so that a difference is the case's
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
    kind, takes = case.options.kind, recordings.takes
    filtered = names.closed(kind) if case.closed else kind
    stream = rng.stream(seed, f"{name}.filter.{filtered}", case.draw, number)
    loop = (model, takes.training.chain, commands, 1 / recordings.rate)
    try:
        return particle_filter(*loop, takes.start, measured, case.filter, stream)
    except (DegenerateFilterError, ModelDomainError, SingularJacobianError) as error:
        return str(error)
