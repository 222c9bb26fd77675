"""outlook: the paper's models on two extensions, a hexapod and cables that tow a load."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from pipeline.arm.interface import Mechanism
from pipeline.core import rng
from pipeline.core.columns import SPACE
from pipeline.core.errors import ConfigError, ModelDomainError
from pipeline.figures import style
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kinds import build_model
from pipeline.models.model import MotionModel, frobenius
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.law import WishartModel
from pipeline.statistics.takes import paired_difference
from pipeline.studies.frame import Tables, concatenate, interval, number
from pipeline.wrench import models as cables
from pipeline.wrench.study import averaged_sigma_s, covariance_errors, variance_errors

LEGS = 6
# the order of the task's rows does not change them
DECOMPOSITIONS = (
    "qr_transposed",
    "qr",
)
# Least accepted singular value of J⁻¹ over the greatest possible entry: below this value, an error
# of a leg of a thousandth of the robot's size moves the platform by the whole size.
LEAST_SINGULAR = 1e-3
BLOCKS = {"forces": slice(3), "moments": slice(3, 6)}
# form of Σ_S, and distance from the parametric model
ERRORS = {
    "variance": ("diagonal", variance_errors),
    "covariance": ("full", covariance_errors),
}

LINES = {  # look of each model
    "additive": style.MODELS["additive"] | {"label": "additive"},
    "gaussian": style.MODELS["gaussian"] | {"label": "Gaussian"},
    "qr_transposed": {
        "label": r"Wishart, QR of $J^{\mathsf{T}}$",
        "color": style.BLUE,
        "ls": "--",
    },
    "qr": {
        "label": "Wishart, QR of $J$",
        "color": style.GREEN,
        "ls": (0, (6, 1.5, 1, 1.5)),
    },
}


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables; raises ConfigError for an impossible robot or motion."""
    motion = motion_of(options)
    least = np.linalg.svd(motion.inverse, compute_uv=False)[:, -1]
    place = {"place": np.linspace(0, 1, len(motion.q)), "least_singular_value": least}
    hexapod = []
    for name, model in equal_models(motion, options.noise, options.bound).items():
        rotation = motion.pose_covariance(model)[:, 3:, 3:]
        std = np.sqrt(np.trace(rotation, axis1=1, axis2=2)) / options.length
        hexapod.append(pd.DataFrame({"model": name, **place, "rotation": std}))

    study = settings.wrench
    bounds = replace(
        cables.study_bounds(study),
        attachment=options.attachment,
        elevation=options.elevation,
    )
    sizes = study.systems, study.test_systems
    towing = []
    for repeat in range(study.repeats):
        stream = rng.stream(settings.seed, "outlook.towing", repeat)
        rows = error_rows(bounds, options.agents, sizes, stream)
        towing.append(rows.assign(repeat=repeat))
    errors = concatenate(towing)
    return {
        "hexapod": concatenate(hexapod),
        "towing": errors,
        "towing_slopes": slope_rows(errors),
    }


def legs_at(robot: SimpleNamespace, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lengths (..., 6) in m of the legs, a hexapod's joints (Gough 1962, Stewart
    1965), and J⁻¹ (..., 6, 6) at ``pose`` (..., 12).

    ``base`` and ``platform`` (6, 3) of ``robot`` in m are the legs' ends, each in its own frame;
    ``length`` in m multiplies the angular rows. A pose is position (3, m) and rotation (9, row by
    row) of the platform in the base frame; task rows are velocity and angular velocity in base
    axes. Row i of J⁻¹ is nᵢᵀ, (bᵢ × nᵢ)ᵀ over the length: nᵢ the unit vector along leg i from base
    to platform, bᵢ its joint on the platform from the platform's origin.
    """
    base = np.array(robot.base)
    platform = np.array(robot.platform)
    *places, _ = pose.shape
    position = pose[..., None, :3]
    rotation = pose[..., 3:].reshape(*places, 3, 3)
    arms = np.einsum("...ij,kj->...ki", rotation, platform)
    legs = position + arms - base
    lengths = np.linalg.norm(legs, axis=-1)
    n = legs / lengths[..., None]
    turning = np.cross(arms, n) / robot.length
    inverse = np.concatenate([n, turning], axis=-1)
    return lengths, inverse


@dataclass(frozen=True)
class PlatformMotion(Mechanism):
    """Commanded steps ``v`` (K, 6) in m from K poses of a hexapod with legs ``q`` (K, 6) in m."""

    task: ClassVar[tuple[str, ...]] = SPACE
    q: np.ndarray
    v: np.ndarray
    inverse: np.ndarray  # J⁻¹ (K, 6, 6) at the poses

    def singular(self, q: np.ndarray) -> np.ndarray:
        """Return the mask (K,), all False, because :func:`motion_of` refuses singular poses."""
        return np.zeros(np.shape(q)[:-1], dtype=bool)

    def inverse_jacobian(self, q: np.ndarray, *, what: str = "pose") -> np.ndarray:
        """Return J⁻¹ (K, 6, 6) at the poses of the motion, whose legs are ``q``."""
        assert np.array_equal(q, self.q)
        return self.inverse

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return J (K, 6, 6) at the poses of the motion."""
        return np.linalg.inv(self.inverse_jacobian(q))

    def pose_covariance(self, model: MotionModel) -> np.ndarray:
        """Return the covariance (K, 6, 6) in m² of the pose after one step, of first order J
        Cov(q_{k+1}|q_k) Jᵀ, rotations times the length.
        """
        legs = model.covariance(self, self.q, self.v)
        jacobian = self.jacobian(self.q)
        return jacobian @ legs @ np.swapaxes(jacobian, -1, -2)


