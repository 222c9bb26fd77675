"""Parametric and random-matrix model of the wrench of a cable system, stated or drawn in bounds.

The parametric model: tensions are normal, cable directions von Mises–Fisher, all independent.
Cable i pulls with fᵢ = Tᵢ·eᵢ at rᵢ, Tᵢ ~ N(T̲ᵢ, σ_Tᵢ²), eᵢ ~ vMF(e̲ᵢ, κᵢ) on the unit sphere of
R^p, of density ∝ exp(κ·eᵀe̲) (Mardia & Jupp, Directional Statistics, 2000, ch. 9); for p = 2 the
von Mises law of an angle. The wrench is W = Σᵢ Gᵢfᵢ, Gᵢ = [I; (rᵢ)×]: n = 3 rows in the plane (p =
2), and six in space (p = 3). Cables that meet in one point have no moment: G = I, n = p. The
concentration κ is the paper's σ_θ; a greater κ means less variance of the directions.

The random-matrix model: W = S·T with a matrix-variate normal static Jacobian S ~ N(S̲, Σ_S ⊗ Ψ_S)
and an independent normal actuation T ~ N(T̲, Σ_T). Wrenches alone do not determine Ψ_S: it enters
their covariance only by the factor tr{(Σ_T + T̲T̲ᵀ)Ψ_S} of Σ_S. Recorded S, or wrenches at several
known T, determine Σ_S and Ψ_S up to one factor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from scipy.special import ive

from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.core.options.analysis import Wrench
from pipeline.core.options.dataset import Arrangement, Force

FORMS = ("diagonal", "full")  # of Σ_S, see optimal_sigma_s
LIMITS = dict.fromkeys(("tension", "tension_sd", "concentration"), (0.0, np.inf))
LIMITS["elevation"] = (-np.pi / 2, np.pi / 2)


@dataclass(frozen=True)
class CableSystem:
    """One cable system of m cables, or an array of them; p = 2 in the plane, 3 in space.

    The wrench is Eq. (WrenchStatEq); the directions have the law of Eq. (vMis). Raises
    ModelDomainError for a negative σ_T and for κ ≤ 0.
    """

    tension: ndarray  # T̲ (..., m), N
    direction: ndarray  # e̲ (..., m, p), unit vectors from the platform along the cable
    tension_sd: ndarray  # σ_T (..., m), N
    concentration: ndarray  # κ (..., m), dimensionless
    # r (..., m, p), m, from the moments' reference point, axes as of ``direction``; None: r = 0
    attachment: ndarray | None = None

    def __post_init__(self) -> None:
        for name, values in vars(self).items():
            if values is not None:
                object.__setattr__(self, name, np.asarray(values, dtype=float))
        if np.any(self.tension_sd < 0) or np.any(self.concentration <= 0):
            raise ModelDomainError(
                "a cable system needs tension_sd ≥ 0 and concentration > 0",
            )

    @property
    def dimension(self) -> int:
        """Dimension p of the space, 2 or 3."""
        return self.direction.shape[-1]

    def in_units_of(self, length: float) -> "CableSystem":
        """Return the system with attachments divided by ``length`` in m; moments are then in N."""
        place = self.attachment
        return self if place is None else replace(self, attachment=place / length)

    def maps(self) -> ndarray:
        """Return Gᵢ (..., m, n, p), which maps a cable's force to the cable's wrench."""
        if self.attachment is None:
            return np.broadcast_to(
                np.eye(self.dimension),
                (*self.direction.shape, self.dimension),
            )
        return wrench_map(self.attachment)

    def jacobian(self) -> ndarray:
        """Return S̲ (..., n, m) of columns Gᵢe̲ᵢ, Eq. (static-jacobian) at the mean directions."""
        return np.einsum("...mnp,...mp->...nm", self.maps(), self.direction)


def mean_resultant_length(concentration: ndarray, dimension: int) -> ndarray:
    """Return A(κ) = I_{p/2}(κ)/I_{p/2−1}(κ) = E[eᵀe̲], ``dimension`` p: I₁/I₀ in the plane, coth κ
    − 1/κ in space. Exponential scaling avoids the overflow of I₀ beyond κ = 713; valid to κ = 1e9.
    """
    return ive(dimension / 2, concentration) / ive(dimension / 2 - 1, concentration)


def wrench_map(attachment: ndarray) -> ndarray:
    """Return G = [I; (r)×] (..., n, p) of a force at ``attachment`` r (..., p) in m."""
    p = attachment.shape[-1]
    force = np.broadcast_to(np.eye(p), (*attachment.shape, p))
    place = attachment
    if p == 2:
        place = np.insert(attachment, 2, 0.0, axis=-1)
    columns = np.cross(place[..., None, :], np.eye(3))
    moment = np.swapaxes(columns, -1, -2)
    if p == 2:  # only the moment about the plane's normal
        moment = moment[..., 2:, :2]
    return np.concatenate([force, moment], axis=-2)


def wrench_mean(system: CableSystem) -> ndarray:
    """Return E[W] = Σᵢ A(κᵢ)·T̲ᵢ·Gᵢe̲ᵢ (..., n) in N and N·m, shorter than the nominal S̲T̲."""
    length = mean_resultant_length(system.concentration, system.dimension)
    pull = length * system.tension
    return np.einsum("...nm,...m->...n", system.jacobian(), pull)


def wrench_covariance(system: CableSystem) -> ndarray:
    """Return Cov(W) = Σᵢ Gᵢ Cov(fᵢ) Gᵢᵀ (..., n, n) in N², N²·m and N²·m².

    Cov(fᵢ) = (T̲² + σ_T²)·E[eeᵀ] − T̲²A²·e̲e̲ᵀ, E[eeᵀ] = (A/κ)·I + (1 − pA/κ)·e̲e̲ᵀ (Mardia & Jupp
    2000, ch. 9). For p = 2 and G = I the diagonal is Eqs. (kapF11) and (kapF22); the paper omits
    the off-diagonal entry.
    """
    p = system.dimension
    length = mean_resultant_length(system.concentration, p)
    second_moment = system.tension**2 + system.tension_sd**2
    isotropic = second_moment * length / system.concentration
    mean_square = (length * system.tension) ** 2
    along = second_moment - mean_square - p * isotropic
    maps = system.maps()
    of_isotropic = np.einsum("...mip,...m,...mjp->...ij", maps, isotropic, maps)
    columns = system.jacobian()
    weighted = columns * along[..., None, :]
    return of_isotropic + weighted @ np.swapaxes(columns, -1, -2)


@dataclass(frozen=True)
class Bounds:
    """Bounds (low, high) of a cable's values, which are uniform and independent. Without an
    ``elevation`` cables are planar, else uniform on the sphere; without an ``attachment`` they meet
    in one point. Raises ConfigError for bounds in the wrong order or beyond LIMITS.
    """

    tension: Sequence[float]  # T̲, N
    direction: Sequence[float]  # θ̲, rad, in the plane of the first two axes
    tension_sd: Sequence[float]  # σ_T, N
    concentration: Sequence[float]  # κ (the paper's σ_θ)
    elevation: Sequence[float] | None = None  # rad, angle of a cable above that plane
    attachment: Sequence[float] | None = None  # m, each coordinate of r

    def __post_init__(self) -> None:
        for name, bounds in vars(self).items():
            if not bounds:
                continue
            low, high = bounds
            least, most = LIMITS.get(name, (-np.inf, np.inf))
            if not (least <= low <= high <= most and np.isfinite(high - low)):
                message = (
                    f"wrench bounds: {name} must be finite and {least:.3g} ≤ low ≤ high"
                )
                message += f" ≤ {most:.3g}, got {low}, {high}"
                raise ConfigError(message, key=name)

    @property
    def dimension(self) -> int:
        """Dimension p: 2 in the plane, 3 in space."""
        return 2 if self.elevation is None else 3

    @property
    def coordinates(self) -> int:
        """Number of random values of a cable."""
        of_attachment = 0 if self.attachment is None else self.dimension
        return self.dimension + 2 + of_attachment

    def directions(self, angle: ndarray, height: ndarray | None = None) -> ndarray:
        """Return unit vectors (..., p) at shares ``angle`` and, in space, ``height`` of bounds."""
        theta = interpolate(self.direction, angle)
        plane = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        if self.elevation is None:
            return plane
        # uniform heights: uniform on the sphere
        sine = interpolate(np.sin(self.elevation), height)[..., None]
        cosine = np.sqrt(1 - sine**2)
        return np.concatenate([cosine * plane, sine], axis=-1)


def interpolate(bounds: Sequence[float], share: ndarray) -> ndarray:
    """Return the values at ``share`` (any shape) of the range ``bounds``."""
    low, high = bounds
    return low + (high - low) * share


def systems_at(bounds: Bounds, points: ndarray) -> CableSystem:
    """Return the systems at ``points`` (coordinates, ..., m) of the unit cube: shares of the ranges
    of T̲, θ̲, σ_T, κ, in space the height, and the p coordinates of the attachment.
    """
    tension, angle, tension_sd, concentration, *further = points
    height = further.pop(0) if bounds.elevation else None
    attachment = None
    if bounds.attachment is not None:
        place = np.stack(further, axis=-1)
        attachment = interpolate(bounds.attachment, place)
    return CableSystem(
        interpolate(bounds.tension, tension),
        bounds.directions(angle, height),
        interpolate(bounds.tension_sd, tension_sd),
        interpolate(bounds.concentration, concentration),
        attachment,
    )


def draw_systems(
    bounds: Bounds,
    systems: int,
    agents: int,
    rng: Generator,
) -> CableSystem:
    """Draw ``systems`` cable systems of ``agents`` cables within ``bounds``."""
    return systems_at(bounds, rng.random((bounds.coordinates, systems, agents)))


def study_bounds(options: Wrench) -> Bounds:
    """Return the bounds of the paper's numerical study."""
    return Bounds(
        options.tension,
        options.direction,
        options.tension_std,
        options.kappa,
    )


