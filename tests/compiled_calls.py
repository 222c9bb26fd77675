"""Compiled functions that only compiled functions call, called from tests."""

from __future__ import annotations

import numpy as np

from pipeline.filtering.resampling import SCHEMES, resample


def chosen_by(scheme: str, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(P,) indices that a resampling ``scheme`` chooses under ``weights`` (P,)."""
    chosen = np.full(len(weights), -1)
    scratch = np.full((2, len(weights)), np.nan)
    resample(SCHEMES.index(scheme), weights, chosen, scratch, rng)
    return chosen
