"""Estimators of σ_B of the Wishart model: by moments, by the paper's convex problem on every step,
and by maximum likelihood. Each fit has ``sigma_b``, ``diagnostics`` and ``from_takes``, the
estimate of the takes with these numbers, as often as each is named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.models.steps import Recorded, TakeVariances, moving_steps
from pipeline.models.wishart.decomposition import Decomposition, factors
from pipeline.models.wishart.law import StepSquares, WishartModel, dispersion_of_trace, step_squares
from pipeline.models.wishart.perturbation import Perturbations, fit_perturbations, objective_weights
from pipeline.randommatrix.wishart import largest_dispersion, normalized_std

SIGMA_B_RANGE = (0.01, 2.0)  # of the likelihood; the widest is beyond all that have a density
TOLERANCE = 1e-4  # of ln σ_B, below the widest that has a density
COARSE = 0.05  # of ln σ_B: how near the greatest likelihood is sought before a spline is read
# of that spline over ln σ_B, on either side, and its nodes: they leave an error below 1e-4
REACH, NODES = 0.4, 9


@dataclass(frozen=True)
class MomentFit:
    """σ̂_B of the recorded total variance; it depends on no weight and no bound."""

    squares: StepSquares  # (takes,) means over the steps
    variances: TakeVariances
    m: int  # rows of the task

    @property
    def sigma_b(self) -> float:
        """σ̂_B of all takes."""
        return self.from_takes()["sigma_b"]

    @property
    def diagnostics(self) -> dict[str, float]:
        """No numbers."""
        return {}

    def from_takes(self, takes: np.ndarray | None = None) -> dict[str, float]:
        """σ̂_B of the ``takes``, or of all."""
        traces, measured = self.variances.of_motion(takes)
        own = StepSquares(*(each[... if takes is None else takes].mean() for each in self.squares))
        level = float(traces.mean()) - measured
        return {"sigma_b": dispersion_of_trace(own, level, self.m)}


def fit_moments(recorded: Recorded, decomposition: Decomposition) -> MomentFit:
    """σ̂_B at which the mean of tr Cov over the takes and steps, plus the trace of the measurement
    noise, is the recorded total variance.

    Raises SingularJacobianError, and ModelDomainError where the recorded variance is not above that
    of the measurement noise, where that noise is not known, and as :func:`dispersion_of_trace`.
    """
    a, back, _ = factors(recorded.chain, recorded.q, recorded.v, decomposition)
    squares = StepSquares(*(each.mean(axis=1) for each in step_squares(a, back)))
    fit = MomentFit(squares, TakeVariances.of(recorded), a.shape[-1])
    _ = fit.sigma_b  # raises where there is none
    return fit


@dataclass(frozen=True)
class Problems:
    """The problems (BsampOpt) of takes × M steps, to be solved under any weights."""

    noise: np.ndarray  # (takes, M, n) ω in rad
    a: np.ndarray  # (takes, M, m) J₁⁻¹v
    back: np.ndarray  # (takes, M, n, m) J₂⁺
    floor: float  # ε of B⁻¹ ⪰ εI

    @classmethod
    def of(
        cls,
        chain: Chain,
        q: np.ndarray,
        v: np.ndarray,
        noise: np.ndarray,
        decomposition: Decomposition,
        floor: float,
    ) -> Problems:
        """Build from poses ``q`` and ``noise`` (takes, M, n) in rad under ``v`` (M, ·) or
        (takes, M, ·); raises SingularJacobianError.
        """
        commands = np.broadcast_to(v, (*q.shape[:-1], v.shape[-1]))
        a, back, _ = factors(chain, q, commands, decomposition)
        return cls(noise, a, back, floor)

    def solved(self, weights: tuple[float, float]) -> tuple[np.ndarray, Perturbations]:
        """(takes, M) ‖B − I‖²/‖I‖² of each step under the ``weights`` (α₁, α₂), and the
        perturbations.

        B comes from Eqs. (BsampOpt) and (const10); E[B] is the model's, I, to which the last term
        of (BsampOpt) draws it, and not a sample mean. The root of the mean over the takes is σ̂_Bk
        of Eq. (NormStd).
        """
        n, m = self.back.shape[-2:]
        flat = self.noise.reshape(-1, n), self.a.reshape(-1, m), self.back.reshape(-1, n, m)
        fits, identity = fit_perturbations(*flat, weights, self.floor), np.eye(m)
        b = np.linalg.inv(identity + fits.s.reshape(*self.a.shape, m))
        return normalized_std(b[None], identity) ** 2, fits

    def sigma_b(self, ratio: float) -> float:
        """σ̂_B, the mean of σ̂_Bk over the steps, at the weight ``ratio`` α₂/α₁ in rad."""
        squares, _ = self.solved((1 / (1 + ratio), ratio / (1 + ratio)))
        return float(np.sqrt(squares.mean(axis=0)).mean())


@dataclass(frozen=True)
class PaperFit:
    """σ̂_B by the paper's convex problem on every step."""

    squares: np.ndarray  # (takes, M) ‖B − I‖²/‖I‖² of each step
    perturbations: Perturbations  # of takes × M problems, take by take
    weights: tuple[float, float]  # α₁, α₂
    rest_noise: float  # rad, rms of ‖ω‖ where the command rests
    moving: np.ndarray  # (M,) whether a step was commanded to move in a take

    @property
    def dispersions(self) -> np.ndarray:
        """(M,) σ̂_Bk of each step, Eq. (NormStd)."""
        return np.sqrt(self.squares.mean(axis=0))

    @property
    def sigma_b(self) -> float:
        """σ̂_B, the mean over the steps."""
        return float(self.dispersions.mean())

    def from_takes(self, takes: np.ndarray) -> dict[str, float]:
        """σ̂_B of the ``takes``; the weights are those of all takes."""
        counts = np.bincount(takes, minlength=len(self.squares))
        return {"sigma_b": float(np.sqrt(counts @ self.squares / counts.sum()).mean())}

    @property
    def diagnostics(self) -> dict[str, float]:
        """Numbers of the convex problems."""
        moving, fits = self.moving, self.perturbations
        unperturbed = ~fits.s.any(axis=(1, 2))
        return {
            "sigma_b_greatest_over_time": self.dispersions.max(),
            "sigma_b_mean_over_moving_steps": self.dispersions[moving].sum() / max(moving.sum(), 1),
            "share_of_steps_at_rest": 1 - moving.mean(),
            "weights_ratio_alpha2_over_alpha1_rad": self.weights[1] / self.weights[0],
            "noise_at_rest_rms_rad": self.rest_noise,
            "problems": len(fits.bound),
            "problems_without_perturbation": int(np.count_nonzero(unperturbed)),
            "problems_on_the_bound_of_definiteness": int(np.count_nonzero(fits.bound)),
        }


