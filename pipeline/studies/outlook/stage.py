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
DECOMPOSITIONS = (
    "qr_transposed",
    "qr",
)  # the order of the task's rows does not change them
# Least accepted singular value of J⁻¹ over the greatest possible entry: below this value, an error
# of a leg of a thousandth of the robot's size moves the platform by the whole size.
LEAST_SINGULAR = 1e-3
PARTS = {"forces": slice(3), "moments": slice(3, 6)}
# form of Σ_S, and distance from the parametric model
ERRORS = {
    "variance": ("diagonal", variance_errors),
    "covariance": ("full", covariance_errors),
}


def evaluate(settings: SimpleNamespace, options: SimpleNamespace) -> Tables:
    """Return the study's tables; raises ConfigError for an impossible robot or motion."""
    motion, study = motion_of(options), settings.wrench
    models = equal_models(motion, options.noise, options.bound)
    ranges = {"attachment": options.attachment, "elevation": options.elevation}
    towed = replace(cables.study_bounds(study), **ranges), options.agents
    sizes = study.systems, study.test_systems
    streams = [
        rng.stream(settings.seed, "outlook.towing", n) for n in range(study.repeats)
    ]
    parts = [
        error_rows(*towed, sizes, each).assign(repeat=n)
        for n, each in enumerate(streams)
    ]
    towing, hexapod = concatenate(parts), []
    least = np.linalg.svd(motion.inverse, compute_uv=False)[:, -1]
    place = {"place": np.linspace(0, 1, len(motion.q)), "least_singular_value": least}
    for name, model in models.items():
        turn = motion.covariances(model)[1][:, 3:, 3:]
        std = np.sqrt(np.trace(turn, axis1=1, axis2=2)) / options.length
        hexapod.append(pd.DataFrame({"model": name, **place, "rotation": std}))
    slopes = slope_rows(towing)
    return {"hexapod": concatenate(hexapod), "towing": towing, "towing_slopes": slopes}


def legs_at(robot: SimpleNamespace, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lengths (..., 6) in m of the legs, a hexapod's joints (Gough 1962, Stewart
    1965), and J⁻¹ (..., 6, 6) at ``pose`` (..., 12).

    ``base`` and ``platform`` (6, 3) of ``robot`` in m are the legs' ends, each in its own frame;
    ``length`` in m multiplies the angular rows. A pose is position (3, m) and rotation (9, row by
    row) of the platform in the base frame; task rows are velocity and angular velocity in base
    axes. Row i of J⁻¹ is nᵢᵀ, (bᵢ × nᵢ)ᵀ over the length: nᵢ the unit vector along leg i from base
    to platform, bᵢ its joint on the platform from the platform's origin.
    """
    rotation = pose[..., 3:].reshape(*pose.shape[:-1], 3, 3)
    arms = np.einsum("...ij,kj->...ki", rotation, np.array(robot.platform))
    legs = pose[..., None, :3] + arms - np.array(robot.base)
    lengths = np.linalg.norm(legs, axis=-1)
    n = legs / lengths[..., None]
    return lengths, np.concatenate([n, np.cross(arms, n) / robot.length], axis=-1)


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

    def covariances(self, model: MotionModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the covariances (K, 6, 6) in m² of the legs after one step and of the next pose,
        of first order J Cov(q_{k+1}|q_k) Jᵀ, rotations times the length.
        """
        legs, jacobian = model.covariance(self, self.q, self.v), self.jacobian(self.q)
        return legs, jacobian @ legs @ np.swapaxes(jacobian, -1, -2)


