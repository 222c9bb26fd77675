"""Interface of all motion models (the law of one step q_{k+1} | q_k under a command), functions of
joint covariances.

A command is the task step v (m,). For an arm with more joints than task rows it may be (m + n,): v
and a joint step w (n,), of which the arm executes the part in the null space of J. The arm is at
rest if the whole command is zero.
"""

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.interface import Mechanism
from pipeline.core.errors import ModelDomainError

# kinds of compiled laws (pipeline.models.kernel); the numbers have no order
ADDITIVE_LAW, GAUSSIAN_LAW, QR_LAW, PIVOTED_LU_LAW, QR_TRANSPOSED_LAW = range(5)
WISHART_LAWS = {  # by the name of the decomposition; they apply B⁻¹ to a = J₁⁻¹v
    "pivoted_lu": PIVOTED_LU_LAW,
    "qr": QR_LAW,
    "qr_transposed": QR_TRANSPOSED_LAW,
}
# greatest relative asymmetry or negative eigenvalue that counts as rounding
TOLERANCE = 1e-12


class Law(NamedTuple):
    """Law of a step for compiled code (:mod:`pipeline.models.kernel`)."""

    kind: int  # one of the constants above
    parameters: ndarray  # (K,) of the law
    normals: int  # normal variates of a pose
    degrees: ndarray = np.empty(0)  # degrees of freedom of the χ² variates of a pose


class Traits(NamedTuple):
    """Properties of a law, for the filter, the export and the tests."""

    noisy_at_rest: bool  # the pose is random after a step without a command
    # the noise depends on J(q), not only on the commanded joint step
    needs_jacobian: bool
    # its ``law(chain)`` returns a Law; otherwise the filter calls ``sample``
    compiled: bool = True
    memory: bool = False  # it has the methods ``first_memory`` and ``advance``


class Commands(NamedTuple):
    """Commands v_k + κ(x*_k − x(q_k)) of M steps of m task rows, q_k the pose before the step."""

    v: ndarray  # (M, m) or (M, m + n)
    path: ndarray  # (M, p) x* before each step, a pose as the chain returns it
    share: float  # κ, share of the deviation from the path that a step corrects; 0: open loop


def open_loop(v: ndarray) -> Commands:
    """Commands ``v`` (M, m) or (M, m + n) that do not depend on the pose."""
    return Commands(v, np.zeros_like(v), 0.0)


def task_step(chain: Mechanism, command: ndarray) -> ndarray:
    """(..., m) v of the ``command`` (..., m) or (..., m + n)."""
    return command[..., : len(chain.task)]


def corrected_command(
    chain: Mechanism,
    q: ndarray,
    v: ndarray,
    target: ndarray,
    share: float,
) -> ndarray:
    """Commands v + κ(x* − x(q)) (..., m) or (..., m + n) of a closed loop with ``share`` κ at the
    poses ``q`` (..., n) in rad, x* the ``target`` poses (..., p) of the tip.
    """
    deviation = chain.displacement(chain.pose(q), target)
    shape = *deviation.shape[:-1], np.shape(v)[-1]
    command = np.array(np.broadcast_to(v, shape), float)
    command[..., : len(chain.task)] += share * deviation
    return command


def frobenius(matrix: ndarray) -> ndarray:
    """(...,) Frobenius norm of ``matrix`` (..., n, m), the paper's norm of a matrix."""
    return np.sqrt(np.einsum("...ij,...ij->...", matrix, matrix))


def principal_axes(covariance: ndarray) -> tuple[ndarray, ndarray]:
    """Return the variances (n,), ascending and ≥ 0, and the axes (n, n), in columns, of
    ``covariance``. Raises ModelDomainError if not finite, symmetric and positive semidefinite.
    """
    covariance = np.asarray(covariance, dtype=float)
    square = covariance.ndim == 2 and covariance.shape[0] == covariance.shape[1] > 0
    if square and np.all(np.isfinite(covariance)):
        variances, axes = np.linalg.eigh(covariance)
        greatest = max(np.abs(covariance).max(), 1e-300)
        asymmetry = np.abs(covariance - covariance.T).max() / greatest
        negative = -variances[0] / max(abs(variances[-1]), 1e-300)
        if max(asymmetry, negative) <= TOLERANCE:
            return np.maximum(variances, 0.0), axes
    message = "a covariance must be a finite, symmetric, positive semidefinite matrix"
    raise ModelDomainError(message, covariance=covariance.tolist())


def root(covariance: ndarray) -> ndarray:
    """(n, n) symmetric square root of ``covariance`` (n, n), which may be singular."""
    variances, axes = principal_axes(covariance)
    return (axes * np.sqrt(variances)) @ axes.T


