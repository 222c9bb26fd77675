"""The tables between stages: columns, units and ranges.

Every column's meaning and unit stand in its description. Joint angles q1, q2, q3 are the chain's joints in rad, in the sense of the
URDF; x, z, phi are task coordinates in the plane of the chain (m, m, rad); a step k counts the motion grid, k = 0 … M.
"""

from __future__ import annotations

import numpy as np
import pandera.pandas as pa


def _real(description: str, low: float | None = None, high: float | None = None, *, gaps: bool = False) -> pa.Column:
    checks = [pa.Check(np.isfinite, error="must be finite")]
    if low is not None:
        checks.append(pa.Check.ge(low))
    if high is not None:
        checks.append(pa.Check.le(high))
    return pa.Column("float64", checks, nullable=gaps, description=description)


def _log_density(description: str) -> pa.Column:
    """Minus infinity is a value: what happened had no probability; a gap is where there is no density."""
    return pa.Column("float64", pa.Check(lambda x: x < np.inf, error="must not be plus infinity"), nullable=True, description=description)


def _count(description: str, low: int = 0) -> pa.Column:
    return pa.Column("int64", pa.Check.ge(low), description=description)


def _flag(description: str) -> pa.Column:
    return pa.Column("bool", description=description)


def _text(description: str, among: tuple[str, ...] | None = None) -> pa.Column:
    return pa.Column("str", pa.Check.isin(among) if among else None, description=description)


def _joints(what: str, low: float | None = None, *, gaps: bool = False, prefix: str = "q") -> dict[str, pa.Column]:
    return {f"{prefix}{j}": _real(f"{what}, joint {j}, rad", low, gaps=gaps) for j in (1, 2, 3)}


def _covariance(what: str, *, prefix: str = "c", gaps: bool = False) -> dict[str, pa.Column]:
    return {f"{prefix}{i}{j}": _real(f"{what}, entry ({i}, {j}), rad²", gaps=gaps) for i in (1, 2, 3) for j in range(i, 4)}


TAKE = {"take": _text("name of the take"), "part": _text("training or test", ("training", "test"))}
STEP = {"k": _count("step of the motion grid"), "t": _real("time since the start of the motion, s", 0.0)}
VIEW = {"view": _text("which depth frame: initial or extended", ("initial", "extended"))}
REALIZATION = {"realization": _count("number of the realisation")}
RIDGE = {
    "u": _real("bound û of the norm of the inverse Jacobian", 0.0),
    "alpha": _real("best α for that bound", 0.0),
    "level": _real("α·sqrt(u² − ⟨‖J⁻¹‖²⟩), whose square times ‖v‖²/3 is the mean variance of the noise", 0.0),
    "excess": _real("how far the objective for (ũ, α) is above its least there: rad and rad² mixed, or nats of a likelihood", 0.0),
}

