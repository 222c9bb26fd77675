"""Options of the analysis: filter, articulation, wrench study, realisations, and their scale."""

from typing import Annotated, Literal

from pydantic import Field

from pipeline.core.validation import options

Count = Annotated[int, Field(ge=1, le=10_000_000)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Whole = Annotated[int, Field(ge=0)]
Bounds = Annotated[list[float], Field(min_length=2, max_length=2)]


@options()
class Filter:
    scheme: Literal["systematic", "multinomial", "none"]
    threshold: Annotated[float, Field(ge=0, le=1)]  # share of the particles
    particles: Count


@options()
class ArticulationSection:
    gamma1: NotNegative  # weight of a mean over points
    gamma2: NotNegative  # weight of a sum over three segments: γ1 = 1, γ2 = 1/3 weigh means equally
    length_range: Annotated[float, Field(gt=0, lt=1)]  # share of the nominal length
    minimum_points: Count  # a frame with fewer points of the arm is a gap
    max_gap: Whole  # greatest number of consecutive gaps
    end_point: Literal["commanded", "fitted"]  # end of the tool's segment
    # frames on either side that estimate the covariance of the Kinect noise
    noise_window: Whole


@options()
class Wrench:
    agents: list[Count]
    kappa: Bounds  # 1, the paper's σ_θ
    tension_std: Bounds  # N
    tension: Bounds  # N
    direction: Bounds  # rad
    systems: Count
    test_systems: Count
    repeats: Count
    grid: Count  # points per axis of the density's grid


@options()
class Simulation:
    mode: Literal["one_step", "free_running"]
    realizations: Count


@options()
class Scale:
    name: str
    training_takes: Count
    test_takes: Count
    depth_rate: Positive  # 1/s
    realizations: Count
    particles: Count
    systems: Count
    test_systems: Count
    study_repeats: Count
    convex_checks: Whole
    bootstrap_replicates: Whole
    bootstrap_refits: Whole
    force_seconds: Positive
    held_out_motions: Count | None  # null: all
    readings: Count | None  # null: all


@options()
class Dask:
    """A Dask cluster."""

    # of a running scheduler; null: each stage starts a local cluster
    address: str | None = None
    # s without scheduler or workers after which the stage stops
    timeout: Positive = 60.0


@options()
class Compute:
    """Place of the trials; results do not depend on it."""

    workers: Whole = 0  # processes on this machine; 0: one per core
    dask: Dask | None = None  # null: no cluster
