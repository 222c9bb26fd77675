"""Names of the filters that are compared."""

from collections.abc import Iterable

NONE = "none"  # the training takes' mean and covariance at each step, whatever is measured
MEMORY = "memory"  # linear, of the training takes' covariance and their autocorrelation
CLOSED = "_closed"  # after a model's name: its closed-loop form; the open one has the name itself


def closed(model: str) -> str:
    """Name the filter of the closed-loop form of ``model``."""
    return model + CLOSED


def models_of(filters: Iterable[str]) -> list[str]:
    """Return the models whose open-loop form is among ``filters``."""
    return [n for n in filters if n not in (NONE, MEMORY) and not n.endswith(CLOSED)]