TABLES: dict[str, dict[str, pa.Column]] = {
    # ingest
    "trajectory": STEP
    | {c: _real(f"desired end-effector {c}") for c in ("x", "z", "phi")}
    | {f"v{c}": _real(f"desired end-effector velocity of {c}, per s") for c in ("x", "z", "phi")},
    "markers": TAKE
    | STEP
    | {"link": _count("link of the chain, 1 to 3; 0 for a marker without a label"), "marker": _count("marker on the link, from 1", 1)}
    | {c: _real(f"marker position {c} in the arm's base frame, m; missing while occluded", gaps=True) for c in "xyz"},
    "frames": TAKE
    | {
        "frame": _count("depth frame of the take"),
        "t": _real("time of the frame on the motion clock, s"),
        "file": _text("path of the frame's file, relative to the recordings, or of its bag and, after a #, its message there"),
        "valid": _real("share of the pixels, or of a cloud's points, that were measured", 0.0, 1.0),
    },
    "joint_log": TAKE | STEP | _joints("joint angle as the controller logged it"),
    "force": {
        "configuration": _text("configuration of the robots"),
        "t": _real("time since the start of the record, s", 0.0),
        "fx": _real("force at the platform along x, N, without bias"),
        "fy": _real("force at the platform along y, N, without bias"),
    },
    "quality": TAKE
    | {"instrument": _text("which instrument"), "quantity": _text("what was counted or measured")}
    | {"value": _real("its value"), "unit": _text("its unit")},
    # track
    "joints": TAKE | STEP | _joints("measured joint angle") | {"residual": _real("rms residual of the rigid-body fits, m", 0.0, gaps=True)},
    "takes": TAKE
    | {"measure": _text("what tells how good the take is"), "value": _real("its value"), "unit": _text("its unit")}
    | {"limit": _real("the size that it may have; missing where no limit is stated", 0.0, gaps=True)}
    | {"beyond": _flag("whether its size is greater"), "left_out": _flag("whether the take is left out of all that follows")},
    # articulate
    "angles": TAKE
    | {"frame": _count("depth frame of the take"), "t": _real("time on the motion clock, s")}
    | _joints("joint angle from the depth image")
    | {c: _real(f"{c} in the plane of the arm, m") for c in ("x2", "z2", "x3", "z3", "xe", "ze")}
    | {"points": _count("points of the arm in the frame"), "objective": _real("value of the articulation objective, m", 0.0)},
    "cloud": VIEW | {"x": _real("point of the arm, x in the plane, m"), "z": _real("point of the arm, z in the plane, m")},
    "skeleton": VIEW | {"node": _count("0: O1 … 3: EE"), "x": _real("x of the fitted node, m"), "z": _real("z of the fitted node, m")},
    # noise
    "process_noise": TAKE | STEP | _joints("process noise (measured minus nominal) of the step that ends at k", prefix="w"),
    "kinect_noise": {"take": _text("take left out of the estimate; 'none' where all are in")}
    | {"frame": _count("depth frame"), "t": _real("nominal time of the frame, s")}
    | _joints("mean of the Kinect noise", prefix="b")
    | _covariance("covariance of the Kinect noise", prefix="r"),
    # fit
    "perturbation": TAKE
    | STEP
    | {"norm": _real("‖B⁻¹ − I‖_F of the fit"), "bound": _flag("fit that ended on the bound of positive definiteness")},
    "ridge": RIDGE,
    # evaluate
    "one_step_scores": TAKE
    | STEP
    | {
        "moving": _flag("whether the step that ends at k was commanded to move"),
        "log_density": _log_density("log density of the measured pose, measurement noise included, ln rad⁻³"),
        "log_density_noiseless": _log_density("log density under the model alone, ln rad⁻³; missing at rest"),
        "energy": _real("energy score, measurement noise included, rad"),
    }
    | {f"z{j}": _real(f"measured pose minus predicted mean in predicted standard deviations, joint {j}", gaps=True) for j in (1, 2, 3)}
    | {
        "nees": _real("normalised estimation error squared of the prediction", 0.0, gaps=True),
        "log_determinant": _real("log determinant of the predicted covariance, ln rad⁶", gaps=True),
        "inverse_norm": _real("‖J⁻¹‖_F at the measured pose before the step, 1/m and 1 mixed", 0.0),
    },
    # control
    "control_scores": {
        "true": _text("model that the recordings were drawn from, or rest"),
        "fitted": _text("model fitted to them, by the estimator of the run's options or by its consistent one"),
        "undetermined": _flag("whether the recordings say nothing of its parameters: those of the real recordings were scored"),
        "log_score": _log_density("mean log score of a held-out step, measurement noise included, nats (rad⁻³)"),
        "difference": _real("its paired difference to that of the true law with its true parameters, nats", gaps=True),
        "low": _real("lower end of the 95 % interval of the difference over takes, nats", gaps=True),
        "high": _real("upper end, nats", gaps=True),
    }
    | {
        f"std_{what}_q{j}": _real(f"{meaning}, joint {j}", gaps=True)
        for j in (1, 2, 3)
        for what, meaning in {
            "correlation": "correlation over time of the model's standard deviation with that of the drawn noise",
            "relative_error": "its relative error",
        }.items()
    },
    # recover
    "parameter_recovery": {
        "data": _text("law that the data were drawn from"),
        "estimator": _text("option of the model whose estimator was given them"),
        "parameter": _text("name of the estimate, with its unit"),
        "truth": _real("value that the data were drawn with"),
        "mean": _real("mean estimate over the data sets"),
        "relative_bias": _real("mean estimate minus truth, over the truth's size"),
        "relative_bias_standard_error": _real("its standard error over the data sets", 0.0),
        "root_mean_square_error": _real("root mean square of the estimate minus truth", 0.0),
        "standard_deviation": _real("standard deviation of the estimates over the data sets", 0.0),
        "bootstrap_standard_error": _real("standard error by the bootstrap over the takes of a data set", 0.0),
        "coverage": _real("share of the data sets whose 95 % interval by the bootstrap holds the truth", 0.0, 1.0),
        "datasets": _count("data sets that gave an estimate", 2),
        "without_an_estimate": _count("data sets, or resamplings of their takes, that gave none"),
    },
    "sigma_b_choices": {
        "estimator": _text("option of the model with the paper's estimator"),
        "source": _text("what σ̂_B is of", ("recorded", "drawn", "drawn without measurement noise")),
        "truth": _real("σ_B that was drawn with; missing for the recordings", 0.0, gaps=True),
        "varied": _text("which choice is varied, the other being as the stage fit takes it", ("ratio", "floor")),
        "share": _real("α₂/α₁ over that of the stage fit", 0.0),
        "floor": _real("ε of B⁻¹ ⪰ εI", 0.0, 1.0),
        "sigma_b": _real("the paper's σ̂_B, the mean over all steps; missing where a problem was not solved to optimality", 0.0, gaps=True),
        "sigma_b_moving": _real("the mean over the steps with a command", 0.0, gaps=True),
        "bound": _real("share of the steps with a command that the floor held back", 0.0, 1.0, gaps=True),
    },
    # faults
    "faults": {"fault": _text("what was done to which file of valid recordings"), "instrument": _text("whose recordings")}
    | {"severity": _real("how grave the fault is, in its unit", 0.0), "severity_unit": _text("what that counts")}
    | {"outcome": _text("repaired (and counted), refused, unharmed or unnoticed; with the number of trials where they differ")}
    | {"as_expected": _flag("whether every trial ended as the rule says"), "rule": _text("what the pipeline owes the fault")}
    | {"found": _text("what was said in refusal or counted in repair, in the first trial")}
    | {"error": _real("rms error of what was recovered where it was not refused", 0.0, gaps=True)}
    | {"clean_error": _real("the same without the fault", 0.0), "error_unit": _text("rad of joint angles, N of moments of force")},
    # sensitivity
    "sensitivity": {
        "setting": _text("what is decided otherwise than in the base case; empty in the base case"),
        "variation": _text("how it is decided"),
        "claim": _text("id of the claim in reports/claims.yaml, or of the conclusion"),
        "about": _text("whose behaviour the claim is about", ("method", "robots", "specimen")),
        "case": _text("case of the claim"),
        "value": _real("what the rule looks at, in the claim's unit; missing where there is no evidence or it is not finite", gaps=True),
        "than": _real("what it is compared with, likewise", gaps=True),
        "holds": _text("whether the claim's rule holds in the case", ("holds", "fails", "no evidence")),
        "verdict": _text("whether it holds in every case on which there is evidence", ("holds", "fails", "no evidence")),
        "changed": _flag("whether the case came out otherwise than in the base case"),
    },
    # simulate
    "realizations": REALIZATION | STEP | _joints("simulated joint angle"),
    "moments": STEP
    | _joints("mean of the simulated joint angle", prefix="m")
    | _joints("standard deviation, missing where the model has none", 0.0, gaps=True, prefix="s"),
    # filter
    "posterior": TAKE
    | STEP
    | _joints("posterior mean", prefix="m")
    | _covariance("posterior covariance")
    | {
        "ess": _real("effective sample size", 0.0),
        "resampled": _flag("whether the step ended in resampling"),
        "measured": _flag("whether a measurement entered at the step"),
        "clipped": _count("particles whose noise covariance was clipped"),
        "outside": _count("particles beyond the joint limits or at a singular pose"),
    },
    # play
    "played_frames": TAKE
    | {"frame": _count("depth frame of the take"), "t": _real("time on the motion clock, s")}
    | _joints("joint angle from the depth image")
    | {"width": _count("width of the image, px", 1), "height": _count("height of the image, px", 1)}
    | {
        f"{axis}{node}": _real(f"{where} of node {node} in the image, px; 0 is O1, 3 the end-effector")
        for node in range(4)
        for axis, where in (("u", "distance from the left edge"), ("v", "distance from the upper edge"))
    },
    "played_posteriors": TAKE
    | STEP
    | {"model": _text("motion model of the filter")}
    | _joints("posterior mean", prefix="m")
    | _covariance("posterior covariance")
    | {"ess": _real("effective sample size", 0.0)}
    | _joints("measured joint angle"),
    # wrench
    "wrench_errors": {
        "agents": _count("number of cables m", 1),
        "system": _count("test system"),
        "error": _real("‖diag Cov(W) − Var(F)‖ / ‖Var(F)‖", 0.0),
        **{f"covariance_error_{form}": _real(f"‖Cov(W) − Cov(F)‖ / ‖Cov(F)‖ with the {form} Σ_S", 0.0) for form in ("diagonal", "full")},
    },
    "sigma_s": {
        "system_class": _text("bounds that the systems were drawn from"),
        "agents": _count("number of cables m", 1),
        "form": _text("diagonal, as in the paper, or full", ("diagonal", "full")),
        **{
            f"{name}{ij}": _real(f"{what}, entry ({', '.join(ij)})", None if name == "e" or (name, ij) == ("s", "12") else 0.0)
            for name, what in {
                "s": "mean of the optimal Σ_S over drawn systems",
                "se": "its standard error over the systems",
                "e": "expectation of the optimal Σ_S",
                "ee": "its standard error from quasi-Monte Carlo",
                "de": "standard error of a mean over as many systems, from quasi-Monte Carlo",
            }.items()
            for ij in ("11", "12", "22")
        },
        "clipped": _count("eigenvalues of single systems that Σ_S ≥ 0 held; entries, where Σ_S is diagonal"),
    },
    "wrench_spread": {"agents": _count("number of cables m", 1), "repeat": _count("repeat of the whole study")}
    | {"mean": _real("mean error over the test systems", 0.0), "maximum": _real("greatest error over the test systems", 0.0)},
    "force_density": {
        "configuration": _text("configuration of the robots"),
        "source": _text("measured or modelled", ("measured", "modelled")),
        "fx": _real("grid point, N"),
        "fy": _real("grid point, N"),
        "density": _real("kernel density, 1/N²", 0.0),
    },
    "force_moments": {
        "configuration": _text("configuration of the robots"),
        "source": _text("measured or modelled", ("measured", "modelled")),
        **{c: _real(f"mean of {c}, N") for c in ("fx", "fy")},
        **{f"var_{c}": _real(f"variance of {c}, N²", 0.0) for c in ("fx", "fy")},
        "cov": _real("covariance of fx and fy, N²"),
        "samples": _count("number of samples"),
    },
    "force_test": {
        "configuration": _text("configuration of the robots"),
        "form": _text("Σ_S of the model: diagonal, full, or none for Σ_S = 0", ("diagonal", "full", "none")),
        "energy_distance": _real("energy distance of the measured from the modelled force, N"),
        "two_sample_p_value": _real("its permutation p-value", 0.0, 1.0),
        "effective_samples": _real("samples of the record over its autocorrelation time", 0.0),
        "tested_samples": _count("samples of the thinned record", 2),
        **{f"matrix_share_{c}": _real(f"share of the modelled variance of {c} that Σ_S causes", 0.0, 1.0) for c in ("fx", "fy")},
    },
    # the synthetic laboratory's truth, for scoring alone
    "true_joints": TAKE | STEP | _joints("true joint angle"),
    "true_clock": TAKE | {"offset": _real("depth camera's clock minus motion clock at the start of the take, s")},
    # score
    "deviation": STEP
    | {"source": _text("recorded, or the model's name"), "error": _real("‖mean − recorded mean‖, rad", 0.0)}
    | _joints("standard deviation of the one-step process noise, missing where the model has none", 0.0, gaps=True, prefix="s"),
    "model_scores": {
        "steps": _text("which steps: all, moving, a third of these by ‖J⁻¹‖, or those of the particle filter"),
        "model": _text("motion model"),
        "score": _text("which score"),
        "mean": _log_density("its mean over the takes, in the score's unit"),
        "difference": _real("paired difference to the first model", gaps=True),
        "low": _real("lower end of its 95 % interval", gaps=True),
        "high": _real("upper end", gaps=True),
    },
    "ridges": {"model": _text("Gaussian matrix model")} | RIDGE,
    "filter_error": TAKE
    | STEP
    | {"model": _text("motion model of the filter")}
    | _joints("posterior mean minus ground truth", prefix="e")
    | _joints("posterior standard deviation", 0.0, prefix="s"),
}