def configuration_bounds(force: Force, robots: Arrangement) -> Bounds:
    """Return the bounds of a configuration; attachments over the characteristic length."""
    attachment = None
    if robots.attachment_bounds is not None:
        attachment = [end / force.length for end in robots.attachment_bounds]
    return Bounds(
        force.tension_bounds,
        robots.direction_bounds,
        force.tension_std_bounds,
        force.kappa_bounds,
        robots.elevation_bounds,
        attachment,
    )


def nominal_system(force: Force, robots: Arrangement) -> CableSystem:
    """Return the system of ``robots`` at the mean values, attachments over the characteristic
    length; the matrix model does not use the concentration. Raises ConfigError if a robot has no
    standard deviation of its tension.
    """
    agents = len(robots.tension)
    if len(force.tension_std) < agents:
        count = len(force.tension_std)
        message = (
            f"tension_std: {count} values for the {agents} robots of {robots.file}"
        )
        raise ConfigError(message, key="dataset.force.tension_std")
    azimuth = np.array(robots.direction)
    direction = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    if robots.elevation is not None:
        elevation = np.array(robots.elevation)[:, None]
        along = np.cos(elevation) * direction
        direction = np.concatenate([along, np.sin(elevation)], axis=-1)
    system = CableSystem(
        robots.tension,
        direction,
        force.tension_std[:agents],
        np.full(agents, force.kappa_bounds[0]),
        robots.attachment,
    )
    return system.in_units_of(force.length)


