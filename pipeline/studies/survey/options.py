"""What a survey varies: an option file of this folder, read and checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml
from pipeline.studies.survey.conditions import (
    DESIGNS,
    FACTORS,
    Condition,
    motion_conditions,
    wrench_conditions,
)
from pipeline.studies.survey.strict import build, is_number

TEST_TAKES = 4  # fewer leave too few to estimate the depth camera's noise of each from the others


def _whole(least: int) -> Callable[[object], bool]:
    return lambda value: isinstance(value, int) and not isinstance(value, bool) and value >= least


def _require(owner: object, key: str, fits: Callable[[object], bool], wanted: str) -> None:
    if not fits(getattr(owner, key)):
        raise ConfigError(f"must be {wanted}, found {getattr(owner, key)!r}", key=key)


def _list_of(fits: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda values: isinstance(values, list) and len(values) > 0 and all(map(fits, values))


def _factor(value: object) -> bool:
    return is_number(value) and value >= 0


def _positive(value: object) -> bool:
    return is_number(value) and value > 0


def _pose(value: object) -> bool:
    return value is None or (
        isinstance(value, list) and len(value) == 3 and all(map(is_number, value))
    )


@dataclass(frozen=True)
class Way:
    """A trajectory: the dataset's own with other ends, another rest, or at another pace."""

    folded: list | None = None  # rad; null: the dataset's
    extended: list | None = None  # rad; null: the dataset's
    # s, each of the four rests, of which the turn has two; the motion between them stays, so that
    # the duration changes; null: the dataset's
    rest: float | None = None
    pace: float = 1.0  # duration, rest and ramp are divided by it

    def __post_init__(self) -> None:
        for key in ("folded", "extended"):
            _require(self, key, _pose, "three joint angles in rad, or null")
        _require(self, "rest", lambda rest: rest is None or _factor(rest), "a time in s, or null")
        _require(self, "pace", _positive, "a positive number")


@dataclass(frozen=True)
class WrenchLevels:
    """The levels of the wrench study, and its size."""

    agents: list
    kappa: list
    tension_std: list
    systems: int
    test_systems: int
    repeats: int
    force_seconds: float  # s, length of a force record after the tare

    def __post_init__(self) -> None:
        _require(self, "force_seconds", _positive, "a positive number")
        _require(
            self, "agents", _list_of(_list_of(_whole(1))), "a list of lists of numbers of cables"
        )
        for key in ("kappa", "tension_std"):
            _require(self, key, _list_of(_positive), "a list of positive factors")
        for key, least in (("systems", 2), ("test_systems", 1), ("repeats", 1)):
            _require(self, key, _whole(least), f"a whole number, at least {least}")


@dataclass(frozen=True)
class Survey:
    """A survey's design, levels and size; of every list the first is the base condition's, factors
    apart, which are 1 there.
    """

    design: str
    seeds: list
    trajectories: dict  # name → Way
    particles: list
    factors: dict  # name of pipeline.studies.survey.conditions.Factors → list
    training_takes: int
    test_takes: int
    realizations: int
    wrench: WrenchLevels

    def __post_init__(self) -> None:
        if self.design not in DESIGNS:
            raise ConfigError(
                f"no design {self.design!r}; there are {', '.join(DESIGNS)}", key="design"
            )
        _require(self, "seeds", _list_of(_whole(0)), "a list of whole numbers, none negative")
        _require(self, "particles", _list_of(_whole(1)), "a list of whole numbers, at least 1")
        for key, least in (("training_takes", 4), ("test_takes", TEST_TAKES), ("realizations", 2)):
            _require(self, key, _whole(least), f"a whole number, at least {least}")
        _require(
            self,
            "trajectories",
            lambda ways: isinstance(ways, dict) and len(ways) > 0,
            "names and trajectories",
        )
        _require(self, "factors", lambda levels: isinstance(levels, dict), "names and levels")
        for name, levels in self.factors.items():
            if name not in FACTORS:
                raise ConfigError(
                    f"no factor {name!r}; there are {', '.join(FACTORS)}", key=f"factors.{name}"
                )
            # a deviation that lasts no time is none
            fits, wanted = (
                (_positive, "all positive") if name == "lasting" else (_factor, "none negative")
            )
            if not _list_of(fits)(levels):
                raise ConfigError(
                    f"must be a list of factors, {wanted}, found {levels!r}",
                    key=f"factors.{name}",
                )

    @property
    def conditions(self) -> list[Condition]:
        """Every point of the grid, in the order of the option file, those of the wrench last."""
        motion = motion_conditions(
            self.seeds, list(self.trajectories), self.particles, self.factors, self.design
        )
        wrench = self.wrench
        return [
            *motion,
            *wrench_conditions(
                self.seeds, wrench.agents, wrench.kappa, wrench.tension_std, self.design
            ),
        ]


def read_survey(file: Path) -> Survey:
    """The survey that ``file`` asks for. Raises ConfigError with the file, the key and the choices
    there are.
    """
    values = read_yaml(file)
    if isinstance(values.get("trajectories"), dict):
        ways = values["trajectories"].items()
        values["trajectories"] = {
            name: build(Way, way, file=file, of=f"trajectories.{name}") for name, way in ways
        }
    if "wrench" in values:
        values["wrench"] = build(WrenchLevels, values["wrench"], file=file, of="wrench")
    return build(Survey, values, file=file)
