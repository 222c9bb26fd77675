"""Realisations of a motion model along the desired trajectory, step by step or running freely."""

from __future__ import annotations

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.models.draws import draw_steps
from pipeline.models.model import MotionModel


def realize(
    model: MotionModel,
    chain: Chain,
    q: np.ndarray,
    v: np.ndarray,
    mode: str,
    rng: np.random.Generator,
) -> tuple[np.ndarray, int, int]:
    """(N, M+1, n) joint angles in rad, the number of steps whose noise was clipped, and the number
    of lost realisations.

    ``q`` (N, M+1, n) recorded angles in rad, one take a realisation; ``v`` (M, m) or longer,
    commands. In mode ``one_step`` each step starts at the recorded pose; in ``free_running`` at the
    last one, and at a singular pose the realisation is lost: NaN from there on. Raises ConfigError
    for another mode, SingularJacobianError for a singular pose in the recordings.
    """
    if mode not in ("one_step", "free_running"):
        raise ConfigError(
            f"simulation.mode: no mode {mode!r}; there are one_step, free_running",
            key="simulation.mode",
        )
    result, clipped = np.full_like(q, np.nan), 0
    result[:, 0] = q[:, 0]
    alive = np.ones(len(q), dtype=bool)
    for k in range(len(v)):
        start = q[:, k]
        if mode == "free_running" and k > 0:
            start = result[:, k]
            alive &= ~chain.singular(start)
        result[alive, k + 1], count = draw_steps(model, chain, start[alive], v[k], rng)
        clipped += count
    return result, clipped, int(np.sum(~alive))


def realized_moments(
    model: MotionModel, chain: Chain, q: np.ndarray, v: np.ndarray, mode: str, realized: np.ndarray
) -> tuple[np.ndarray, np.ndarray, str | None]:
    """Mean and standard deviation (M+1, n) in rad of the realisations ``realized`` (N, M+1, n) of
    :func:`realize`; why there is no standard deviation.

    The standard deviation is of the process noise in mode ``one_step``, zero at k = 0, of the joint
    angles in mode ``free_running``; NaN where the model has no covariance. Raises ModelDomainError
    where fewer than two realisations stay clear of singular poses.
    """
    surviving = np.isfinite(realized[..., 0]).sum(axis=0)
    if surviving.min() < 2:
        raise ModelDomainError(
            "fewer than two realisations avoid singular poses: they have no standard deviation",
            step=int(np.argmax(surviving < 2)),
            key="simulation",
        )
    spread = realized
    if mode == "one_step":
        nominal = q[:, :-1] + chain.nominal_step(q[:, :-1], v)
        spread = np.concatenate([np.zeros_like(q[:, :1]), realized[:, 1:] - nominal], axis=1)
    mean, deviation = np.nanmean(realized, axis=0), np.nanstd(spread, axis=0, ddof=1)
    try:
        model.covariance(chain, q[0, :-1], v)
    except ModelDomainError as error:
        return mean, np.full_like(deviation, np.nan), str(error)
    return mean, deviation, None