@dataclass(frozen=True)
class MatrixModel:
    """Matrix model without Σ_S of one system or an array of systems: n wrench rows, m actuators.
    S ~ N(S̲, Σ_S ⊗ Ψ_S) by Definition 1: vec(Sᵀ), Eq. (vec-of-a-matrix), is normal with the
    covariance Σ_S ⊗ Ψ_S, Eq. (Kron). Moments are in N·m, or in N if divided by a characteristic
    length.
    """

    jacobian: ndarray  # S̲ (..., n, m)
    actuation: ndarray  # T̲ (..., m), N
    actuation_cov: ndarray  # Σ_T (..., m, m), N²
    psi: ndarray  # Ψ_S (..., m, m)

    def sigma_s_factor(self) -> ndarray:
        """Return the factor of Σ_S in Cov(W), tr{(Σ_T + T̲T̲ᵀ)Ψ_S} = E[TᵀΨ_ST] in N² (...), by
        Theorem 5, Eq. (TorqCovRHS1) and E[TTᵀ] = Σ_T + T̲T̲ᵀ of Eq. (MeanOfDynParTrns).
        """
        mean = self.actuation
        psi = self.psi
        of_noise = np.einsum("...ij,...ji->...", self.actuation_cov, psi)
        return of_noise + np.einsum("...i,...ij,...j->...", mean, psi, mean)

    def actuation_part(self) -> ndarray:
        """Return S̲Σ_TS̲ᵀ (..., n, n), the covariance that the actuation alone causes."""
        return self.jacobian @ self.actuation_cov @ np.swapaxes(self.jacobian, -1, -2)

    def covariance(self, sigma_s: ndarray) -> ndarray:
        """Return Cov(W) = tr{(Σ_T + T̲T̲ᵀ)Ψ_S}·Σ_S + S̲Σ_TS̲ᵀ (..., n, n) for ``sigma_s`` Σ_S
        (..., n, n): Eqs. (TorqCov)–(CovWNonPar).
        """
        return self.sigma_s_factor()[..., None, None] * sigma_s + self.actuation_part()


