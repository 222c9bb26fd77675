"""Estimators of σ_B of the Wishart model: by moments, by the paper's convex problem on every step,
and by maximum likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pipeline.core.errors import ModelDomainError
from pipeline.models.steps import Recorded, TakeVariances, moving_steps
from pipeline.models.wishart.decomposition import Decomposition, factors
from pipeline.models.wishart.law import StepSquares, WishartModel, dispersion_of_trace, step_squares
from pipeline.randommatrix.wishart import largest_dispersion, normalized_std

if TYPE_CHECKING:  # it loads the compiler
    from pipeline.models.wishart.perturbation import Perturbations

SIGMA_B_RANGE = (0.01, 2.0)  # of the likelihood; the widest is beyond all that have a density
TOLERANCE = 1e-4  # of ln σ_B, below the widest that has a density
COARSE = 0.05  # of ln σ_B: how near the greatest likelihood is sought before a spline is read
# of that spline over ln σ_B, on either side, and its nodes: they leave an error below 1e-4
REACH, NODES = 0.4, 9


class DispersionFit(NamedTuple):
    """σ̂_B, and its estimate from chosen takes; ``problems`` of the paper's estimator alone."""

    sigma_b: float
    from_takes: Callable[[np.ndarray], dict[str, float]]  # numbers of the takes → σ̂_B
    diagnostics: Mapping[str, float] = {}
    problems: SolvedProblems | None = None


def fit_moments(recorded: Recorded, decomposition: Decomposition) -> DispersionFit:
    """σ̂_B at which the mean of tr Cov over the takes and steps, plus the trace of the measurement
    noise, is the recorded total variance; it depends on no weight and no bound.

    Raises SingularJacobianError, and ModelDomainError where the recorded variance is not above that
    of the measurement noise, where that noise is not known, and as :func:`dispersion_of_trace`.
    """
    a, back, _ = factors(recorded.chain, recorded.q, recorded.v, decomposition)
    squares = StepSquares(*(each.mean(axis=1) for each in step_squares(a, back)))
    from_takes = partial(_by_moments, squares, TakeVariances.of(recorded), a.shape[-1])
    return DispersionFit(**from_takes(np.arange(len(a))), from_takes=from_takes)


def _by_moments(
    squares: StepSquares, variances: TakeVariances, m: int, takes: np.ndarray
) -> dict[str, float]:
    traces, measured = variances.of_motion(takes)
    own = StepSquares(*(each[takes].mean() for each in squares))
    return {"sigma_b": dispersion_of_trace(own, float(traces.mean()) - measured, m)}


class Problems(NamedTuple):
    """The problems (BsampOpt) of takes × M steps, to be solved under any weights."""

    noise: np.ndarray  # (takes, M, n) ω in rad
    a: np.ndarray  # (takes, M, m) J₁⁻¹v
    back: np.ndarray  # (takes, M, n, m) J₂⁺
    floor: float  # ε of B⁻¹ ⪰ εI

    @classmethod
    def of(cls, recorded: Recorded, decomposition: Decomposition, floor: float) -> Problems:
        """Build from the steps of ``recorded``; raises SingularJacobianError."""
        q, v, noise = recorded.q, recorded.v, recorded.noise
        commands = np.broadcast_to(v, (*q.shape[:-1], v.shape[-1]))
        a, back, _ = factors(recorded.chain, q, commands, decomposition)
        return cls(noise, a, back, floor)

    def solved(self, weights: tuple[float, float]) -> SolvedProblems:
        """Solve Eqs. (BsampOpt) and (const10) of each step under the ``weights`` (α₁, α₂)."""
        from pipeline.models.wishart.perturbation import fit_perturbations

        n, m = self.back.shape[-2:]
        flat = self.noise.reshape(-1, n), self.a.reshape(-1, m), self.back.reshape(-1, n, m)
        fits, identity = fit_perturbations(*flat, weights, self.floor), np.eye(m)
        b = np.linalg.inv(identity + fits.s.reshape(*self.a.shape, m))
        return SolvedProblems(normalized_std(b[None], identity) ** 2, fits, weights)

    def sigma_b(self, ratio: float) -> float:
        """σ̂_B, the mean of σ̂_Bk over the steps, at the weight ``ratio`` α₂/α₁ in rad."""
        return float(self.solved((1 / (1 + ratio), ratio / (1 + ratio))).dispersions.mean())


class SolvedProblems(NamedTuple):
    """Optimal perturbations of takes × M steps.

    E[B] is the model's, I, to which the last term of (BsampOpt) draws B, and not a sample mean.
    """

    squares: np.ndarray  # (takes, M) ‖B − I‖²/‖I‖² of each step
    perturbations: Perturbations  # take by take
    weights: tuple[float, float]  # α₁, α₂

    @property
    def dispersions(self) -> np.ndarray:
        """(M,) σ̂_Bk of each step, Eq. (NormStd)."""
        return np.sqrt(self.squares.mean(axis=0))