def pose_of(position: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return the pose (12,) at ``position`` (3,) in m with the rotation vector ``turn`` (3,)."""
    return np.concatenate([position, Rotation.from_rotvec(turn).as_matrix().ravel()])


def motion_of(options: SimpleNamespace) -> PlatformMotion:
    """Return the hexapod's motion between two poses at constant velocity and angular velocity.

    Raises ConfigError if a leg exceeds its limits, or if J⁻¹ is singular during the motion, so that
    the legs do not hold the platform (Gosselin and Angeles 1990).
    """
    start, end = map(pose_of, np.array(options.position), np.array(options.turn))
    limits, places = options.legs, options.places
    before, after = (
        Rotation.from_matrix(pose[3:].reshape(3, 3)) for pose in (start, end)
    )
    shift, turn = end[:3] - start[:3], (after * before.inv()).as_rotvec()
    share = np.linspace(0, 1, places)[:, None]
    turned = (Rotation.from_rotvec(share * turn) * before).as_matrix().reshape(-1, 9)
    q, inverse = legs_at(options, np.hstack([start[:3] + share * shift, turned]))
    if q.min() < limits[0] or q.max() > limits[1]:
        message = (
            f"legs must be {limits[0]:g} to {limits[1]:g} m long, the motion needs "
        )
        message += f"{q.min():.4g} to {q.max():.4g} m; choose other ends or legs"
        raise ConfigError(message, key="legs")
    radius = np.linalg.norm(options.platform, axis=1).max()
    least = np.linalg.svd(inverse, compute_uv=False)[:, -1].min()
    signs = np.sign(np.linalg.det(inverse))
    if least < LEAST_SINGULAR * max(1.0, radius / options.length) or np.ptp(signs):
        message = "the motion has a pose at which the legs do not hold the platform; choose a "
        message += (
            "smaller turn, or joints of base and platform that are not similar figures"
        )
        raise ConfigError(message, key="turn")
    way = np.concatenate([shift, options.length * turn])
    return PlatformMotion(q, np.broadcast_to(way / places, q.shape), inverse)


def equal_models(
    motion: PlatformMotion, noise: float, bound: float
) -> dict[str, MotionModel]:
    """Return the models by name, each with rms noise of the legs of ``noise`` times their rms step;
    ``bound`` is u over the greatest norm of J⁻¹. Raises ConfigError without such a Wishart model.
    """
    steps = np.matvec(motion.inverse, motion.v)
    trace = noise**2 * float(np.mean(np.vecdot(steps, steps)))
    models: dict[str, MotionModel] = {
        "additive": build_model(
            {
                "kind": "additive",
                "noise_covariance": (trace / LEGS * np.eye(LEGS)).tolist(),
            }
        ),
        "gaussian": GaussianModel(1.0, bound * frobenius(motion.inverse).max()),
    } | {name: WishartModel(0.1, Decomposition(name)) for name in DECOMPOSITIONS}
    try:
        place = (motion, motion.q, motion.v, trace)
        return {name: model.with_trace(*place) for name, model in models.items()}
    except ModelDomainError as error:
        message = (
            f"no Wishart model has rms noise of {noise:g} times the step; choose less"
        )
        raise ConfigError(message, key="noise") from error


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
    for m, stream in zip(agents, rng.spawn(len(agents)), strict=True):
        both = (cables.draw_systems(bounds, size, m, stream) for size in sizes)
        drawn, fresh = (systems.in_units_of(lever(bounds)) for systems in both)
        model, due = cables.matrix_model(fresh), cables.wrench_covariance(fresh)
        estimates = averaged_sigma_s(drawn)
        for part, block in PARTS.items():
            parametric, row = due[:, block, block], {"part": part, "agents": m}
            for error, (form, distance) in ERRORS.items():
                modelled = model.covariance(estimates[form].mean)[:, block, block]
                row[error] = distance(modelled, parametric).mean()
            rows.append(row)
    return pd.DataFrame(rows)


def slope_rows(errors: pd.DataFrame) -> pd.DataFrame:
    """Return the table ``towing_slopes``: slopes of log error over log m, Student's interval."""
    rows = []
    for part, rows_of_part in errors.groupby("part", sort=False):
        for error in ERRORS:
            means = np.log(
                rows_of_part.pivot(index="agents", columns="repeat", values=error)
            )
            slopes = np.polyfit(
                np.log(means.index.to_numpy(float)), means.to_numpy(), 1
            )[0]
            rows.append(
                (part, error, *paired_difference(slopes, np.zeros_like(slopes))[:3])
            )
    return pd.DataFrame(rows, columns=["part", "error", "slope", "low", "high"])


def facts(tables: Tables, options: SimpleNamespace) -> dict[str, object]:
    """Return the fields of the page."""
    motion, errors = tables["hexapod"], tables["towing"]
    ends = motion.groupby("model", sort=False)["rotation"].agg(["first", "last"])
    means = 100 * errors.groupby(["part", "agents"])[list(ERRORS)].mean()
    few, many = errors["agents"].agg(["min", "max"])
    cells = [
        [
            f"{row.error} of {row.part}, {ERRORS[row.error][0]} Σ_S",
            *(number(means.loc[(row.part, m), row.error]) for m in (few, many)),
            interval(row.slope, row.low, row.high),
        ]
        for row in tables["towing_slopes"].itertuples()
    ]
    return (ends["last"] / ends["first"]).to_dict() | {
        "least": motion["least_singular_value"].iloc[[0, -1]].tolist(),
        "few": few,
        "many": many,
        "repeats": errors["repeat"].nunique(),
        "cells": cells,
    }


def draw(hexapod: pd.DataFrame, towing: pd.DataFrame) -> Figure:
    """Draw the figure of the page."""
    blue, green, dashes = style.BLUE, style.GREEN, (0, (6, 1.5, 1, 1.5))
    lines = {
        "additive": style.MODELS["additive"] | {"label": "additive"},
        "gaussian": style.MODELS["gaussian"] | {"label": "Gaussian"},
        "qr_transposed": {
            "label": r"Wishart, QR of $J^{\mathsf{T}}$",
            "color": blue,
            "ls": "--",
        },
        "qr": {"label": "Wishart, QR of $J$", "color": green, "ls": dashes},
    }
    figure, ((rotation, wrench),) = style.panels(style.TWO_COLUMNS, 2.6, columns=2)
    for model, line in lines.items():
        rows = hexapod[hexapod["model"] == model]
        rotation.plot(rows["place"], 1e3 * rows["rotation"], **line)
    rotation.set(xlabel="share of the motion (1)", ylabel="std of the rotation (mrad)")
    rotation.set_ylim(0, None)
    means = 100 * towing.groupby(["part", "agents"])[list(ERRORS)].mean()
    for part, color in (("forces", blue), ("moments", style.VERMILLION)):
        for error, dashes in zip(ERRORS, ("-", "--"), strict=True):
            look = {
                "color": color,
                "marker": "o",
                "ms": 2.5,
                "label": f"{error} of {part}",
            }
            wrench.plot(means.loc[part, error], dashes, **look)
    wrench.set(
        xscale="log", yscale="log", xlabel="number of cables", ylabel="error (%)"
    )
    ticks = list(means.index.unique("agents"))
    wrench.set_xticks(ticks, [str(m) for m in ticks])
    wrench.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    wrench.minorticks_off()
    style.letters((rotation, wrench))
    rotation.legend()
    wrench.legend()
    return figure
