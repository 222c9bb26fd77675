"""σ_B of the Wishart model: the convex problem on every recorded step, then the dispersion of the
samples of B.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.arm.interface import Chain
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.factors import factors
from pipeline.models.wishart.perturbation import (
    Perturbations,
    fit_perturbations,
    objective_weights,
)
from pipeline.randommatrix.wishart import normalized_std


@dataclass(frozen=True)
class WishartFit:
    """σ̂_B and how it came about."""

    sigma_b: float
    squares: np.ndarray  # (takes, M) ‖B − I‖²/‖I‖² of each step
    perturbations: Perturbations  # of takes × M problems, take by take
    weights: tuple[float, float]  # α₁, α₂
    rest_noise: float  # rad, rms of ‖ω‖ where the command rests

    @property
    def dispersions(self) -> np.ndarray:
        """(M,) σ̂_Bk of each step, Eq. (NormStd)."""
        return np.sqrt(self.squares.mean(axis=0))

    def from_takes(self, takes: np.ndarray) -> dict[str, float]:
        """Return σ̂_B of the takes with these numbers, as often as each is named; the weights stay
        those of all takes.
        """
        counts = np.bincount(takes, minlength=len(self.squares))
        return {"sigma_b": float(np.sqrt(counts @ self.squares / counts.sum()).mean())}


def rest_noise(noise: np.ndarray, v: np.ndarray, measurement: np.ndarray | None = None) -> float:
    """Root mean square of ‖ω‖ in rad over the steps of ``noise`` (takes, M, n) at which the
    command ``v``, (M, ·) or (takes, M, ·), is zero; where none is, that of ``measurement`` noise
    Σ_m (n, n), or zero.
    """
    still = np.broadcast_to(~np.any(v, axis=-1), noise.shape[:-1])
    if still.any():
        return float(np.sqrt(np.mean(np.sum(noise[still] ** 2, axis=-1))))
    return 0.0 if measurement is None else float(np.sqrt(np.trace(measurement)))


def fit_wishart(
    chain: Chain,
    q: np.ndarray,
    v: np.ndarray,
    noise: np.ndarray,
    decomposition: Decomposition,
    floor: float,
    ratio_factor: float = 1.0,
    measurement: np.ndarray | None = None,
) -> WishartFit:
    """σ̂_B = (1/M) Σ_k σ̂_Bk (Sec. "Motion uncertainty characterization").

    The weights follow from the noise recorded at rest. Raises ModelDomainError where the motion
    never rests and the noise of its measurement is not known.

    Args:
        chain: of n joints and m task rows.
        q: (takes, M, n) measured poses in rad before each step.
        v: (M, m) or longer, commands.
        noise: (takes, M, n) ω in rad.
        decomposition: of the Jacobian.
        floor: ε of B⁻¹ ⪰ εI.
        ratio_factor: on α₂/α₁.
        measurement: (n, n) Σ_m in rad², of a motion that never rests.
    """
    resting = rest_noise(noise, v, measurement)
    weights = objective_weights(resting, len(chain.task), ratio_factor)
    problems = Problems.of(chain, q, v, noise, decomposition, floor)
    squares, fits = problems.solved(weights)
    sigma_b = float(np.sqrt(squares.mean(axis=0)).mean())
    return WishartFit(sigma_b, squares, fits, weights, resting)


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
        """Of the steps of :func:`fit_wishart`; raises SingularJacobianError."""
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
        fits = fit_perturbations(
            self.noise.reshape(-1, n),
            self.a.reshape(-1, m),
            self.back.reshape(-1, n, m),
            weights,
            self.floor,
        )
        identity = np.eye(m)
        b = np.linalg.inv(identity + fits.s.reshape(*self.a.shape, m))
        return normalized_std(b[None], identity) ** 2, fits

    def sigma_b(self, ratio: float) -> float:
        """σ̂_B, the mean of σ̂_Bk over the steps, at the weight ``ratio`` α₂/α₁ in rad."""
        squares, _ = self.solved((1 / (1 + ratio), ratio / (1 + ratio)))
        return float(np.sqrt(squares.mean(axis=0)).mean())
