"""Options of the motion capture and of what is fixed to the arm for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from pipeline.core.errors import ConfigError


@dataclass
class Pose:
    position: list[float] = MISSING  # m
    rpy: list[float] = MISSING  # rad, fixed axes x, y, z (URDF convention)


@dataclass
class Body:
    """A rigid body of the motion capture that is fixed to a link."""

    name: str = MISSING
    mount: Pose = field(default_factory=Pose)  # of the body's pivot in the link's frame


@dataclass
class Mocap:
    training: str = MISSING  # glob of the training takes' files, .csv of Motive or .c3d
    test: str | None = None
    unit: str | None = None  # m, cm or mm, of lengths where the files do not say it
    base: Pose = field(default_factory=Pose)  # the arm's base in the motion-capture world
    # link → marker name → position in the link's frame, m. Of a planar arm the links are its three
    # segments in their order, of any other they are links of the URDF
    markers: dict[str, dict[str, list[float]]] = MISSING
    # link → body whose poses carry the link's markers in place of their tracks
    bodies: dict[str, Body] = field(default_factory=dict)
    # m, how far a marker may be from where it is predicted to be taken for it
    gate: float = MISSING
    # m, of a coordinate of a marker from where its link carries it, by noise and misplacement: what
    # the filter weighs particles by, where it does by the pose of the tip
    deviation: float | None = None
    # rad, about where the joints of an arm in space start, to choose among several postures that
    # the links followed leave it, and among whole turns; null: there is only one
    posture: list[float] | None = None
    max_gap: int = MISSING  # frames, longest gap that is interpolated

    def __post_init__(self) -> None:
        if self.unit not in (None, "m", "cm", "mm"):
            raise ConfigError(
                f"unit: no unit {self.unit!r}; there are m, cm, mm", key="dataset.mocap.unit"
            )
