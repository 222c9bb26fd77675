"""The types of the options that say where trials run."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.core.errors import ConfigError


@dataclass
class Dask:
    """A Dask cluster."""

    # of a running scheduler; null: a cluster on this machine, started and ended by each stage
    address: str | None = None
    # s without an answer of the scheduler, or without any worker, after which the stage gives up
    timeout: float = 60.0

    def __post_init__(self) -> None:
        if not self.timeout > 0:
            raise ConfigError(
                f"the timeout must be positive, as {self.timeout:g} s is not",
                key="compute.dask.timeout",
            )


@dataclass
class Compute:
    """Where trials run. What they give does not depend on it."""

    workers: int = 0  # processes on this machine, 0: one per core
    dask: Dask | None = None  # null: no cluster

    def __post_init__(self) -> None:
        if self.workers < 0:
            raise ConfigError(
                f"the number of workers must not be negative, as {self.workers} is",
                key="compute.workers",
            )
