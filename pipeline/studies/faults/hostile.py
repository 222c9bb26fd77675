"""Files that do harm to a reader that trusts them: they name code to run, or unfold into more than
a memory holds.
"""

from __future__ import annotations

import numpy as np


def alias_bomb(content: bytes, levels: float, rng: np.random.Generator) -> bytes:
    """A calibration as YAML whose camera matrix is nine references to nine references …, that many
    levels deep.
    """
    nested = [b"a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    nested += [
        b"a%d: &a%d [%s]" % (level, level, b", ".join([b"*a%d" % (level - 1)] * 9))
        for level in range(1, int(levels))
    ]
    return b"\n".join(
        [
            *nested,
            b"camera_matrix: *a%d" % (int(levels) - 1),
            b"distortion_coefficients: [0, 0, 0, 0, 0]",
            b"",
        ]
    )


def named_code(content: bytes, severity: float, rng: np.random.Generator) -> bytes:
    """A calibration as YAML whose camera matrix is the result of a call."""
    return (
        b"camera_matrix: !!python/object/apply:os.abort []\ndistortion_coefficients: [0, "
        b"0, 0, 0, 0]\n"
    )


def nested_lists(content: bytes, levels: float, rng: np.random.Generator) -> bytes:
    """A calibration as JSON with that many lists in each other, deeper than a parser can recur."""
    return b'{"camera_matrix": %s%s}' % (b"[" * int(levels), b"]" * int(levels))


def other_type(content: bytes, severity: float, rng: np.random.Generator) -> bytes:
    """The header of OpenCV's matrix states bytes where floating-point numbers stand."""
    return content.replace(b"dt: d", b"dt: u")
