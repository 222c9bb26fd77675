"""Options of the motion capture and of what is fixed to the arm for it."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Literal

from pydantic import Field

from pipeline.core.validation import options

Triple = Annotated[list[float], Field(min_length=3, max_length=3)]


@options()
class Pose:
    position: Triple  # m
    rpy: Triple  # rad, fixed axes x, y, z (URDF convention)


@options()
class Body:
    """A rigid body of the motion capture that is fixed to a link."""

    name: str
    mount: Pose  # of the body's pivot in the link's frame


@options(kw_only=True)
class Mocap:
    training: str  # glob of the training takes' files, .csv of Motive or .c3d
    test: str | None = None
    unit: Literal["m", "cm", "mm"] | None = (
        None  # m, cm or mm, of lengths where the files do not say it
    )
    base: Pose  # the arm's base in the motion-capture world
    # link → marker name → position in the link's frame, m. Of a planar arm the links are its three
    # segments in their order, of any other they are links of the URDF
    markers: dict[str, dict[str, Triple]]
    # link → body whose poses carry the link's markers in place of their tracks
    bodies: dict[str, Body] = field(default_factory=dict)
    # m, how far a marker may be from where it is predicted to be taken for it
    gate: float
    # m, of a coordinate of a marker from where its link carries it, by noise and misplacement: what
    # the filter weighs particles by, where it does by the pose of the tip
    deviation: float | None = None
    # rad, about where the joints of an arm in space start, to choose among several postures that
    # the links followed leave it, and among whole turns; null: there is only one
    posture: list[float] | None = None
    max_gap: int  # frames, longest gap that is interpolated
