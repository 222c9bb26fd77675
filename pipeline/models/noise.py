"""Realisations of the process noise from recorded joint angles, and their moments at each step."""

import numpy as np
from numpy import ndarray

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.statistics.takes import takes_moments


def process_noise(chain: Chain, q: ndarray, command: ndarray) -> ndarray:
    """(takes, M, n) noise ω_{k+1} = q̃_{k+1} − q̃_k − J(q̃_k)⁻¹ẋᵈ_kΔt in rad of measured joint
    angles ``q`` (takes, M+1, n) in rad, entry k being the step from k to k + 1, and ``command`` (M,
    m) or longer.

    Measured minus nominal, as the additive model (InvDiffRndm) and (Omegk) need it; (OmgReal)
    prints the opposite sign. Raises SingularJacobianError.
    """
    chain.require_regular(q[:, :-1], what="measured pose")
    nominal = q[:, :-1] + chain.nominal_step(q[:, :-1], command)
    return q[:, 1:] - nominal


def mean_covariance(noise: ndarray) -> ndarray:
    """(n, n) Σ̂_ω = (1/M) Σ_k Σ̂_k in rad², Σ̂_k the covariance of ``noise`` ω (takes, M, n)."""
    return takes_moments(noise)[1].mean(axis=0)


def measurement_covariance(noise: ndarray, v: ndarray) -> ndarray:
    """(n, n) Σ_m in rad²: the mean of the sample covariances of ``noise`` ω (takes, M, n) over the
    steps without a command in ``v`` (M, m) or longer, where ω is the noise of its two measured
    poses alone. Raises ModelDomainError for a motion without rest or a single take.
    """
    still = ~np.any(v, axis=-1)
    if not np.any(still):
        message = "the motion never rests: measurement noise cannot be separated from the motion's"
        raise ModelDomainError(message, steps=len(v))
    return mean_covariance(noise[:, still])


def rest_covariance(q: ndarray, v: ndarray) -> ndarray:
    """(n, n) in rad², mean sample covariance over the takes of measured poses ``q`` (takes, M+1, n)
    in rad at the steps without a command: a measured pose's noise, and with it what a take is off
    all through, which Σ_m, of differences, does not hold.
    """
    return measurement_covariance(q[:, :-1], v)


def recorded_deviation(q: ndarray, noise: ndarray, mode: str) -> ndarray:
    """(M+1, n) standard deviation in rad over the takes: for ``one_step`` of ``noise`` ω (takes, M,
    n) in rad, zero at k = 0; for ``free_running`` of the recorded angles ``q`` (takes, M+1, n) in
    rad.
    """
    if mode == "one_step":
        return np.vstack([np.zeros((1, q.shape[-1])), noise.std(axis=0, ddof=1)])
    return q.std(axis=0, ddof=1)
