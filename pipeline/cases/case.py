"""A case: one way to decide everything that the paper or a user leaves open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from pipeline.filtering.particle_filter import FilterOptions
from pipeline.models.options import Options

# the paper's models, the first being the one that the others are compared with
KINDS = ("additive", "wishart", "gaussian")


class ModelCase(NamedTuple):
    """Part of a case that fit, realisations and predictions of one model depend on."""

    options: Options
    mode: str
    measurement: float
    draw: int
    closed: bool  # in a closed loop too or, of a filter, at all


class FilterCase(NamedTuple):
    """Part of a case that the filter of one model on one take depends on."""

    take: str
    model: ModelCase
    clock: str
    options: FilterOptions


@dataclass(frozen=True)
class Case:
    """One way to decide everything."""

    models: dict[str, Options]  # by name; those of the paper by their kind
    filter: FilterOptions
    mode: str  # of the realisations: one_step or free_running
    clock: str = "aligned"  # which camera of the recordings, by its name there
    # factor on the measurement noise that scores add to every step; 0 for none
    measurement: float = 1.0
    batch: int = 0  # which test takes the filter runs on
    draw: int = 0  # which random numbers
    closed: bool = False  # filters the paper's models in a closed loop too

    def model_case(self, name: str) -> ModelCase:
        """The part for the model ``name``."""
        closed = self.closed and name in KINDS
        return ModelCase(self.models[name], self.mode, self.measurement, self.draw, closed)

    def filter_case(self, name: str, take: str, closed: bool) -> FilterCase:
        """The part for the filter of the model ``name`` on ``take``."""
        model = ModelCase(self.models[name], "", 1.0, self.draw, closed)
        return FilterCase(take, model, self.clock, self.filter)

    def batch_of(self, takes: list[str], count: int) -> list[str]:
        """The ``count`` of the test ``takes`` that the filter runs on; none of too few."""
        batch = takes[self.batch * count : (self.batch + 1) * count]
        return batch if len(batch) == count else []

    def with_wishart(self, **changes: object) -> Case:
        """This case with other options of the Wishart model."""
        wishart = replace(self.models["wishart"], **changes)
        return replace(self, models=self.models | {"wishart": wishart})


def paper_models(options: dict[str, Options]) -> dict[str, Options]:
    """The first of the options of models of each of the paper's kinds, by kind in their order."""
    by_kind = {model.kind: model for model in reversed(list(options.values()))}
    return {kind: by_kind[kind] for kind in KINDS if kind in by_kind}
