"""Realisations of the process noise from recorded joint angles, and their moments at each step."""

from __future__ import annotations

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.statistics.takes import takes_moments


def process_noise(chain: Chain, q: np.ndarray, command: np.ndarray) -> np.ndarray:
    """(takes, M, n) noise ω_{k+1} = q̃_{k+1} − q̃_k − J(q̃_k)⁻¹ẋᵈ_kΔt in rad, entry k being the
    step from k to k + 1; of a redundant arm the nominal step is that of its whole command.

    ``q`` (takes, M+1, n) measured joint angles in rad; ``command`` (M, m) steps ẋᵈ_kΔt (m, rad), or
    (M, m + n) as the interface of chains has them. Measured minus nominal, as the additive model
    (InvDiffRndm) and (Omegk) need it; (OmgReal) prints the opposite sign. Raises
    SingularJacobianError.
    """
    chain.require_regular(q[:, :-1], what="measured pose")
    nominal = q[:, :-1] + chain.nominal_step(q[:, :-1], command)
    return q[:, 1:] - nominal


def mean_covariance(noise: np.ndarray) -> np.ndarray:
    """(n, n) Σ̂_ω = (1/M) Σ_k Σ̂_k in rad², Σ̂_k the covariance of ``noise`` ω (takes, M, n)."""
    return takes_moments(noise)[1].mean(axis=0)


def measurement_covariance(noise: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(n, n) Σ_m in rad²: the mean of the sample covariances of ``noise`` ω (takes, M, n) over the
    steps without a command, v_k = 0, where ω is the noise of its two measured poses alone.

    ``v`` (M, m) or longer. Raises ModelDomainError for a motion without rest or a single take.
    """
    still = ~np.any(v, axis=-1)
    if not np.any(still):
        raise ModelDomainError(
            "the motion never rests: the measurement noise cannot be separated from the motion's",
            steps=len(v),
        )
    return mean_covariance(noise[:, still])


def rest_covariance(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(n, n) in rad²: the mean of the sample covariances of measured poses ``q`` (takes, M+1, n)
    in rad over the takes, at the steps without a command.

    A measured pose's noise, and with it what a take is off all through, which Σ_m, of differences,
    does not hold; a closed loop takes the arm at rest to be on its path.
    """
    return measurement_covariance(q[:, :-1], v)


def recorded_deviation(q: np.ndarray, noise: np.ndarray, mode: str) -> np.ndarray:
    """(M+1, n) standard deviation in rad over the takes, to compare the realisations' with.

    ``q`` (takes, M+1, n) recorded angles, ``noise`` ω (takes, M, n), both in rad: of the process
    noise for ``one_step``, and zero at k = 0; of the joint angles for ``free_running``.
    """
    if mode == "one_step":
        return np.vstack([np.zeros((1, q.shape[-1])), noise.std(axis=0, ddof=1)])
    return q.std(axis=0, ddof=1)
