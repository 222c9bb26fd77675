"""Whether a record in time and independent draws have one law: the energy distance (Székely and
Rizzo 2004) and its permutation test.

Permutations take the samples for exchangeable, which those of a record that is correlated in time
are not, and blocks of it are not exchangeable with blocks of independent draws either. So the
record is thinned first, to samples that are nearly independent.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import ModelDomainError

WINDOW = 5  # autocorrelation times that the sum of correlations goes up to (Sokal 1997)
# autocorrelation times between thinned samples: of an exponential correlation exp(−4) = 0.02 is
# left
SPACING = 2
MOST = 300  # samples of a thinned record: the test holds the distances of all pairs
PERMUTATIONS = 1999


def autocorrelation_time(record: np.ndarray) -> float:
    """Integrated autocorrelation time τ = 1 + 2·Σρ_k in samples, at least 1, of the slowest
    component of ``record`` (N, p).

    N/τ independent samples have a mean as certain as the record's. The sum ends at the first lag
    beyond five times itself. Raises ModelDomainError for a component that does not vary.
    """
    count = len(record)
    if count < 2 or np.any(np.ptp(record, axis=0) == 0):
        raise ModelDomainError(
            "a record whose values are all equal has no autocorrelation time", samples=count
        )
    # twice as long, so that the circular correlation of the transform does not wrap round
    spectrum = np.abs(np.fft.rfft(record - np.mean(record, axis=0), 2 * count, axis=0)) ** 2
    covariance = np.fft.irfft(spectrum, axis=0)[:count]
    sums = 2 * np.cumsum(covariance / covariance[0], axis=0) - 1
    ends = np.argmax(np.arange(count)[:, None] >= WINDOW * sums, axis=0)
    return float(max(1.0, *np.take_along_axis(sums, ends[None], axis=0)[0]))


def thinned(record: np.ndarray) -> np.ndarray:
    """Every ⌈2τ⌉-th sample of ``record`` (N, p), further apart where more than ``MOST`` would be
    left, (K, p).

    Raises ModelDomainError where fewer than two are left.
    """
    step = max(int(np.ceil(SPACING * autocorrelation_time(record))), -(-len(record) // MOST))
    if len(record) <= step:
        raise ModelDomainError(
            "the record is too short beside its autocorrelation time: record for longer",
            samples=len(record),
            step=step,
        )
    return record[::step]


def energy_test(a: np.ndarray, b: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """Energy distance 2E‖A − B‖ − E‖A − A′‖ − E‖B − B′‖ of independent samples ``a`` (K, p) and
    ``b`` (L, p), and its p-value.

    The distance is in the samples' unit; as an average over all pairs it is positive even between
    samples of one law. The p-value is the share, among ``PERMUTATIONS`` random divisions of the
    pooled samples and the true one, of those that lie at least as far apart, so one law gives a
    p-value ≤ α with a probability of at most α.
    """
    pooled = np.concatenate([a, b])
    distances = np.sqrt(sum(np.subtract.outer(x, x) ** 2 for x in pooled.T))
    weights = np.repeat([1 / len(a), -1 / len(b)], [len(a), len(b)])
    divisions = rng.permuted(np.tile(weights, (PERMUTATIONS, 1)), axis=1)
    observed = -weights @ distances @ weights
    permuted = -np.einsum("ki,ki->k", divisions @ distances, divisions)
    return float(observed), float((1 + np.sum(permuted >= observed)) / (1 + PERMUTATIONS))
