"""fit@model: the parameters of one motion model from the process noise of the training takes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline import config, contracts, rng, schema
from pipeline.arm.chain import PlanarChain
from pipeline.arm.model import load_arm
from pipeline.motion.additive import AdditiveModel, fit_covariance, shrunk_covariance, without_measurement
from pipeline.motion.convex_check import noise_covariance_gap, perturbation_gap
from pipeline.motion.gaussian import GaussianModel, frobenius
from pipeline.motion.gaussian_fit import fit_gaussian
from pipeline.motion.likelihood import fit_alpha_u, fit_sigma_b
from pipeline.motion.model import MotionModel
from pipeline.motion.noise import measurement_covariance, moments
from pipeline.motion.scaled import joint_step
from pipeline.motion.scaled_fit import ScaledFit, fit_scaled
from pipeline.motion.student_fit import StudentFit, fit_student
from pipeline.motion.wishart import WishartModel
from pipeline.motion.wishart_fit import fit_wishart

INGEST, TRACK, NOISE, OUT = Path("data/ingest"), Path("data/track"), Path("data/noise"), Path("data/fit")
EXTENSIONS = np.linspace(0.005, 1.0, 200)  # ũ tried, as shares of the greatest ‖J̲⁻¹‖: the bound may at most double it


@dataclass(frozen=True)
class Recorded:
    """The training takes, and which of the convex problems to check."""

    chain: PlanarChain
    q: np.ndarray  # (takes, M, 3) rad, pose before each step
    v: np.ndarray  # (M, 3) m, m, rad, commanded steps
    noise: np.ndarray  # (takes, M, 3) rad
    steps: pd.DataFrame  # take, part, k, t of every entry of noise
    checks: int
    stream: np.random.Generator


def run(model: str) -> None:
    """Fit ``model`` and write ``data/fit/MODEL`` and the numbers the paper states to ``reports/metrics``."""
    settings = config.sections("fit", item=model)
    robot, options = settings.dataset.robot, vars(settings.models)[model]
    joints, process_noise = contracts.read("joints", TRACK), contracts.read("process_noise", NOISE)
    _, q = contracts.stacked(joints[joints.part == "training"], ["q1", "q2", "q3"])
    v = contracts.read("trajectory", INGEST)[["vx", "vz", "vphi"]].to_numpy()[:-1] / settings.dataset.motion.rate
    recorded = Recorded(
        chain=load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain,
        q=q[:, :-1], v=v, noise=contracts.stacked(process_noise, ["w1", "w2", "w3"])[1], steps=process_noise[["take", "part", "k", "t"]],
        checks=settings.scale.convex_checks, stream=rng.stream(settings.seed, f"fit.{model}"),
    )  # fmt: skip
    fit = FITS[type(options), getattr(options, "estimator", None)]
    parameters, metrics, tables = fit(recorded, options)
    with contracts.replacing(OUT / model) as folder:
        for name, table in tables.items():
            contracts.write(table, name, folder)
        (folder / "parameters.json").write_text(json.dumps({"kind": options.kind} | parameters, indent=2) + "\n")
    contracts.write_metrics(metrics, Path(f"reports/metrics/fit_{model}.json"))


Fit = tuple[dict, dict, dict[str, pd.DataFrame]]  # parameters of the model, metrics, tables by name


def _additive(recorded: Recorded, options: schema.Additive) -> Fit:
    covariance = fit_covariance(recorded.noise)
    std = np.sqrt(np.diag(covariance))
    metrics = {f"sigma_omega_{i + 1}{j + 1}_rad2": covariance[i, j] for i in range(3) for j in range(i, 3)}
    metrics |= {f"correlation_omega_{i + 1}{j + 1}": covariance[i, j] / (std[i] * std[j]) for i, j in ((0, 1), (0, 2), (1, 2))}
    return {"noise_covariance": covariance.tolist()}, metrics, {}


def _additive_shrinkage(recorded: Recorded, options: schema.Additive) -> Fit:
    measurement = measurement_covariance(recorded.noise, recorded.v)
    shrunk, intensity = shrunk_covariance(recorded.noise)
    covariance, quiet = without_measurement(shrunk, measurement)
    metrics = {f"sigma_omega_{i + 1}{j + 1}_rad2": covariance[i, j] for i in range(3) for j in range(i, 3)}
    metrics |= {"shrinkage_intensity": intensity, "axes_without_noise_beyond_the_measurement": quiet}
    metrics |= _measured(recorded, AdditiveModel(covariance), measurement)
    return {"noise_covariance": covariance.tolist()}, metrics, {}


def _measured(recorded: Recorded, model: MotionModel, measurement: np.ndarray) -> dict:
    """The measurement noise added to every step, and the log-likelihood of the training takes with it, steps at rest included."""
    chain, q, v = recorded.chain, recorded.q, recorded.v
    q_next = q + np.matvec(chain.inverse_jacobian(q), v) + recorded.noise
    metrics = {f"measurement_noise_std_q{j + 1}_rad": std for j, std in enumerate(np.sqrt(np.diag(measurement)))}
    return metrics | {"log_likelihood_per_step_nat": model.log_density(chain, q, v, q_next, measurement).mean()}


def _wishart(recorded: Recorded, options: schema.Wishart) -> Fit:
    chain, q, v, noise = recorded.chain, recorded.q, recorded.v, recorded.noise
    fit = fit_wishart(chain, q, v, noise, options.decomposition, options.floor)
    perturbed, bound = fit.perturbations.s.any(axis=(1, 2)), fit.perturbations.bound
    problems = np.broadcast_to(v, q.shape).reshape(-1, 3)
    moving = np.flatnonzero(np.any(problems, axis=1))
    chosen = np.sort(recorded.stream.choice(moving, min(recorded.checks, len(moving)), replace=False))
    gap = perturbation_gap(
        fit.perturbations,
        chain,
        q.reshape(-1, 3),
        problems,
        noise.reshape(-1, 3),
        options.decomposition,
        fit.weights,
        options.floor,
        chosen,
    )
    metrics = {
        "sigma_b": fit.sigma_b,
        "sigma_b_greatest_over_time": fit.dispersions.max(),
        "weights_ratio_alpha2_over_alpha1_rad": fit.weights[1] / fit.weights[0],
        "noise_at_rest_rms_rad": fit.rest_noise,
        "problems": len(bound),
        "problems_without_perturbation": np.count_nonzero(~perturbed),
        "problems_on_the_bound_of_definiteness": np.count_nonzero(bound),
        "convex_problems_checked": len(chosen),
        "convex_check_greatest_relative_gap": gap,
    }
    table = recorded.steps.assign(norm=frobenius(fit.perturbations.s), bound=bound)
    return {"sigma_b": fit.sigma_b, "decomposition": options.decomposition}, metrics, {"perturbation": table}


def _wishart_likelihood(recorded: Recorded, options: schema.Wishart) -> Fit:
    measurement = measurement_covariance(recorded.noise, recorded.v)
    fit = fit_sigma_b(recorded.chain, recorded.q, recorded.v, recorded.noise, measurement, options.decomposition)
    metrics = {"sigma_b_of_greatest_likelihood": fit.sigma_b, "sigma_b_at_the_end_of_its_interval": fit.at_end}
    metrics |= _measured(recorded, WishartModel(fit.sigma_b, options.decomposition), measurement)
    return {"sigma_b": fit.sigma_b, "decomposition": options.decomposition}, metrics, {}


def _gaussian(recorded: Recorded, options: schema.Gaussian) -> Fit:
    mean, covariance = moments(recorded.noise)
    norms = frobenius(recorded.chain.inverse_jacobian(recorded.q.mean(axis=0), what="mean pose"))
    largest = norms.max()
    fit = fit_gaussian(
        mean, covariance, np.zeros_like(mean), np.linalg.norm(recorded.v, axis=-1), norms,
        beta1=options.beta, extensions=EXTENSIONS * largest,
    )  # fmt: skip
    chosen = norms[np.linspace(0, len(norms) - 1, min(recorded.checks, len(norms))).astype(int)]
    metrics = {
        "u": fit.u,
        "alpha": fit.alpha,
        "extension_of_the_norm": fit.extension,
        "greatest_norm_of_the_inverse_jacobian": largest,
        "objective": fit.objective,
        "extension_at_the_end_of_its_interval": fit.at_end,
        "convex_problems_checked": len(chosen),
        "convex_check_greatest_relative_gap": noise_covariance_gap(chosen, fit.alpha, fit.u),
    }
    ridge = pd.DataFrame({"u": largest + fit.extensions, "alpha": fit.alphas, "objective": fit.objectives})
    return {"alpha": fit.alpha, "u": fit.u}, metrics, {"ridge": ridge}


def _scaled(recorded: Recorded, options: schema.Scaled) -> Fit:
    fit = fit_scaled(recorded.noise, joint_step(recorded.chain, recorded.q, recorded.v), options.structure)
    floor, gain = np.sqrt(np.diag(fit.floor)), np.sqrt(np.diag(fit.gain))
    metrics = {f"std_at_rest_q{j + 1}_rad": floor[j] for j in range(3)}
    if options.structure == "timing":
        metrics["std_of_the_timing_error_steps"] = gain[0]
    else:
        metrics |= {f"std_share_of_the_step_q{j + 1}": gain[j] for j in range(3)}
    return {"floor": fit.floor.tolist(), "gain": fit.gain.tolist()}, metrics | _likelihood(fit), {}


def _student(recorded: Recorded, options: schema.Student) -> Fit:
    fit = fit_student(recorded.noise)
    scale = np.sqrt(np.diag(fit.scale))
    metrics = {"degrees_of_freedom": fit.nu, "degrees_of_freedom_at_the_end_of_their_interval": fit.at_end}
    metrics |= {f"scale_q{j + 1}_rad": scale[j] for j in range(3)}
    return {"nu": fit.nu, "scale": fit.scale.tolist()}, metrics | _likelihood(fit), {}


def _likelihood(fit: ScaledFit | StudentFit) -> dict:
    """In-sample, of the noise about its mean at each step."""
    return {
        "mean_log_likelihood_of_a_training_step_nats": fit.log_likelihood,
        "gain_over_the_additive_model_nats_per_step": fit.log_likelihood - fit.additive_log_likelihood,
    }


def _gaussian_likelihood(recorded: Recorded, options: schema.Gaussian) -> Fit:
    measurement = measurement_covariance(recorded.noise, recorded.v)
    fit = fit_alpha_u(recorded.chain, recorded.q, recorded.v, recorded.noise, measurement, EXTENSIONS)
    largest = fit.u - fit.extension
    metrics = {
        "u_of_greatest_likelihood": fit.u,
        "alpha_of_greatest_likelihood": fit.alpha,
        "greatest_norm_of_the_inverse_jacobian": largest,
        "extension_of_the_norm": fit.extension,
        "extension_at_the_end_of_its_interval": fit.at_end,
    }
    metrics |= _measured(recorded, GaussianModel(fit.alpha, fit.u), measurement)
    ridge = pd.DataFrame({"u": largest + fit.extensions, "alpha": fit.alphas, "objective": fit.objectives - fit.objective})
    return {"alpha": fit.alpha, "u": fit.u}, metrics, {"ridge": ridge}


FITS = {
    (schema.Additive, "paper"): _additive,
    (schema.Additive, "shrinkage"): _additive_shrinkage,
    (schema.Wishart, "paper"): _wishart,
    (schema.Wishart, "likelihood"): _wishart_likelihood,
    (schema.Gaussian, "paper"): _gaussian,
    (schema.Gaussian, "likelihood"): _gaussian_likelihood,
    (schema.Scaled, None): _scaled,
    (schema.Student, None): _student,
}
