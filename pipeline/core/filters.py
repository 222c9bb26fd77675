"""The names of the filters that are compared: no filter at all, the linear one of the takes, and
each model's in both loops.
"""

from __future__ import annotations

from collections.abc import Iterable

NONE = "none"  # the training takes' mean and spread at each step, whatever is measured
MEMORY = "memory"  # linear, of the training takes' spread and their correlation over time
CLOSED = "_closed"  # after a model's name: its closed-loop form; the open one has the name itself


def closed(model: str) -> str:
    """The filter of the closed-loop form of ``model``."""
    return model + CLOSED


def models_of(filters: Iterable[str]) -> list[str]:
    """The models whose open-loop form is among ``filters``."""
    return [n for n in filters if n not in (NONE, MEMORY) and not n.endswith(CLOSED)]