def motion_of(options: SimpleNamespace) -> PlatformMotion:
    """Return the hexapod's motion between two poses at constant velocity and angular velocity.

    Raises ConfigError if a leg exceeds its limits, or if J⁻¹ is singular during the motion, so that
    the legs do not hold the platform (Gosselin and Angeles 1990).
    """
    start, end = np.array(options.position)
    shift = end - start
    first, last = map(Rotation.from_rotvec, np.array(options.turn))
    turn = (last * first.inv()).as_rotvec()
    share = np.linspace(0, 1, options.places)[:, None]
    positions = start + share * shift
    turned = Rotation.from_rotvec(share * turn) * first
    rotations = turned.as_matrix().reshape(-1, 9)
    q, inverse = legs_at(options, np.hstack([positions, rotations]))
    shortest, longest = options.legs
    if q.min() < shortest or q.max() > longest:
        message = f"legs must be {shortest:g} to {longest:g} m long, the motion needs "
        message += f"{q.min():.4g} to {q.max():.4g} m; choose other ends or legs"
        raise ConfigError(message, key="legs")
    if not holds_platform(inverse, options):
        message = "the motion has a pose at which the legs do not hold the platform; choose a "
        message += "smaller turn, or joints of base and platform that are not similar"
        raise ConfigError(message, key="turn")
    whole_step = np.concatenate([shift, options.length * turn])
    v = np.broadcast_to(whole_step / options.places, q.shape)
    return PlatformMotion(q, v, inverse)


def holds_platform(inverse: np.ndarray, options: SimpleNamespace) -> bool:
    """Return True if the legs hold the platform at all poses: J⁻¹ (K, 6, 6) is regular and its
    determinant keeps its sign.
    """
    radius = np.linalg.norm(options.platform, axis=1).max()
    greatest_entry = max(1.0, radius / options.length)
    least = np.linalg.svd(inverse, compute_uv=False).min()
    if least < LEAST_SINGULAR * greatest_entry:
        return False
    determinants = np.linalg.det(inverse)
    return len(np.unique(np.sign(determinants))) == 1


def equal_models(
    motion: PlatformMotion,
    noise: float,
    bound: float,
) -> dict[str, MotionModel]:
    """Return the models by name, each with rms noise of the legs of ``noise`` times their rms step;
    ``bound`` is u over the greatest norm of J⁻¹. Raises ConfigError without such a Wishart model.
    """
    steps = np.matvec(motion.inverse, motion.v)
    trace = noise**2 * float(np.mean(np.vecdot(steps, steps)))
    isotropic = (trace / LEGS * np.eye(LEGS)).tolist()
    greatest = frobenius(motion.inverse).max()
    models: dict[str, MotionModel] = {
        "additive": build_model({"kind": "additive", "noise_covariance": isotropic}),
        "gaussian": GaussianModel(1.0, bound * greatest),
    }
    for name in DECOMPOSITIONS:
        models[name] = WishartModel(0.1, Decomposition(name))
    try:
        for name, model in models.items():
            models[name] = model.with_trace(motion, motion.q, motion.v, trace)
    except ModelDomainError as error:
        message = (
            f"no Wishart model has rms noise of {noise:g} times the step; choose less"
        )
        raise ConfigError(message, key="noise") from error
    return models


