"""A Kinect v2's reading of an exact depth image: noise, systematic error, loss at edges, by exactly
rounded operations, so that bytes do not depend on the processor.
"""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.laboratory.options import KinectOptions

# px, how far lateral noise may carry an edge; beyond it lies 1 draw in 5000 at the smallest
# standard deviation
REACH = 3
BIAS_STEP = 1e-3  # m, grid of the bias table: the bias varies over decimetres


def draw_bias(options: KinectOptions, rng: np.random.Generator) -> np.ndarray:
    """Draw the session's systematic error of depth (K,) in m at depths 0, 1 mm, 2 mm …."""
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
    """Return σ_z in m at depth z (m) and grazing angle θ (rad); Fankhauser et al. (2015)."""
    a, b, c, d = (np.float32(value) for value in options.axial)
    term = _grazing_term(grazing, options) ** 2
    return a + depth * (b + c * depth) + d * depth * np.sqrt(depth) * term


def lateral_std(grazing: np.ndarray, options: KinectOptions) -> np.ndarray:
    """Return σ_L in px, each axis, at grazing angle θ (rad); Nguyen et al. (2012)."""
    a, b = (np.float32(value) for value in options.lateral)
    return a + b * _grazing_term(grazing, options)


def read_depth(
    depth: np.ndarray,
    grazing: np.ndarray,
    bias: np.ndarray,
    options: KinectOptions,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the sensor's image (h, w) in mm, uint16, 0 without depth, of exact ``depth`` (h, w) in
    m, 0 where nothing is, ``grazing`` angle (h, w) in rad, float32, and ``bias``: lateral noise
    moves edges; systematic and axial error; loss and mixing at edges; loss beyond range and grazing
    limit; rounding to 1 mm.
    """
    exact = np.where(depth > 0, depth, np.float32(np.inf))
    around = {"kernel": np.ones((3, 3), np.uint8), "borderType": cv2.BORDER_REPLICATE}
    near, far = cv2.erode(exact, **around), cv2.dilate(exact, **around)
    edge = far > near * np.float32(1 + options.edge_ratio)
    window = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
    band = np.flatnonzero(cv2.dilate(edge.view(np.uint8), window))
    shown = _lateral(band, grazing, options, rng)

    visible = (depth > 0) & (depth <= options.range[1]) & (grazing <= options.grazing_limit)
    seen = np.where(visible, depth, np.float32(0))
    mean = seen + bias[(seen * np.float32(1 / BIAS_STEP)).astype(np.intp)]
    parts = [mean, axial_std(seen, grazing, options), visible]
    for part in parts:
        part.ravel()[band] = part.ravel()[shown]
    mean, measured, visible = parts
    measured *= rng.standard_normal(measured.shape, dtype=np.float32)
    measured += mean

    border = np.flatnonzero(edge)
    fate, weight = rng.random((2, border.size), dtype=np.float32)
    lost = fate < options.edge_lost
    mixes = ~lost & (fate < options.edge_lost + options.edge_mixed)
    mixed = border[mixes]
    front, back = near.ravel()[mixed], far.ravel()[mixed]
    measured.ravel()[mixed] = front + weight[mixes] * (back - front)
    visible.ravel()[mixed] = True
    visible.ravel()[border[lost]] = False
    visible &= (measured >= options.range[0]) & (measured <= options.range[1])
    return np.rint(np.where(visible, measured, 0) * np.float32(1000)).astype(np.uint16)


def _lateral(
    band: np.ndarray, grazing: np.ndarray, options: KinectOptions, rng: np.random.Generator
) -> np.ndarray:
    """The pixels (B,) that those of the ``band`` (B,) show by lateral noise."""
    std = lateral_std(grazing.ravel()[band], options)
    shift = np.rint(std * rng.standard_normal((2, band.size), dtype=np.float32))
    shift = shift.clip(-REACH, REACH).astype(np.intp)
    places = np.stack(np.unravel_index(band, grazing.shape)) + shift
    return np.ravel_multi_index(tuple(places), grazing.shape, mode="clip")
