"""fit@model: the parameters of one motion model from the process noise of the training takes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.linalg import lu, qr

from pipeline import config, contracts, rng, schema
from pipeline.arm.model import load_arm
from pipeline.motion.additive import fit_covariance
from pipeline.motion.gaussian import frobenius
from pipeline.motion.gaussian_fit import fit_gaussian
from pipeline.motion.noise import moments
from pipeline.motion.wishart_fit import WishartFit, fit_wishart

INGEST, TRACK, NOISE, OUT = Path("data/ingest"), Path("data/track"), Path("data/noise"), Path("data/fit")
EXTENSIONS = np.linspace(0.005, 1.0, 200)  # ũ tried, as shares of the greatest ‖J̲⁻¹‖: the bound may at most double it


def run(model: str) -> None:
    """Fit ``model`` and write ``data/fit/MODEL`` and the numbers the paper states to ``reports/metrics``."""
    settings = config.sections("fit", item=model)
    robot, motion, options = settings.dataset.robot, settings.dataset.motion, settings.models.__dict__[model]
    chain = load_arm(robot.urdf, robot.joints, robot.tool, robot.locked).chain
    joints = contracts.read("joints", TRACK)
    takes, q = contracts.stacked(joints[joints.part == "training"], ["q1", "q2", "q3"])
    _, noise = contracts.stacked(contracts.read("process_noise", NOISE), ["w1", "w2", "w3"])
    v = contracts.read("trajectory", INGEST)[["vx", "vz", "vphi"]].to_numpy()[:-1] / motion.rate
    with contracts.replacing(OUT / model) as folder:
        if isinstance(options, schema.Additive):
            covariance = fit_covariance(noise)
            parameters, metrics = {"noise_covariance": covariance.tolist()}, _additive_metrics(covariance)
        elif isinstance(options, schema.Wishart):
            fit = fit_wishart(chain, q[:, :-1], v, noise, options.decomposition, options.floor)
            parameters = {"sigma_b": fit.sigma_b, "decomposition": options.decomposition}
            stream = rng.stream(settings.seed, f"fit.{model}")
            metrics = _wishart_metrics(fit) | _convex_check(fit, chain, q[:, :-1], v, noise, options, settings.scale.convex_checks, stream)
            steps = pd.DataFrame({"take": np.repeat(takes, len(v)), "part": "training", "k": np.tile(np.arange(1, len(v) + 1), len(takes))})
            norms = frobenius(fit.perturbations.s)
            contracts.write(steps.assign(t=steps.k / motion.rate, norm=norms, bound=fit.perturbations.bound), "perturbation", folder)
        else:
            parameters, metrics, ridge = _fit_gaussian(chain, q, v, noise, options)
            contracts.write(ridge, "ridge", folder)
        (folder / "parameters.json").write_text(json.dumps({"kind": options.kind} | parameters, indent=2) + "\n")
    contracts.write_metrics(metrics, Path(f"reports/metrics/fit_{model}.json"))


def _additive_metrics(covariance: np.ndarray) -> dict:
    std = np.sqrt(np.diag(covariance))
    entries = {f"sigma_omega_{i + 1}{j + 1}_rad2": covariance[i, j] for i in range(3) for j in range(i, 3)}
    pairs = ((0, 1), (0, 2), (1, 2))
    return entries | {f"correlation_omega_{i + 1}{j + 1}": covariance[i, j] / (std[i] * std[j]) for i, j in pairs}


def _wishart_metrics(fit: WishartFit) -> dict:
    return {
        "sigma_b": fit.sigma_b,
        "sigma_b_greatest_over_time": fit.dispersions.max(),
        "weights_ratio_alpha2_over_alpha1_rad": fit.weights[1] / fit.weights[0],
        "noise_at_rest_rms_rad": fit.rest_noise,
        "problems": len(fit.perturbations.bound),
        "problems_without_perturbation": int(np.sum(~fit.perturbations.s.any(axis=(1, 2)))),
        "problems_on_the_bound_of_definiteness": int(fit.perturbations.bound.sum()),
    }


def _convex_check(fit, chain, q, v, noise, options, checks, stream) -> dict:
    """Solve some of the problems as printed: the greatest relative excess of the closed form's objective over the solver's."""
    from pipeline.motion.convex import solve_perturbation

    steps = np.broadcast_to(v, q.shape).reshape(-1, 3)
    moving = np.flatnonzero(np.any(steps, axis=1))
    chosen = np.sort(stream.choice(moving, min(checks, len(moving)), replace=False))
    jacobians = chain.jacobian(q.reshape(-1, 3)[chosen])
    gaps = []
    for i, jacobian in zip(chosen, jacobians, strict=True):
        j1, j2 = lu(jacobian, permute_l=True) if options.decomposition == "lu" else qr(jacobian)
        _, objective = solve_perturbation(noise.reshape(-1, 3)[i], steps[i], j1, j2, fit.weights, options.floor)
        gaps.append((fit.perturbations.objective[i] - objective) / objective)
    return {"convex_problems_checked": len(chosen), "convex_check_greatest_relative_gap": float(np.abs(gaps).max())}


def _fit_gaussian(chain, q, v, noise, options) -> tuple[dict, dict, pd.DataFrame]:
    mean, covariance = moments(noise)
    mean_pose = q[:, :-1].mean(axis=0)
    inverse_norm = frobenius(chain.inverse_jacobian(mean_pose, what="mean pose"))
    fit = fit_gaussian(
        mean, covariance, np.zeros_like(mean), np.linalg.norm(v, axis=-1), inverse_norm,
        beta1=options.beta, extensions=EXTENSIONS * inverse_norm.max(),
    )  # fmt: skip
    metrics = {
        "u": fit.u,
        "alpha": fit.alpha,
        "extension_of_the_norm": fit.extension,
        "greatest_norm_of_the_inverse_jacobian": inverse_norm.max(),
        "objective": fit.objective,
        "extension_at_the_end_of_its_interval": bool(fit.at_end),
    }
    ridge = pd.DataFrame({"u": inverse_norm.max() + fit.extensions, "alpha": fit.alphas, "objective": fit.objectives})
    return {"alpha": fit.alpha, "u": fit.u}, metrics, ridge