def lever(bounds: cables.Bounds) -> float:
    """Return the root mean square distance in m of an attachment from the load's origin."""
    low, high = bounds.attachment
    return float(np.sqrt(bounds.dimension * (low**2 + low * high + high**2) / 3))


def error_rows(
    bounds: cables.Bounds,
    agents: Sequence[int],
    sizes: tuple[int, int],
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Return rows of ``towing``: Σ_S over ``sizes[0]`` systems, tested on ``sizes[1]`` others."""
    rows = []
    unit = lever(bounds)
    for m, stream in zip(agents, rng.spawn(len(agents)), strict=True):
        drawn, fresh = (
            cables.draw_systems(bounds, size, m, stream).in_units_of(unit)
            for size in sizes
        )
        estimates = averaged_sigma_s(drawn)
        model = cables.matrix_model(fresh)
        covariance = cables.wrench_covariance(fresh)
        for name, block in BLOCKS.items():
            row = {"part": name, "agents": m}
            for error, (form, distance) in ERRORS.items():
                modelled = model.covariance(estimates[form].mean)
                errors = distance(
                    modelled[:, block, block],
                    covariance[:, block, block],
                )
                row[error] = errors.mean()
            rows.append(row)
    return pd.DataFrame(rows)


def slope_rows(errors: pd.DataFrame) -> pd.DataFrame:
    """Return the table ``towing_slopes``: slopes of log error over log m, Student's interval."""
    rows = []
    for name, of_block in errors.groupby("part", sort=False):
        for error in ERRORS:
            means = of_block.pivot(index="agents", columns="repeat", values=error)
            log_agents = np.log(means.index.to_numpy(float))
            log_errors = np.log(means).to_numpy()
            slopes, _ = np.polyfit(log_agents, log_errors, 1)
            mean = paired_difference(slopes, np.zeros_like(slopes))
            rows.append((name, error, mean.difference, mean.low, mean.high))
    columns = ["part", "error", "slope", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    motion = tables["hexapod"]
    errors = tables["towing"]
    ends = motion.groupby("model", sort=False)["rotation"].agg(["first", "last"])
    means = 100 * errors.groupby(["part", "agents"])[list(ERRORS)].mean()
    few, many = errors["agents"].agg(["min", "max"])
    cells = []
    for row in tables["towing_slopes"].itertuples():
        form, _ = ERRORS[row.error]
        of_block = means.loc[row.part, row.error]
        cell = [f"{row.error} of {row.part}, {form} Σ_S"]
        cell += [number(of_block[few]), number(of_block[many])]
        cells.append([*cell, interval(row.slope, row.low, row.high)])
    ratios = ends["last"] / ends["first"]
    least = motion["least_singular_value"]
    return ratios.to_dict() | {
        "least": least.iloc[[0, -1]].tolist(),
        "few": few,
        "many": many,
        "repeats": errors["repeat"].nunique(),
        "cells": cells,
    }


def draw(hexapod: pd.DataFrame, towing: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    figure, ((rotation, wrench),) = style.panels(style.TWO_COLUMNS, 2.6, columns=2)
    for model, line in LINES.items():
        rows = hexapod[hexapod["model"] == model]
        rotation.plot(rows["place"], 1e3 * rows["rotation"], **line)
    rotation.set(xlabel="share of the motion (1)", ylabel="std of the rotation (mrad)")
    rotation.set_ylim(0, None)
    rotation.legend()

    means = 100 * towing.groupby(["part", "agents"])[list(ERRORS)].mean()
    for name, color in (("forces", style.BLUE), ("moments", style.VERMILLION)):
        for error, dashes in zip(ERRORS, ("-", "--"), strict=True):
            look = {"color": color, "marker": "o", "ms": 2.5}
            label = f"{error} of {name}"
            wrench.plot(means.loc[name, error], dashes, label=label, **look)
    wrench.set(xscale="log", yscale="log", xlabel="number of cables")
    wrench.set_ylabel("error (%)")
    agents = list(means.index.unique("agents"))
    wrench.set_xticks(agents, [str(m) for m in agents])
    wrench.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    wrench.minorticks_off()
    wrench.legend()
    style.letters((rotation, wrench))
    return figure