def rest_noise(noise: np.ndarray, v: np.ndarray, measurement: np.ndarray | None = None) -> float:
    """Root mean square of ‖ω‖ in rad over the steps of ``noise`` (takes, M, n) at which the
    command ``v``, (M, ·) or (takes, M, ·), is zero; where none is, that of ``measurement`` noise
    Σ_m (n, n), or zero.
    """
    still = np.broadcast_to(~np.any(v, axis=-1), noise.shape[:-1])
    if still.any():
        return float(np.sqrt(np.mean(np.sum(noise[still] ** 2, axis=-1))))
    return 0.0 if measurement is None else float(np.sqrt(np.trace(measurement)))


def problems_of(recorded: Recorded, decomposition: Decomposition, floor: float) -> Problems:
    """The problems (BsampOpt) of the steps of ``recorded``."""
    steps = recorded.chain, recorded.q, recorded.v, recorded.noise
    return Problems.of(*steps, decomposition, floor)


def fit_paper(
    recorded: Recorded, decomposition: Decomposition, floor: float, ratio_factor: float = 1.0
) -> PaperFit:
    """σ̂_B = (1/M) Σ_k σ̂_Bk (Sec. "Motion uncertainty characterization"), with ``floor`` ε of
    B⁻¹ ⪰ εI and ``ratio_factor`` on α₂/α₁, which follows from the noise recorded at rest.

    Raises ModelDomainError where the motion never rests and the noise of its measurement is not
    known.
    """
    v, m = recorded.v, len(recorded.chain.task)
    resting = rest_noise(recorded.noise, v, recorded.known_measurement)
    weights = objective_weights(resting, m, ratio_factor)
    squares, fits = problems_of(recorded, decomposition, floor).solved(weights)
    moving = np.any(v, axis=-1)
    moving = moving.any(axis=0) if moving.ndim > 1 else moving
    return PaperFit(squares, fits, weights, resting, moving)


@dataclass(frozen=True)
class LikelihoodFit:
    """σ̂_B of greatest likelihood, and the likelihood of each take about it."""

    sigma_b: float
    at_end: bool  # whether it is at an end of the interval where B has a density
    log_sigma_b: np.ndarray  # (NODES,) ascending
    log_likelihoods: np.ndarray  # (takes, NODES) Σ ln p over the steps of each take

    @property
    def diagnostics(self) -> dict[str, float]:
        """Flag of a σ̂_B at an end of its interval."""
        return {"sigma_b_at_the_end_of_its_interval": self.at_end}

    def from_takes(self, takes: np.ndarray) -> dict[str, float]:
        """σ̂_B of the ``takes``; raises ModelDomainError where it is beyond the nodes."""
        best = _greatest(self.log_sigma_b, self.log_likelihoods[takes].sum(axis=0))
        if not self.at_end and best in (self.log_sigma_b[0], self.log_sigma_b[-1]):
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


def fit_likelihood(recorded: Recorded, decomposition: Decomposition) -> LikelihoodFit:
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
    return LikelihoodFit(float(np.exp(best)), best in (low, high), nodes, log_likelihoods)