def fit_paper(
    recorded: Recorded, decomposition: Decomposition, floor: float, ratio_factor: float = 1.0
) -> DispersionFit:
    """σ̂_B = (1/M) Σ_k σ̂_Bk (Sec. "Motion uncertainty characterization"), with ``floor`` ε of
    B⁻¹ ⪰ εI and ``ratio_factor`` on α₂/α₁, which follows from the noise recorded at rest, or from
    the known Σ_m where the motion never rests.

    Resampled takes keep the weights of all. Raises ModelDomainError without either noise.
    """
    from pipeline.models.wishart.perturbation import objective_weights

    noise, v = recorded.noise, recorded.v
    still, known = (
        np.broadcast_to(~np.any(v, axis=-1), noise.shape[:-1]),
        recorded.known_measurement,
    )
    variance = 0.0 if known is None else np.trace(known)
    if still.any():
        variance = np.mean(np.sum(noise[still] ** 2, axis=-1))
    resting = float(np.sqrt(variance))
    weights = objective_weights(resting, len(recorded.chain.task), ratio_factor)
    solved = Problems.of(recorded, decomposition, floor).solved(weights)
    dispersions, fits, moving = solved.dispersions, solved.perturbations, ~still.all(axis=0)
    diagnostics = {
        "sigma_b_greatest_over_time": dispersions.max(),
        "sigma_b_mean_over_moving_steps": dispersions[moving].sum() / max(moving.sum(), 1),
        "share_of_steps_at_rest": 1 - moving.mean(),
        "weights_ratio_alpha2_over_alpha1_rad": weights[1] / weights[0],
        "noise_at_rest_rms_rad": resting,
        "problems": len(fits.bound),
        "problems_without_perturbation": int(np.count_nonzero(~fits.s.any(axis=(1, 2)))),
        "problems_on_the_bound_of_definiteness": int(np.count_nonzero(fits.bound)),
    }
    from_takes = partial(_by_problems, solved.squares)
    return DispersionFit(float(dispersions.mean()), from_takes, diagnostics, solved)


def _by_problems(squares: np.ndarray, takes: np.ndarray) -> dict[str, float]:
    counts = np.bincount(takes, minlength=len(squares))
    return {"sigma_b": float(np.sqrt(counts @ squares / counts.sum()).mean())}


def fit_likelihood(recorded: Recorded, decomposition: Decomposition) -> DispersionFit:
    """σ̂_B of greatest Σ ln p(q̃_{k+1} | q̃_k) over the steps with a command, p the exact density of
    a step plus the measurement noise, without which the slowest steps would decide.

    Raises SingularJacobianError and ModelDomainError.
    """
    from scipy.optimize import minimize_scalar

    chain, takes = recorded.chain, len(recorded.q)
    q, v, noise = moving_steps(recorded.q, recorded.v, recorded.noise)
    steps = chain, q, v, q + chain.nominal_step(q, v) + noise, recorded.measurement

    def by_take(log_sigma_b: float) -> np.ndarray:
        density = WishartModel(np.exp(log_sigma_b), decomposition).log_density(*steps)
        return density.reshape(takes, -1).sum(axis=1)

    widest = min(largest_dispersion(len(chain.task)), SIGMA_B_RANGE[1])
    low, high = np.log(SIGMA_B_RANGE[0]), np.log(widest) - TOLERANCE
    coarse = minimize_scalar(
        lambda x: -by_take(x).sum(), bounds=(low, high), method="bounded", options={"xatol": COARSE}
    )
    nodes = np.linspace(max(low, coarse.x - REACH), min(high, coarse.x + REACH), NODES)
    log_likelihoods = np.stack([by_take(x) for x in nodes], axis=1)
    best = _greatest(nodes, log_likelihoods.sum(axis=0))
    at_end = best in (low, high)
    from_takes = partial(_by_likelihood, nodes, log_likelihoods, at_end)
    diagnostics = {"sigma_b_at_the_end_of_its_interval": at_end}
    return DispersionFit(float(np.exp(best)), from_takes, diagnostics)


def _by_likelihood(
    nodes: np.ndarray, log_likelihoods: np.ndarray, at_end: bool, takes: np.ndarray
) -> dict[str, float]:
    best = _greatest(nodes, log_likelihoods[takes].sum(axis=0))
    if not at_end and best in (nodes[0], nodes[-1]):
        raise ModelDomainError(
            "the likelihood of these takes is greatest beyond where it was evaluated",
            takes=takes.tolist(),
        )
    return {"sigma_b": float(np.exp(best))}


def _greatest(x: np.ndarray, values: np.ndarray) -> float:
    """Argument at which the spline through ``values`` (N,) at ``x`` (N,) is greatest."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(x, values)
    candidates = np.concatenate([x[[0, -1]], spline.derivative().roots(extrapolate=False)])
    return float(candidates[spline(candidates).argmax()])
