"""The parameters of a motion model from recorded steps: which estimator goes with which option of ``models``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pipeline import schema
from pipeline.arm.chain import PlanarChain
from pipeline.motion.additive import fit_covariance, shrunk_covariance, without_measurement
from pipeline.motion.build import build_model
from pipeline.motion.decomposition import chosen
from pipeline.motion.gaussian import frobenius
from pipeline.motion.gaussian_fit import GaussianFit, fit_gaussian
from pipeline.motion.gaussian_forward_fit import ForwardLikelihood, forward_likelihood
from pipeline.motion.likelihood import fit_alpha_u, fit_sigma_b
from pipeline.motion.model import MotionModel
from pipeline.motion.noise import measurement_covariance, moments
from pipeline.motion.scaled import joint_step
from pipeline.motion.scaled_fit import Structure, fit_scaled
from pipeline.motion.student_fit import fit_student
from pipeline.motion.wishart_fit import fit_wishart

# ũ tried, as shares of the greatest ‖J̲⁻¹‖: the bound may at most double it
EXTENSIONS = np.linspace(0.005, 1.0, 200)
LIKELY_EXTENSIONS = np.geomspace(0.005, 1.0, 25)  # fewer, for a likelihood has to be searched over α at each


@dataclass(frozen=True)
class Recorded:
    """Recorded steps of one motion: what every estimator is given."""

    chain: PlanarChain
    q: np.ndarray  # (takes, M, 3) rad, measured pose before each step
    v: np.ndarray  # (M, 3) m, m, rad, commanded steps
    noise: np.ndarray  # (takes, M, 3) rad, ω of each step
    known_measurement: np.ndarray | None = None  # (3, 3) rad², where Σ_m is known

    @cached_property
    def measurement(self) -> np.ndarray:
        """(3, 3) Σ_m in rad², the noise of a step at rest where it is not known; raises ModelDomainError where the motion never rests."""
        return measurement_covariance(self.noise, self.v) if self.known_measurement is None else self.known_measurement

    @property
    def q_next(self) -> np.ndarray:
        """(takes, M, 3) rad, measured pose after each step."""
        return self.q + np.matvec(self.chain.inverse_jacobian(self.q), self.v) + self.noise

    def of(self, takes: np.ndarray) -> Recorded:
        """The takes with these numbers, as often as each is named."""
        return replace(self, q=self.q[takes], noise=self.noise[takes])


@dataclass(frozen=True)
class Estimate:
    """What an estimator returned."""

    parameters: dict[str, Any]  # of the model, plain values, as :func:`pipeline.motion.build.build_model` takes them
    estimates: dict[str, float]  # by name and unit: what a standard error can be given to
    diagnostics: dict[str, float]  # how the estimate came about
    details: Any = None  # the fit itself, where more than its parameters is asked of it

    @property
    def model(self) -> MotionModel:
        return build_model(self.parameters)


def estimate(recorded: Recorded, options: schema.Model) -> Estimate:
    """The parameters of the model ``options`` by the estimator they name; raises what that estimator raises."""
    return ESTIMATORS[type(options), getattr(options, "estimator", None)](recorded, options)


def mean_log_likelihood(recorded: Recorded, model: MotionModel) -> float:
    """Mean log density of the recorded steps in nats (rad⁻³) under ``model``, Σ_m added to every step, steps at rest included."""
    return float(model.log_density(recorded.chain, recorded.q, recorded.v, recorded.q_next, recorded.measurement).mean())


def covariance_entries(covariance: np.ndarray) -> dict[str, float]:
    """The estimates of an additive model by name: the entries of Σ_ω (3, 3), and the correlations of joints that have noise."""
    std = np.sqrt(np.diag(covariance))
    entries = {f"sigma_omega_{i + 1}{j + 1}_rad2": covariance[i, j] for i in range(3) for j in range(i, 3)}
    pairs = [(i, j) for i, j in ((0, 1), (0, 2), (1, 2)) if std[i] * std[j] > 0]
    return entries | {f"correlation_omega_{i + 1}{j + 1}": covariance[i, j] / (std[i] * std[j]) for i, j in pairs}


def _additive(recorded: Recorded, options: schema.Additive) -> Estimate:
    covariance = fit_covariance(recorded.noise)
    return Estimate({"kind": "additive", "noise_covariance": covariance.tolist()}, covariance_entries(covariance), {})


def _additive_shrinkage(recorded: Recorded, options: schema.Additive) -> Estimate:
    shrunk, intensity = shrunk_covariance(recorded.noise)
    covariance, quiet = without_measurement(shrunk, recorded.measurement)
    parameters = {"kind": "additive", "noise_covariance": covariance.tolist()}
    diagnostics = {"shrinkage_intensity": intensity, "axes_without_noise_beyond_the_measurement": quiet}
    return Estimate(parameters, covariance_entries(covariance), diagnostics)


def _wishart_parameters(sigma_b: float, options: schema.Wishart) -> dict[str, Any]:
    left = {} if options.left is None else {"left": options.left}
    return {"kind": "wishart", "sigma_b": sigma_b, "decomposition": options.decomposition} | left


def _wishart(recorded: Recorded, options: schema.Wishart) -> Estimate:
    fit = fit_wishart(
        recorded.chain,
        recorded.q,
        recorded.v,
        recorded.noise,
        chosen(options.decomposition, options.left),
        options.floor,
        options.ratio_factor,
    )
    diagnostics = {
        "sigma_b_greatest_over_time": fit.dispersions.max(),
        "weights_ratio_alpha2_over_alpha1_rad": fit.weights[1] / fit.weights[0],
        "noise_at_rest_rms_rad": fit.rest_noise,
        "problems": len(fit.perturbations.bound),
        "problems_without_perturbation": int(np.count_nonzero(~fit.perturbations.s.any(axis=(1, 2)))),
        "problems_on_the_bound_of_definiteness": int(np.count_nonzero(fit.perturbations.bound)),
    }
    parameters = _wishart_parameters(fit.sigma_b, options)
    return Estimate(parameters, {"sigma_b": fit.sigma_b}, diagnostics, fit)


def _wishart_likelihood(recorded: Recorded, options: schema.Wishart) -> Estimate:
    fit = fit_sigma_b(
        recorded.chain, recorded.q, recorded.v, recorded.noise, recorded.measurement, chosen(options.decomposition, options.left)
    )
    parameters = _wishart_parameters(fit.sigma_b, options)
    return Estimate(parameters, {"sigma_b": fit.sigma_b}, {"sigma_b_at_the_end_of_its_interval": fit.at_end}, fit)


def _bounded(fit: GaussianFit, norms: np.ndarray, v: np.ndarray) -> Estimate:
    """(α, u) are hardly told apart; α·sqrt(u² − ⟨‖J⁻¹‖²⟩) is told well, its square times ‖v‖² being the mean variance of the noise.

    ⟨⟩ weighs ``norms`` (..., M) by the square of the commanded steps ``v`` (M, 3).
    """
    mean_square = np.average(norms**2, weights=np.broadcast_to(np.vecdot(v, v), norms.shape))
    estimates = {"u": fit.u, "alpha": fit.alpha, "noise_level": fit.alpha * np.sqrt(fit.u**2 - mean_square)}
    diagnostics = {
        "extension_of_the_norm": fit.extension,
        "greatest_norm_of_the_inverse_jacobian": fit.u - fit.extension,
        "rms_norm_of_the_inverse_jacobian": np.sqrt(mean_square),
        "objective": fit.objective,
        "extension_at_the_end_of_its_interval": fit.at_end,
    }
    return Estimate({"kind": "gaussian", "alpha": fit.alpha, "u": fit.u}, estimates, diagnostics, fit)


def _gaussian(recorded: Recorded, options: schema.Gaussian) -> Estimate:
    mean, covariance = moments(recorded.noise)
    norms = frobenius(recorded.chain.inverse_jacobian(recorded.q.mean(axis=0), what="mean pose"))
    fit = fit_gaussian(
        mean, covariance, np.zeros_like(mean), np.linalg.norm(recorded.v, axis=-1), norms,
        beta1=options.beta, extensions=EXTENSIONS * norms.max(),
    )  # fmt: skip
    return _bounded(fit, norms, recorded.v)


def _gaussian_likelihood(recorded: Recorded, options: schema.Gaussian) -> Estimate:
    if options.form == "forward":
        return forward_estimate(forward_likelihood(recorded.chain, recorded.q, recorded.v, recorded.noise, recorded.measurement))
    fit = fit_alpha_u(recorded.chain, recorded.q, recorded.v, recorded.noise, recorded.measurement, LIKELY_EXTENSIONS)
    return _bounded(fit, frobenius(recorded.chain.inverse_jacobian(recorded.q)), recorded.v)


def forward_estimate(likelihood: ForwardLikelihood) -> Estimate:
    """As of the inverse form, α and u are hardly told apart; √s = α·sqrt(u² − ⟨‖J‖²⟩)/3 is told well."""
    fit, mean_square = likelihood.fit(LIKELY_EXTENSIONS), np.mean(likelihood.norms**2)
    estimates = {"u": fit.u, "alpha": fit.alpha, "noise_level": fit.alpha * np.sqrt(fit.u**2 - mean_square) / 3}
    diagnostics = {
        "extension_of_the_norm": fit.extension,
        "greatest_norm_of_the_jacobian": fit.u - fit.extension,
        "objective": fit.objective,
        "estimate_at_the_end_of_its_interval": fit.at_end,
    }
    return Estimate({"kind": "gaussian", "form": "forward", "alpha": fit.alpha, "u": fit.u}, estimates, diagnostics, likelihood)


def scaled_entries(floor: np.ndarray, gain: np.ndarray, structure: Structure) -> dict[str, float]:
    """The estimates of a model scaled with speed by name, from its A in rad² and B (3, 3)."""
    at_rest, shares = np.sqrt(np.diag(floor)), np.sqrt(np.diag(gain))
    entries = {f"std_at_rest_q{j + 1}_rad": at_rest[j] for j in range(3)}
    if structure == "timing":
        return entries | {"std_of_the_timing_error_steps": shares[0]}
    return entries | {f"std_share_of_the_step_q{j + 1}": shares[j] for j in range(3)}


def _scaled(recorded: Recorded, options: schema.Scaled) -> Estimate:
    fit = fit_scaled(recorded.noise, joint_step(recorded.chain, recorded.q, recorded.v), recorded.measurement, options.structure)
    parameters = {"kind": "scaled", "floor": fit.floor.tolist(), "gain": fit.gain.tolist()}
    return Estimate(parameters, scaled_entries(fit.floor, fit.gain, options.structure), {})


def student_entries(nu: float, scale: np.ndarray) -> dict[str, float]:
    """The estimates of a Student model by name, from ν and its scale matrix (3, 3) in rad²."""
    return {"degrees_of_freedom": nu} | {f"scale_q{j + 1}_rad": np.sqrt(scale[j, j]) for j in range(3)}


def _student(recorded: Recorded, options: schema.Student) -> Estimate:
    fit = fit_student(recorded.noise, recorded.measurement)
    diagnostics = {"degrees_of_freedom_at_the_end_of_their_interval": fit.at_end}
    return Estimate({"kind": "student", "nu": fit.nu, "scale": fit.scale.tolist()}, student_entries(fit.nu, fit.scale), diagnostics, fit)


ESTIMATORS: dict[tuple[type, str | None], Callable[[Recorded, Any], Estimate]] = {
    (schema.Additive, "paper"): _additive,
    (schema.Additive, "shrinkage"): _additive_shrinkage,
    (schema.Wishart, "paper"): _wishart,
    (schema.Wishart, "likelihood"): _wishart_likelihood,
    (schema.Gaussian, "paper"): _gaussian,
    (schema.Gaussian, "likelihood"): _gaussian_likelihood,
    (schema.Scaled, None): _scaled,
    (schema.Student, None): _student,
}
