"""A difference between two runs, and the rule by which numbers differ."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.tools.audit.tolerance import RELATIVE


@dataclass(frozen=True)
class Difference:
    """Something that is not as it was: ``where`` in a file, whether it is within the tolerance, and
    ``how`` far it is off, in words.

    ``absolute`` and ``relative`` are the greatest differences of its numbers, None where it is no
    matter of numbers.
    """

    where: str
    within: bool
    how: str
    absolute: float | None = None
    relative: float | None = None


def inside(where: str, difference: Difference) -> Difference:
    """``difference`` with the place ``where`` before its own."""
    return replace(difference, where=", ".join(filter(None, (where, difference.where))))


def number_differences(
    before: np.ndarray, now: np.ndarray, absolute: np.ndarray | float
) -> Iterator[Difference]:
    """The greatest difference of two arrays; up to ``absolute`` it is passed whatever the relative
    one.
    """
    finite = np.isfinite(before) & np.isfinite(now)
    if not np.array_equal(before[~finite], now[~finite], equal_nan=True):
        yield Difference("", False, "gaps or infinite numbers are not where they were")
        return
    differ = finite & (before != now)
    if differ.any():
        old, new, passed = (
            before[differ],
            now[differ],
            np.broadcast_to(absolute, before.shape)[differ],
        )
        off = np.abs(new - old)
        share = off / np.maximum(np.abs(old), np.abs(new))
        words = f"{len(off)} of {len(now)} numbers by at most {off.max():.3g}"
        words = f"{old[0]} before, {new[0]} now" if len(now) == 1 else words
        words += f", relative {share.max():.3g}"
        yield Difference(
            "",
            bool(((share <= RELATIVE) | (off <= passed)).all()),
            words,
            float(off.max()),
            float(share.max()),
        )
