"""The type of the bounds within which one file of recordings is read."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.core.errors import ConfigError


@dataclass(frozen=True)
class Reading:
    """What one file may be and take at most; beyond, it is refused with the name of the bound."""

    file_mib: int = 64  # of a file that is read whole; bags and archives are read in parts
    part_mib: int = 64  # of what is unfolded at once: a frame, an array, a chunk of a bag
    markers: int = 2000  # of a take
    seconds: float = 20.0  # of what is read in a process of its own
    memory_mib: int = 2048  # likewise, beside the program's own

    def __post_init__(self) -> None:
        for name, bound in vars(self).items():
            if not bound > 0:
                raise ConfigError(
                    f"{name}: a bound is positive, as {bound} is not", key=f"dataset.reading.{name}"
                )