def trace_factor(covariances: ndarray, trace: float) -> float:
    """Factor on ``covariances`` (..., n, n) in rad² that gives them the mean ``trace`` in rad²;
    raises ModelDomainError if they are all zero.
    """
    current = float(np.trace(covariances, axis1=-2, axis2=-1).mean())
    if not current > 0:
        message = "the model has no noise at any step: no level gives the variance"
        raise ModelDomainError(message, trace_rad2=current)
    return trace / current


def without_measurement(
    covariance: ndarray,
    measurement: ndarray,
) -> tuple[ndarray, int]:
    """Return ``covariance`` minus ``measurement`` (n, n) in rad² with negative variances set to
    zero, and the number of negative variances.
    """
    variances, axes = np.linalg.eigh(covariance - measurement)
    negative = int(np.count_nonzero(variances < 0))
    return (axes * np.maximum(variances, 0.0)) @ axes.T, negative


def normal_log_density(deviation: ndarray, covariance: ndarray) -> ndarray:
    """(...,) ln N(``deviation``; 0, ``covariance``) in rad⁻ⁿ; ``deviation`` (..., n) in rad and
    ``covariance`` (..., n, n) in rad² broadcast. Raises ModelDomainError for a singular covariance.
    """
    variances, axes = np.linalg.eigh(covariance)
    return axis_log_density(np.vecmat(deviation, axes) ** 2, variances)


def axis_log_density(squared: ndarray, variances: ndarray) -> ndarray:
    """(...,) log density of independent normals of ``variances`` (..., n), ascending, at squared
    deviations ``squared`` (..., n). Raises ModelDomainError as :func:`normal_log_density`.
    """
    singular = ~(variances[..., 0] > TOLERANCE * variances[..., -1])
    if np.any(singular):
        count = int(np.count_nonzero(singular))
        raise ModelDomainError(
            f"the covariance is singular at {count} of {singular.size} step(s), where the law has "
            "no density: give the covariance of the measurement noise",
            least_variance=float(variances.min()),
        )
    return -0.5 * (np.log(2 * np.pi * variances) + squared / variances).sum(axis=-1)


class MotionModel(ABC):
    """p(q_{k+1} | q_k) for the commanded step v = ẋᵈ_kΔt; by default the normal law of mean q_k +
    J⁺v + the null-space step, whose covariance a subclass defines.

    ``q`` (..., n) are joint angles in rad, ``v`` (m,), (..., m) or (..., m + n) is a command. All
    methods raise SingularJacobianError at a singular pose, ModelDomainError for a missing moment.
    A law sees the command of one step alone. If ``traits.memory`` it also sees numbers beside each
    pose, which its methods ``first_memory`` and ``advance`` return (:mod:`.joint_error.law`).
    """

    traits: ClassVar[Traits]

    @abstractmethod
    def covariance(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n, n) Cov(q_{k+1} | q_k = q) in rad²."""

    @abstractmethod
    def with_trace(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        trace: float,
    ) -> "MotionModel":
        """Return the model with the noise level (σ_B, α or a factor on a covariance) at which the
        covariances of the steps have the mean ``trace`` > 0 in rad². ModelDomainError if none has.
        """

    def mean(self, chain: Mechanism, q: ndarray, v: ndarray) -> ndarray:
        """(..., n) E[q_{k+1} | q_k = q] in rad."""
        return q + chain.nominal_step(q, v)

    def sample(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        rng: Generator,
    ) -> ndarray:
        """(..., n) one draw of q_{k+1} for each pose, with NumPy alone; the compiled
        :func:`pipeline.models.draws.draw_steps` is many times as fast.
        """
        mean = self.mean(chain, q, v)
        variances, axes = np.linalg.eigh(self.covariance(chain, q, v))
        white = np.sqrt(np.maximum(variances, 0.0)) * rng.standard_normal(mean.shape)
        return mean + np.matvec(axes, white)

    def log_density(
        self,
        chain: Mechanism,
        q: ndarray,
        v: ndarray,
        q_next: ndarray,
        measurement=None,
    ) -> ndarray:
        """(...,) ln p(q_{k+1} = q_next | q_k = q) in rad⁻ⁿ, of the step plus noise N(0,
        ``measurement``) (n, n) in rad² if given. Raises ModelDomainError for a singular covariance,
        e.g. of a matrix model at rest without ``measurement``.
        """
        covariance = self.covariance(chain, q, v)
        if measurement is not None:
            _ = principal_axes(measurement)  # raises if it is no covariance
            covariance = covariance + measurement
        return normal_log_density(q_next - self.mean(chain, q, v), covariance)
