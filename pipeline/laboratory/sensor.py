"""What a Kinect v2 makes of exact depth images: noise, systematic error, and loss at edges."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.laboratory.options import KinectOptions

# px, how far lateral noise may carry an edge; beyond it lies 1 draw in 5000 at the smallest
# standard deviation
REACH = 3
BIAS_STEP = 1e-3  # m, grid of the bias table: the bias varies over decimetres


def draw_bias(options: KinectOptions, rng: np.random.Generator) -> np.ndarray:
    """The session's systematic error of depth: its value (K,) in m at depths 0, 1 mm, 2 mm … up to
    the end of the range.
    """
    depth = np.arange(0.0, options.range[1] + BIAS_STEP, BIAS_STEP)
    phase = rng.uniform(0, 2 * np.pi)
    offset = options.bias_offset_std * rng.standard_normal()
    bias = offset + options.bias_wiggle * np.sin(2 * np.pi * depth / options.bias_period + phase)
    # rounded: a processor's last bit of the sine must not reach the image
    return np.round(bias, 7).astype(np.float32)


def _grazing_term(grazing: np.ndarray, options: KinectOptions) -> np.ndarray:
    """θ/(π/2 − θ) up to the grazing limit, past which no pixel has a depth."""
    angle = np.minimum(grazing, np.float32(options.grazing_limit))
    return angle / (np.float32(np.pi / 2) - angle)


def axial_std(depth: np.ndarray, grazing: np.ndarray, options: KinectOptions) -> np.ndarray:
    """σ_z in m at depth z (m) and grazing angle θ (rad), of the arguments' common shape; Fankhauser
    et al. (2015).
    """
    a, b, c, d = (np.float32(value) for value in options.axial)
    return (
        a
        + depth * (b + c * depth)
        + d * depth * np.sqrt(depth) * _grazing_term(grazing, options) ** 2
    )


def lateral_std(grazing: np.ndarray, options: KinectOptions) -> np.ndarray:
    """σ_L in px, each axis, at grazing angle θ (rad); Nguyen et al. (2012)."""
    a, b = (np.float32(value) for value in options.lateral)
    return a + b * _grazing_term(grazing, options)


class Sensor:
    """The sensor before a scene of which most stays as it is: the law of its readings there is
    computed once.

    Only operations that IEEE 754 rounds exactly act on an image, so its bytes do not depend on the
    processor.
    """

    def __init__(
        self, options: KinectOptions, bias: np.ndarray, depth: np.ndarray, grazing: np.ndarray
    ) -> None:
        """``bias`` from :func:`draw_bias`; ``depth`` (h, w) in m, 0 where nothing is, and
        ``grazing`` (h, w) in rad, both float32, of the scene at rest.
        """
        self.options, self.bias = options, bias
        self._depth, self._grazing = depth, grazing
        self._rest = self._law(np.where(depth > 0, depth, np.float32(np.inf)), grazing)

    def _law(self, depth: np.ndarray, grazing: np.ndarray) -> tuple[np.ndarray, ...]:
        """Mean and standard deviation of the reading in m, and whether there is one, where the
        exact ``depth`` is in m, infinite where nothing is; of the arguments' shape.
        """
        visible = (depth <= self.options.range[1]) & (grazing <= self.options.grazing_limit)
        depth = np.where(visible, depth, np.float32(0))
        mean = depth + self.bias[(depth * np.float32(1 / BIAS_STEP)).astype(np.intp)]
        return mean, axial_std(depth, grazing, self.options), visible

    def read(self, depth: np.ndarray, grazing: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The sensor's image (h, w) in mm, uint16, 0 where it has no depth, of an exact ``depth``
        (h, w) in m, 0 where nothing is, and ``grazing`` angle in rad, both float32.

        In this order: lateral noise moves edges (inside surfaces the axial law, measured on planes,
        holds it already); systematic and axial error; loss and mixing at edges; loss beyond range
        and grazing limit; rounding to 1 mm.
        """
        options = self.options
        exact = np.where(depth > 0, depth, np.float32(np.inf))
        around = {"kernel": np.ones((3, 3), np.uint8), "borderType": cv2.BORDER_REPLICATE}
        near, far = cv2.erode(exact, **around), cv2.dilate(exact, **around)
        edge = far > near * np.float32(1 + options.edge_ratio)

        moved = (depth != self._depth) | (grazing != self._grazing)
        mean, std, visible = (rest.copy() for rest in self._rest)
        for values, law in zip(
            (mean, std, visible), self._law(exact[moved], grazing[moved]), strict=True
        ):
            values[moved] = law
        band, source = self._lateral(edge, grazing, rng)
        for values, law in zip(
            (mean, std, visible), self._law(exact[source], grazing[source]), strict=True
        ):
            values.ravel()[band] = law
        measured = std
        measured *= rng.standard_normal(exact.shape, dtype=np.float32)
        measured += mean

        border = np.flatnonzero(edge)
        fate, weight = rng.random((2, border.size), dtype=np.float32)
        lost, mixes = (
            fate < options.edge_lost,
            (fate >= options.edge_lost) & (fate < options.edge_lost + options.edge_mixed),
        )
        mixed = border[mixes]
        front, back = near.ravel()[mixed], far.ravel()[mixed]
        measured.ravel()[mixed] = front + weight[mixes] * (back - front)
        visible.ravel()[mixed] = True
        visible.ravel()[border[lost]] = False

        visible &= (measured >= options.range[0]) & (measured <= options.range[1])
        np.copyto(measured, np.float32(0), where=~visible)
        measured *= np.float32(1000)
        return np.rint(measured, out=measured).astype(np.uint16)

    def _lateral(
        self, edge: np.ndarray, grazing: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """The pixels (B,) within reach of an ``edge`` (h, w), and the rows and columns (B,) of
        those that they show by lateral noise.
        """
        around = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
        band = np.flatnonzero(cv2.dilate(edge.view(np.uint8), around))
        rows, columns = np.divmod(band, edge.shape[1])
        spread = lateral_std(grazing.ravel()[band], self.options)
        shift = (
            np.rint(spread * rng.standard_normal((2, band.size), dtype=np.float32))
            .clip(-REACH, REACH)
            .astype(np.intp)
        )
        return band, (
            np.clip(rows + shift[0], 0, edge.shape[0] - 1),
            np.clip(columns + shift[1], 0, edge.shape[1] - 1),
        )