def matrix_model(system: CableSystem) -> MatrixModel:
    """Return the matrix model of a cable system with S̲ at the mean directions e̲ and Ψ_S = I, as
    in the paper. The mean of S is A(κ)·S̲.
    """
    identity = np.eye(system.tension.shape[-1])
    covariance = system.tension_sd[..., None] ** 2 * identity
    return MatrixModel(system.jacobian(), system.tension, covariance, identity)


def unbounded_sigma_s(system: CableSystem) -> ndarray:
    """Return M = (Cov(F) − S̲Σ_TS̲ᵀ)/tr{(Σ_T + T̲T̲ᵀ)Ψ_S} (..., n, n), the Σ_S for which both
    models have equal covariances. Eigenvalues may be negative, because S̲Σ_TS̲ᵀ overstates the
    variance that the tensions cause along a cable.
    """
    model = matrix_model(system)
    of_matrix = wrench_covariance(system) - model.actuation_part()
    return of_matrix / model.sigma_s_factor()[..., None, None]


def optimal_sigma_s(unbounded: ndarray, form: str) -> tuple[ndarray, ndarray]:
    """Return the optimal Σ_S ≥ 0 (..., n, n), and the number (...) of eigenvalues that the bound
    sets to 0; ``unbounded`` is M (..., n, n).

    ``form`` "diagonal" is Eq. (SigSOptim), ‖diag Cov(W) − Var(F)‖ = c·‖diag Σ_S − diag M‖, c =
    tr{(Σ_T + T̲T̲ᵀ)Ψ_S}: each entry is max(0, Mᵢᵢ). "full" is the paper's modification, ‖Cov(W) −
    Cov(F)‖_F = c·‖Σ_S − M‖_F: the projection of M on the positive semidefinite matrices, which sets
    negative eigenvalues to 0 (Higham 1988). If it does, "full" depends on the characteristic
    length.
    """
    target = unbounded
    if form == "diagonal":
        target = unbounded * np.eye(unbounded.shape[-1])
    values, vectors = np.linalg.eigh(target)
    clipped = np.sum(values < 0, axis=-1)
    bounded = np.maximum(values, 0.0)
    scaled = vectors * bounded[..., None, :]
    projected = scaled @ np.swapaxes(vectors, -1, -2)
    return np.where(clipped[..., None, None] > 0, projected, target), clipped


def sample_wrenches(
    model: MatrixModel,
    sigma_s: ndarray,
    samples: int,
    rng: Generator,
) -> ndarray:
    """Draw independent wrenches W = S·T (samples, n) of one system, Eq. (wrench). Given T, S·T is
    N(S̲T, (TᵀΨ_ST)·Σ_S); ``sigma_s`` Σ_S (n, n) is positive semidefinite.
    """
    draw = partial(rng.multivariate_normal, size=samples, method="eigh")
    actuation = draw(model.actuation, model.actuation_cov)
    noise = draw(np.zeros(len(sigma_s)), sigma_s)
    scale = np.sqrt(np.einsum("ki,ij,kj->k", actuation, model.psi, actuation))
    return actuation @ model.jacobian.T + scale[:, None] * noise
