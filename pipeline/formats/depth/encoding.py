"""What the values of a depth image or a point cloud mean: the sensor's encoding, its unit, and the
values that stand for no depth.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import RecordingError
from pipeline.formats.depth.image import RawDepth

NO_DISPARITY = 2047  # what the Kinect's eleven bits show where it sees nothing


@dataclass(frozen=True)
class Encoding:
    """How stored values become metres; nothing of it can be read off the values, so all of it is
    given.

    ``kind``: ``plain``, depth itself; ``rotated_bits``, depth rotated left by three bits (SUN
    RGB-D); ``disparity``, the Kinect's 11-bit disparity δ with its two bytes swapped, depth = a/(b
    − δ) with ``disparity`` = (a, b) (NYU Depth v2: 351.3, 1092.5). ``units_per_metre``: 1000 for
    millimetres, 5000 for TUM RGB-D, 1 for metres. ``saturation``: the stored value from which on
    there is no depth. ``scale_key``: name of the factor that every value is multiplied by, in the
    description of a TIFF. The section ``dataset.depth`` checks them.
    """

    kind: str
    units_per_metre: float
    saturation: float | None = None
    scale_key: str | None = None
    disparity: tuple[float, float] | None = None


def metres(raw: RawDepth, encoding: Encoding, **evidence: object) -> np.ndarray:
    """Depth along the optical axis in m, (H, W) float32, NaN where there is none: 0 or less, NaN,
    saturated, or no disparity.

    Raises RecordingError (with ``evidence``) for pixels that the encoding does not have and for a
    description without its factor.
    """
    if encoding.kind != "plain" and raw.pixels.dtype != np.uint16:
        raise RecordingError(
            f"pixels of {raw.pixels.dtype} in the encoding {encoding.kind}, which has 16 bits",
            **evidence,
        )
    values, nothing = raw.pixels, ~(raw.pixels > 0)
    if encoding.saturation is not None:
        nothing |= raw.pixels >= encoding.saturation
    if encoding.kind == "rotated_bits":
        values = values >> 3 | values << 13
    elif encoding.kind == "disparity":
        disparity = values.byteswap()
        if disparity.max() > NO_DISPARITY:
            raise RecordingError(
                f"the value {disparity.max()} in what should be 11-bit disparities with their "
                "bytes swapped",
                **evidence,
            )
        a, b = encoding.disparity
        nothing |= (disparity == NO_DISPARITY) | (disparity >= b)
        with np.errstate(divide="ignore"):
            values = (a / (b - disparity)).astype(np.float32)
    key = encoding.scale_key
    factor = 1.0 if key is None else _factor(raw.description, key, evidence)
    depth = values / np.float32(encoding.units_per_metre / factor)
    nothing |= ~np.isfinite(depth)
    depth[nothing] = np.nan
    return depth


def _factor(description: str, key: str, evidence: dict[str, object]) -> float:
    before, number = r"\"?(?:\s*[:=]\s*|\s+)\"?", r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
    pattern = rf"(?<![\w.]){re.escape(key)}{before}({number})(?![\w.])"
    factors = re.findall(pattern, description)
    if len(factors) != 1 or not 0 < float(factors[0]) < np.inf:
        said = description if len(description) < 120 else description[:120] + "…"
        raise RecordingError(
            f"the image's description has no single positive number {key!r}: {said!r}", **evidence
        )
    return float(factors[0])
