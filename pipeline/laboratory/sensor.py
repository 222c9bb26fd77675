"""What a Kinect v2 makes of exact depth images: noise, systematic error, and loss at edges."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.laboratory.options import KinectOptions

Window = tuple[slice, ...]  # rows and columns of an image

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


def _grown(window: Window, margin: int, shape: tuple[int, int]) -> Window:
    """``window`` with ``margin`` px more on every side, as far as an image of ``shape`` goes."""
    return tuple(
        slice(max(side.start - margin, 0), min(side.stop + margin, size))
        for side, size in zip(window, shape, strict=True)
    )


def _reached(window: Window, reach: int, shape: tuple[int, int]) -> tuple[Window, Window, Window]:
    """Where an image of ``shape`` changes with the ``window`` if each of its pixels follows from
    those within ``reach`` px, the same in the window after it, and the window that it follows from.
    """
    inside, around = (_grown(window, margin, shape) for margin in (reach, 2 * reach))
    within = tuple(
        slice(a.start - b.start, a.stop - b.start) for a, b in zip(inside, around, strict=True)
    )
    return inside, within, around


def _near_edges(edge: np.ndarray) -> np.ndarray:
    """The pixels (h, w) within reach of lateral noise of an ``edge`` (h, w)."""
    around = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
    return cv2.dilate(edge.view(np.uint8), around).view(bool)


class _Layer:
    """An image of the scene at rest, and the same with a window of it renewed: in memory that is
    asked for once, since the system takes longer to hand it out than a pass over it takes.
    """

    def __init__(self, rest: np.ndarray) -> None:
        self._rest, self._image = rest, rest.copy()
        self._window: Window = (slice(0), slice(0))

    def renew(self, window: Window, part: np.ndarray) -> np.ndarray:
        """The image with ``part`` in ``window``, until it is renewed again."""
        self._image[self._window] = self._rest[self._window]
        self._image[window], self._window = part, window
        return self._image


class Sensor:
    """The sensor before a scene of which most stays as it is: the law of its readings there, and
    where its edges are, is computed once.

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
        self._rest = self._law(depth, grazing)
        self._depth, self._grazing = _Layer(depth), _Layer(grazing)
        edges = self._edges_of(depth)
        self._edges, self._band = [_Layer(one) for one in edges], _Layer(_near_edges(edges[0]))
        self._noise, self._measured = np.empty_like(depth), np.empty_like(depth)

    def _law(self, depth: np.ndarray, grazing: np.ndarray) -> tuple[np.ndarray, ...]:
        """Mean and standard deviation of the reading in m, and whether there is one, where the
        exact ``depth`` is in m, 0 where nothing is; of the arguments' shape.
        """
        options = self.options
        visible = (depth > 0) & (depth <= options.range[1]) & (grazing <= options.grazing_limit)
        depth = np.where(visible, depth, np.float32(0))
        mean = depth + self.bias[(depth * np.float32(1 / BIAS_STEP)).astype(np.intp)]
        return mean, axial_std(depth, grazing, options), visible

    def _edges_of(self, depth: np.ndarray) -> tuple[np.ndarray, ...]:
        """Of ``depth`` (h, w) in m, 0 where nothing is: whether a pixel and its neighbours are an
        edge, and the least and the greatest depth of them, infinite where nothing is; (h, w) each.
        """
        exact = np.where(depth > 0, depth, np.float32(np.inf))
        around = {"kernel": np.ones((3, 3), np.uint8), "borderType": cv2.BORDER_REPLICATE}
        near, far = cv2.erode(exact, **around), cv2.dilate(exact, **around)
        return far > near * np.float32(1 + self.options.edge_ratio), near, far

    def read(
        self, window: Window, depth: np.ndarray, grazing: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """The sensor's image (h, w) in mm, uint16, 0 where it has no depth, of the scene at rest
        but for ``window``: there of an exact ``depth`` in m, 0 where nothing is, and ``grazing``
        angle in rad, both float32 of the window's shape.

        In this order: lateral noise moves edges (inside surfaces the axial law, measured on planes,
        holds it already); systematic and axial error; loss and mixing at edges; loss beyond range
        and grazing limit; rounding to 1 mm.
        """
        options, measured = self.options, self._measured
        scene = self._depth.renew(window, depth), self._grazing.renew(window, grazing)
        edge, near, far = self._renewed_edges(window, scene[0])
        band = np.flatnonzero(self._renewed_band(_grown(window, 1, edge.shape), edge))
        shown = self._lateral(band, scene[1], rng)

        noise = rng.standard_normal(out=self._noise, dtype=np.float32)
        mean, std, visible = self._rest
        np.multiply(noise, std, out=measured)
        measured += mean
        mean, std, seen = self._law(depth, grazing)
        measured[window], visible = noise[window] * std + mean, visible.copy()
        visible[window] = seen
        mean, std, seen = self._law(*(image.ravel()[shown] for image in scene))
        measured.ravel()[band] = noise.ravel()[band] * std + mean
        visible.ravel()[band] = seen

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

    def _renewed_edges(self, window: Window, depth: np.ndarray) -> tuple[np.ndarray, ...]:
        """What :meth:`_edges_of` says of ``depth``, which is as at rest but for ``window``."""
        near_it, within, around = _reached(window, 1, depth.shape)
        parts = self._edges_of(depth[around])
        return tuple(
            layer.renew(near_it, part[within])
            for layer, part in zip(self._edges, parts, strict=True)
        )

    def _renewed_band(self, window: Window, edge: np.ndarray) -> np.ndarray:
        """What :func:`_near_edges` says of ``edge``, which is as at rest but for ``window``."""
        near_it, within, around = _reached(window, REACH, edge.shape)
        return self._band.renew(near_it, _near_edges(np.ascontiguousarray(edge[around]))[within])

    def _lateral(
        self, band: np.ndarray, grazing: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """The pixels (B,) that those of the ``band`` (B,) show by lateral noise."""
        height, width = grazing.shape
        rows, columns = np.divmod(band, width)
        spread = lateral_std(grazing.ravel()[band], self.options)
        shift = (
            np.rint(spread * rng.standard_normal((2, band.size), dtype=np.float32))
            .clip(-REACH, REACH)
            .astype(np.intp)
        )
        rows, columns = (
            np.clip(rows + shift[0], 0, height - 1),
            np.clip(columns + shift[1], 0, width - 1),
        )
        return rows * width + columns
