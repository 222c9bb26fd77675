"""What happens to a force transducer, done to a DAQ F/T log with a decimal point: it is overloaded,
or repeats itself.
"""

from __future__ import annotations

import numpy as np

from pipeline.studies.faults.text import lines_of


def saturated(full_scale: float, content: bytes, share: float, rng: np.random.Generator) -> bytes:
    """A block of that ``share`` of the samples has the first axis at its ``full_scale``, in the
    unit of the log.
    """
    lines, block = _block(content, share, rng)
    for i in block:
        lines[i] = b'"%.15G",' % full_scale + lines[i].split(b",", 1)[1]
    return b"".join(lines)


def frozen_sensor(content: bytes, share: float, rng: np.random.Generator) -> bytes:
    """A block of that ``share`` of the samples is the sample before it."""
    lines, block = _block(content, share, rng)
    for i in block:
        lines[i] = lines[block[0] - 1]
    return b"".join(lines)


def _block(content: bytes, share: float, rng: np.random.Generator) -> tuple[list[bytes], list[int]]:
    lines, rows = lines_of(content)
    length = max(1, round(share * len(rows)))
    first = int(rng.integers(1, max(2, len(rows) - length)))
    return lines, rows[first : first + length]
