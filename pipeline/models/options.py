"""What the option file of every motion model holds; a model adds its own in ``KIND/options.py``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from omegaconf import MISSING

from pipeline.core.errors import ConfigError


@dataclass
class Options:
    """Base of the options of a model; those of each kind are a subclass of the same name."""

    kind: str = MISSING  # the model's folder in pipeline/models
    label: str = MISSING  # its name in legends and tables
    closed_loop: bool = True  # whether its closed-loop form is fitted and filtered too


def require_choice(key: str, value: str, choices: Sequence[str]) -> None:
    """Raise ConfigError where the option ``key`` has a ``value`` that is none of ``choices``."""
    if value not in choices:
        raise ConfigError(
            f"{key}: no {key} {value!r}; there are {', '.join(choices)}", key=f"models.*.{key}"
        )
