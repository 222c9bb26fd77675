"""Joints as screws, for compiled code: the axis of a revolute joint, and the velocity in m/rad that
it gives a body at the origin.

From link to link vectors are turned by a joint's angle, and shifted and tilted by what lies between
the joints (:mod:`.folded`); no frame is ever made. Scalars alone, so that loops around them take
several poses at once.
"""

from __future__ import annotations

from typing import NamedTuple

from pipeline.arm import folded
from pipeline.arm.numbers import Arm
from pipeline.core.compiled import inlined
from pipeline.core.elementary import fma


class Link(NamedTuple):
    """What lies between a joint and the next: the tilt's cosine and sine, and the shift in m."""

    cosine: float
    sine: float
    shift: tuple[float, float, float]


@inlined
def link_behind(arm: Arm, joint: int) -> Link:
    """The link behind ``joint``, of which the first is 1; 0 is the base."""
    frame = arm.frames[joint]
    x, y, z = frame[folded.SHIFT], frame[folded.SHIFT + 1], frame[folded.SHIFT + 2]
    return Link(frame[folded.COSINE], frame[folded.SINE], (x, y, z))


@inlined
def turned(angle: tuple, x: tuple) -> tuple[float, ...]:
    """``x`` in the link before a joint, from the axes that are turned by its ``angle``."""
    sine, cosine = angle
    return fma(cosine, x[0], -sine * x[1]), fma(sine, x[0], cosine * x[1]), x[2]


@inlined
def back(angle: tuple, x: tuple) -> tuple[float, ...]:
    """The inverse of :func:`turned`."""
    sine, cosine = angle
    return fma(cosine, x[0], sine * x[1]), fma(cosine, x[1], -sine * x[0]), x[2]


@inlined
def tilted(link: Link, x: tuple) -> tuple[float, ...]:
    """``x`` in the axes of a ``link``, from those of the frame at its end."""
    cosine, sine, _ = link
    return x[0], fma(cosine, x[1], -sine * x[2]), fma(sine, x[1], cosine * x[2])


@inlined
def level(link: Link, x: tuple) -> tuple[float, ...]:
    """The inverse of :func:`tilted`."""
    cosine, sine, _ = link
    return x[0], fma(cosine, x[1], sine * x[2]), fma(cosine, x[2], -sine * x[1])


@inlined
def cross(x: tuple, y: tuple) -> tuple[float, ...]:
    """x × y."""
    return (
        fma(x[1], y[2], -x[2] * y[1]),
        fma(x[2], y[0], -x[0] * y[2]),
        fma(x[0], y[1], -x[1] * y[0]),
    )


@inlined
def plus(x: tuple, y: tuple) -> tuple[float, ...]:
    """x + y of three numbers each."""
    return x[0] + y[0], x[1] + y[1], x[2] + y[2]


@inlined
def at_end(link: Link) -> tuple[tuple[float, ...], ...]:
    """The screw of the joint at the end of a ``link``, in its axes."""
    axis = 0.0, -link.sine, link.cosine
    return axis, cross(link.shift, axis)


@inlined
def inward(link: Link, angle: tuple, screw: tuple) -> tuple[tuple[float, ...], ...]:
    """A ``screw`` of the next link in the axes of this one; ``angle`` of the joint between them."""
    axis = tilted(link, turned(angle, screw[0]))
    return axis, plus(tilted(link, turned(angle, screw[1])), cross(link.shift, axis))


@inlined
def placed(link: Link, angle: tuple, point: tuple) -> tuple[float, ...]:
    """The same of a ``point`` in m."""
    return plus(tilted(link, turned(angle, point)), link.shift)


@inlined
def at_start(link: Link, angle: tuple) -> tuple[tuple[float, ...], ...]:
    """The screw of the joint at the start of a ``link`` in the axes of the next; ``angle`` of the
    joint between them.
    """
    x, y, _ = link.shift
    return back(angle, level(link, (0.0, 0.0, 1.0))), back(angle, level(link, (-y, x, 0.0)))


@inlined
def outward(link: Link, angle: tuple, screw: tuple) -> tuple[tuple[float, ...], ...]:
    """A ``screw`` of this link in the axes of the next."""
    moment = plus(screw[1], cross(screw[0], link.shift))
    return back(angle, level(link, screw[0])), back(angle, level(link, moment))
