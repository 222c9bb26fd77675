"""A case: one way to decide everything that the paper or a user leaves open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from pipeline.filtering.particle_filter import FilterOptions
from pipeline.models.options import Options

# the paper's models, the first being the one that the others are compared with
KINDS = ("additive", "wishart", "gaussian")


class ModelCase(NamedTuple):
    """What of a case bears on the fit, the realisations and the predictions of one model."""

    options: Options
    mode: str
    measurement: float
    draw: int
    closed: bool  # whether in a closed loop, too or, of a filter, at all


class FilterCase(NamedTuple):
    """What of a case bears on the filter of one model on one take."""

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
    closed: bool = False  # whether the paper's models are filtered in a closed loop too

    def model_case(self, name: str) -> ModelCase:
        """The part for the model ``name``."""
        closed = self.closed and name in KINDS
        return ModelCase(self.models[name], self.mode, self.measurement, self.draw, closed)

    def filter_case(self, name: str, take: str, closed: bool) -> FilterCase:
        """The part for the filter of the model ``name`` on ``take``, in a closed loop or an open
        one.
        """
        model = ModelCase(self.models[name], "", 1.0, self.draw, closed)
        return FilterCase(take, model, self.clock, self.filter)

    def batch_of(self, takes: list[str], count: int) -> list[str]:
        """Of all test ``takes`` the batch of ``count`` that the filter runs on; none where there
        are not enough.
        """
        batch = takes[self.batch * count : (self.batch + 1) * count]
        return batch if len(batch) == count else []

    def with_wishart(self, **changes: object) -> Case:
        """This case with other options of the Wishart model."""
        wishart = replace(self.models["wishart"], **changes)
        return replace(self, models=self.models | {"wishart": wishart})


def paper_models(options: dict[str, Options]) -> dict[str, Options]:
    """Of the options of models the first of each of the paper's kinds, by kind and in their
    order.
    """
    by_kind = {model.kind: model for model in reversed(list(options.values()))}
    return {kind: by_kind[kind] for kind in KINDS if kind in by_kind}
