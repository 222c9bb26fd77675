"""Options of the analysis: filter, articulation, wrench study, realisations, and their scale."""

from __future__ import annotations

from dataclasses import dataclass

from omegaconf import MISSING


@dataclass
class Filter:
    scheme: str = MISSING
    threshold: float = MISSING
    particles: int = MISSING


@dataclass
class Articulation:
    gamma1: float = MISSING
    gamma2: float = MISSING
    length_range: float = MISSING  # share of the nominal length
    minimum_points: int = MISSING  # a frame with fewer points of the arm is a gap
    max_gap: int = MISSING  # frames in a row that may be gaps
    end_point: str = MISSING  # of the tool's segment: commanded or fitted
    # frames on either side that the covariance of the Kinect noise is estimated over
    noise_window: int = MISSING


@dataclass
class Wrench:
    agents: list[int] = MISSING
    kappa: list[float] = MISSING  # 1, the paper's σ_θ
    tension_std: list[float] = MISSING  # N
    tension: list[float] = MISSING  # N
    direction: list[float] = MISSING  # rad
    systems: int = MISSING
    test_systems: int = MISSING
    repeats: int = MISSING
    grid: int = MISSING


@dataclass
class Simulation:
    mode: str = MISSING
    realizations: int = MISSING


@dataclass
class Scale:
    name: str = MISSING
    training_takes: int = MISSING
    test_takes: int = MISSING
    depth_rate: float = MISSING  # 1/s
    realizations: int = MISSING
    particles: int = MISSING
    systems: int = MISSING
    test_systems: int = MISSING
    study_repeats: int = MISSING
    convex_checks: int = MISSING
    bootstrap_replicates: int = MISSING
    force_seconds: float = MISSING
