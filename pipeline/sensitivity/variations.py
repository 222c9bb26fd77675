"""What the paper leaves open, as one case in which all of it is decided, and the same case with one decision taken otherwise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, get_args

from pipeline import schema
from pipeline.filtering.particle_filter import FilterOptions
from pipeline.filtering.resampling import SCHEMES
from pipeline.motion.control import consistent
from pipeline.motion.decomposition import Computed
from pipeline.sensitivity.cameras import CLOCKS

KINDS = ("additive", "wishart", "gaussian")  # the paper's models, the first being the one that the others are compared with
RATIO_FACTORS = (0.1, 0.3, 3.0, 10.0)  # on α₂/α₁
FLOORS = (0.1, 0.3)  # of B⁻¹
THRESHOLDS = (0.25, 1.0)  # share of the particles; 1 resamples at every step
PARTICLE_FACTORS = (0.1, 0.3, 3.0)
MEASUREMENT_FACTORS = (0.0, 0.5, 2.0)


class ModelCase(NamedTuple):
    """What of a case bears on the fit, the realisations and the predictions of one model."""

    options: schema.Model
    mode: str
    measurement: float
    draw: int


class FilterCase(NamedTuple):
    """What of a case bears on the filter of one model on one take."""

    take: str
    model: schema.Model
    clock: str
    options: FilterOptions
    draw: int


@dataclass(frozen=True)
class Case:
    """One way to decide everything."""

    models: dict[str, schema.Model]  # options of the paper's models by kind
    filter: FilterOptions
    mode: str  # of the realisations: one_step or free_running
    clock: str = "aligned"  # one of CLOCKS
    measurement: float = 1.0  # factor on the measurement noise that scores add to every step; 0 for none
    batch: int = 0  # which test takes the filter runs on
    draw: int = 0  # which random numbers

    def of_model(self, kind: str) -> ModelCase:
        """The part for the model ``kind``."""
        return ModelCase(self.models[kind], self.mode, self.measurement, self.draw)

    def of_filter(self, kind: str, take: str) -> FilterCase:
        """The part for the filter of the model ``kind`` on ``take``."""
        return FilterCase(take, self.models[kind], self.clock, self.filter, self.draw)

    def takes_of(self, takes: list[str], count: int) -> list[str]:
        """Of all test ``takes`` the batch of ``count`` that the filter runs on; none where there are not enough."""
        batch = takes[self.batch * count : (self.batch + 1) * count]
        return batch if len(batch) == count else []

    def with_wishart(self, **changes: object) -> Case:
        """This case with other options of the Wishart model."""
        return replace(self, models=self.models | {"wishart": replace(self.models["wishart"], **changes)})


class Variation(NamedTuple):
    """A case with the name of what is decided otherwise in it, and how; both are empty for the base case."""

    setting: str
    value: str
    case: Case


def paper_models(options: dict[str, schema.Model]) -> dict[str, schema.Model]:
    """Of the options of ``models`` the first of each of the paper's kinds, by kind and in their order."""
    found = {kind: [of_model for of_model in options.values() if of_model.kind == kind] for kind in KINDS}
    return {kind: of_kind[0] for kind, of_kind in found.items() if of_kind}


def variations(base: Case, lever: float) -> list[Variation]:
    """The base case and after it every variation of one decision that makes a difference to its options.

    ``lever`` in m is the distance at which the given decomposition diag(lever, lever, 1) counts an error in angle like one in position.
    """
    return [Variation("", "", base), *(variation for variation in _all(base, lever) if variation.case != base)]


def _all(base: Case, lever: float) -> Iterator[Variation]:
    yield Variation("estimator", "likelihood", replace(base, models={kind: consistent(of_kind) for kind, of_kind in base.models.items()}))
    wishart = base.models.get("wishart")
    if wishart is not None:
        if wishart.estimator == "paper":
            for factor in RATIO_FACTORS:
                yield Variation("weights", f"× {factor:g}", base.with_wishart(ratio_factor=factor * wishart.ratio_factor))
            for floor in FLOORS:
                yield Variation("floor", f"{floor:g}", base.with_wishart(floor=floor))
        for decomposition in get_args(Computed):
            yield Variation("decomposition", decomposition, base.with_wishart(decomposition=decomposition, left=None))
        left = [[lever, 0.0, 0.0], [0.0, lever, 0.0], [0.0, 0.0, 1.0]]
        yield Variation("decomposition", "given", base.with_wishart(decomposition="given", left=left))
    for mode in ("one_step", "free_running"):
        yield Variation("realisations", mode.replace("_", " "), replace(base, mode=mode))
    for factor in MEASUREMENT_FACTORS:
        yield Variation("noise in scores", f"× {factor:g}", replace(base, measurement=factor))
    for clock in CLOCKS:
        yield Variation("clock", clock, replace(base, clock=clock))
    for scheme in SCHEMES:
        yield Variation("resampling", scheme, replace(base, filter=replace(base.filter, resampling=scheme)))
    for threshold in THRESHOLDS:
        yield Variation("threshold", f"{threshold:g}", replace(base, filter=replace(base.filter, threshold=threshold)))
    for factor in PARTICLE_FACTORS:
        count = max(1, round(factor * base.filter.particles))
        yield Variation("particles", f"{count}", replace(base, filter=replace(base.filter, particles=count)))
    yield Variation("chance", "other draws", replace(base, draw=base.draw + 1))
    yield Variation("chance", "other takes", replace(base, batch=base.batch + 1))
