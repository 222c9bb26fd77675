"""The parametric wrench model: tensions are normal, cable directions von Mises–Fisher, everything
independent.

Cable i pulls with fᵢ = Tᵢ·eᵢ at rᵢ, Tᵢ ~ N(T̲ᵢ, σ_Tᵢ²), eᵢ ~ vMF(e̲ᵢ, κᵢ) on the unit sphere of
R^p, of density ∝ exp(κ·eᵀe̲) (Mardia & Jupp, Directional Statistics, 2000, ch. 9); for p = 2 it
is the von Mises law of an angle. The wrench is W = Σᵢ Gᵢfᵢ, Gᵢ = [I; (rᵢ)×]: n = 3 rows in the
plane, p = 2, and six in space, p = 3. Cables that meet in one point have no moment: G = I, n = p.
The concentration κ is what the paper writes σ_θ: the larger, the narrower.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ive

from pipeline.core.errors import ModelDomainError

UNIT = 1e-9  # greatest deviation of a direction's length from 1
# beyond it the series in 1/κ is exact in double precision, and the Bessel functions fail at 1e9
LARGE = 1e6


@dataclass(frozen=True)
class CableSystem:
    """One cable system of m cables, or an array of them; p = 2 in the plane, 3 in space.

    Its wrench is that of Eq. (WrenchStatEq), the directions those of Eq. (vMis). Raises
    ModelDomainError for values without a law.
    """

    tension: np.ndarray  # T̲ (..., m), N
    direction: np.ndarray  # e̲ (..., m, p), unit vectors from the platform along the cable
    tension_sd: np.ndarray  # σ_T (..., m), N
    concentration: np.ndarray  # κ (..., m), dimensionless
    # r (..., m, p), m, in axes parallel to those of the directions; none where the cables meet in
    # the point that the wrench is taken about
    attachment: np.ndarray | None = None

    def __post_init__(self) -> None:
        given = {name: values for name, values in vars(self).items() if values is not None}
        for name, values in given.items():
            object.__setattr__(self, name, np.asarray(values, dtype=float))
        cables, places = self.tension.shape, self.direction.shape
        for name in given:
            due, own = places if name == "attachment" else cables, getattr(self, name)
            shape = own.shape[:-1] if name == "direction" else own.shape
            if shape != due or not np.isfinite(own).all():
                raise ModelDomainError(f"{name} must be finite, of shape {due}; it has {shape}")
        sound = np.abs(np.linalg.norm(self.direction, axis=-1) - 1) <= UNIT
        sound &= (self.tension_sd >= 0) & (self.concentration > 0)
        if not sound.all() or places[-1] not in (2, 3):
            required = "directions of length 1 in 2 or 3 coordinates, tension_sd ≥ 0"
            raise ModelDomainError(f"a cable system needs {required}, concentration > 0")

    @property
    def dimension(self) -> int:
        """p."""
        return self.direction.shape[-1]

    def in_units_of(self, length: float) -> "CableSystem":
        """Return the system with attachments over ``length`` in m: moments are then in N."""
        place = self.attachment
        return self if place is None else replace(self, attachment=place / length)

    def maps(self) -> np.ndarray:
        """Gᵢ (..., m, n, p), which maps the force of a cable to its wrench."""
        if self.attachment is None:
            return np.broadcast_to(np.eye(self.dimension), (*self.direction.shape, self.dimension))
        return wrench_map(self.attachment)

    def jacobian(self) -> np.ndarray:
        """S̲ (..., n, m), its columns Gᵢe̲ᵢ: Eq. (static-jacobian) at the means."""
        return np.einsum("...mnp,...mp->...nm", self.maps(), self.direction)


def mean_resultant_length(concentration: np.ndarray, dimension: int) -> np.ndarray:
    """A(κ) = I_{p/2}(κ)/I_{p/2−1}(κ) = E[eᵀe̲], any shape; ``dimension`` p: I₁/I₀ in the plane,
    coth κ − 1/κ in space. Without the exponential scaling I₀ overflows beyond κ = 713.
    """
    bounded = np.minimum(concentration, LARGE)
    ratio = ive(dimension / 2, bounded) / ive(dimension / 2 - 1, bounded)
    x, q = 1 / np.maximum(concentration, LARGE), dimension - 1
    return np.where(concentration > LARGE, 1 - q * x / 2 + q * (q - 2) * x**2 / 8, ratio)


def sample_directions(
    mean: np.ndarray, concentration: np.ndarray, samples: int, rng: np.random.Generator
) -> np.ndarray:
    """Draw unit vectors (samples, m, p) of cables with the ``mean`` directions e̲ (m, p) and
    ``concentration`` κ (m,): Eq. (vMis), and its counterpart in space.
    """
    from scipy.stats import vonmises_fisher

    laws = [vonmises_fisher(mu, kappa) for mu, kappa in zip(mean, concentration, strict=True)]
    return np.stack([law.rvs(samples, random_state=rng) for law in laws], axis=1)


def wrench_map(attachment: np.ndarray) -> np.ndarray:
    """G = [I; (r)×] (..., n, p) of a force at ``attachment`` r (..., p)."""
    p = attachment.shape[-1]
    place = attachment if p == 3 else np.insert(attachment, 2, 0.0, axis=-1)
    moment = np.swapaxes(np.cross(place[..., None, :], np.eye(3)), -1, -2)
    force = np.broadcast_to(np.eye(p), (*attachment.shape, p))
    return np.concatenate([force, moment if p == 3 else moment[..., 2:, :2]], axis=-2)


def wrench_mean(system: CableSystem) -> np.ndarray:
    """E[W] = Σᵢ A(κᵢ)·T̲ᵢ·Gᵢe̲ᵢ, (..., n) in N and N·m: shorter than the nominal S̲T̲."""
    pull = mean_resultant_length(system.concentration, system.dimension) * system.tension
    return np.einsum("...nm,...m->...n", system.jacobian(), pull)


def wrench_covariance(system: CableSystem) -> np.ndarray:
    """Cov(W) = Σᵢ Gᵢ Cov(fᵢ) Gᵢᵀ, (..., n, n) in N², N²·m and N²·m².

    Cov(fᵢ) = (T̲² + σ_T²)·E[eeᵀ] − T̲²A²·e̲e̲ᵀ, E[eeᵀ] = (A/κ)·I + (1 − pA/κ)·e̲e̲ᵀ (Mardia & Jupp
    2000, ch. 9). For p = 2 and G = I its diagonal is Eqs. (kapF11) and (kapF22); the paper leaves
    its off-diagonal entry out.
    """
    p = system.dimension
    length = mean_resultant_length(system.concentration, p)
    second_moment = system.tension**2 + system.tension_sd**2
    all_round = second_moment * length / system.concentration
    along = second_moment - (length * system.tension) ** 2 - p * all_round
    g = system.maps()
    round_part = np.einsum("...mip,...m,...mjp->...ij", g, all_round, g)
    columns = system.jacobian()
    return round_part + (columns * along[..., None, :]) @ np.swapaxes(columns, -1, -2)
