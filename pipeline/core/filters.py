"""Names of the paper's models and of the filters that are compared."""

from collections.abc import Iterable

# kinds of the paper's models; the first is the reference of comparisons
KINDS = ("additive", "wishart", "gaussian")
NONE = "none"  # training mean: mean and covariance of the training takes, without measurements
MEMORY = "memory"  # linear filter with the covariance and autocorrelation of the training takes
SPEED = "speed"  # law of the joint speed without a Jacobian, the control of the matrix models
CLOSED = "_closed"  # suffix of a model's closed-loop filter; the open-loop one has the model's name


def closed(model: str) -> str:
    """Name of the filter of ``model`` in a closed loop."""
    return model + CLOSED


def models_of(filters: Iterable[str]) -> list[str]:
    """Return the models whose open-loop filter is among ``filters``."""
    return [n for n in filters if n not in (NONE, MEMORY) and not n.endswith(CLOSED)]
