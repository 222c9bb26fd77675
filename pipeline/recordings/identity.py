"""Recordings that are not what their name says: a copy of another one, exchanged with another one,
named otherwise inside, late, or images of another take.
"""

import re
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist, squareform

from pipeline.core.errors import RecordingError
from pipeline.recordings.lags import lag

SAME = 2e-6  # m, rad or N: rounding to six decimals; two recordings differ by far more, by noise
BLOCK, LEAST_BLOCKS = (
    10,
    20,
)  # rows, over which noise and jitter average out; blocks of a take
NOISY = 0.3  # least share of rows with motion and unequal takes of a joint that is compared alone
OTHERS = 5  # number of takes that a take's images are compared with
FEWEST_FRAMES = 40  # for a share that separates own images from those of other takes
DIFFERENCES, NOISE_GAIN = (
    6,
    924,
)  # order of differences of white noise, and their variance over it
NOISE_MARGIN = (
    2.5  # 0.8 quantile of a residual over its noise, below which takes are alike
)


def require_distinct(
    what: str, samples: Mapping[str, np.ndarray], parts: Mapping = {}
) -> None:
    """Raise RecordingError where two ``samples`` are equal to within rounding."""
    order = sorted(
        samples, key=lambda name: (samples[name].shape, np.nansum(samples[name]))
    )
    for first, second in pairwise(order):
        a, b = samples[first], samples[second]
        if a.shape == b.shape and np.allclose(a, b, rtol=0, atol=SAME, equal_nan=True):
            one, other = (
                f"{parts.get(n, '')} {n}".strip() for n in sorted((first, second))
            )
            message = f"the {what} {one} and {other} have equal samples: one is a copy of the other"
            raise RecordingError(
                f"{message}; take it out, or record it again", take=second
            )


def likeness(q: np.ndarray) -> np.ndarray:
    """Return by take of the angles ``q`` (T, K, n) the distance to the fifth nearest take, if any,
    over the distance to the nearest one, of all joints or, as its root, of one joint; 1 for two
    takes. It is up to 4 for sound takes, and above 6 for a copy, also rescaled by a few percent,
    with offset, drift or noise of a quantum, resampled between rows, or of one joint alone.
    Distances are of means over up to BLOCK rows, without offset, drift, scale, speed and
    acceleration of the median take. Rounded joints at rest or without noise are not compared alone.
    """
    usual, block = (
        np.nanmedian(q, axis=0),
        max(min(BLOCK, q.shape[1] // LEAST_BLOCKS), 1),
    )
    speed, time = np.gradient(usual, axis=0), np.indices(usual.shape)[0]
    fitted = [np.ones_like(usual), time, usual, speed, np.gradient(speed, axis=0)]
    every = np.nan_to_num(np.concatenate([fitted, q - usual]))[
        :, : q.shape[1] // block * block
    ]
    means = np.moveaxis(
        every.reshape(len(every), -1, block, q.shape[2]).mean(axis=2), 2, 0
    )
    bases = np.linalg.qr(np.swapaxes(means[:, : len(fitted)], 1, 2))[
        0
    ]  # (n, blocks, 5)
    parts = means[:, len(fitted) :]
    parts = parts - parts @ bases @ np.swapaxes(bases, 1, 2)

    def ratio(part: np.ndarray) -> np.ndarray:
        apart = np.maximum(np.sort(squareform(pdist(part)), axis=1)[:, 1:6], SAME)
        return apart[:, -1] / apart[:, 0]

    noisy = (np.abs(speed) > SAME) & (np.abs(q - np.roll(q, 1, axis=0)) > SAME)
    alone = [np.sqrt(ratio(part)) for part in parts[noisy.mean(axis=(0, 1)) > NOISY]]
    return np.max([ratio(np.concatenate(parts, axis=1)), *alone], axis=0)


def own_name(stated: str, file: Path) -> bool:
    """Return whether the name ``stated`` in a take agrees with its ``file``, but for signs and an
    appended word; RecordingError where it is the name of another file beside it.
    """

    def plain(name: str) -> str:
        return re.sub(r"[\W_]+", "_", name.casefold())

    if f"{plain(file.stem)}_".startswith(f"{plain(stated)}_"):
        return True
    if plain(stated) in {
        plain(other.stem) for other in file.parent.glob(f"*{file.suffix}")
    }:
        message = f"the take is {stated!r} by its header, and another file has this name: restore "
        raise RecordingError(
            f"{message}the files' names, or export both again", file=file
        )
    print(
        f"ingest: {file.name}: the take is {stated!r} by its header; the file's name is used"
    )
    return False


def lags_beside_others(q: np.ndarray, rate: float) -> np.ndarray:
    """Return the lags (takes,) in s of ``q`` (takes, K, n) behind their median; 0 for two takes."""
    if len(q) < 3:
        return np.zeros(len(q))
    median = np.nanmedian(q, axis=0)
    known = [
        np.isfinite(each).all(axis=1) & np.isfinite(median).all(axis=1) for each in q
    ]
    return np.array(
        [lag(median[k], each[k], rate) for k, each in zip(known, q, strict=True)]
    )


def residual_share(seen: np.ndarray, own: float, others: list[float]) -> float:
    """Return the ``own`` residual of a take's centroids ``seen`` (F, d) in m beside its joints,
    over the median of the residuals beside ``others``: 1 for the images of another take. Takes that
    differ by less than the noise of ``seen`` cannot be told apart; their share is below 1.
    """
    jumps = np.abs(
        np.diff(seen, DIFFERENCES, axis=0)
    )  # mostly at rest: the motion adds to a few
    noise = 1.4826 * np.median(jumps) / np.sqrt(NOISE_GAIN)
    return float(own / max(float(np.median(others)), NOISE_MARGIN * noise))
