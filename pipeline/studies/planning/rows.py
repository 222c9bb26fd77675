"""The study's tables of one arm in one physics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product

import numpy as np
import pandas as pd

from pipeline.core.errors import SingularJacobianError
from pipeline.models.model import MotionModel
from pipeline.statistics.resampling import TAILS, drawn_takes
from pipeline.studies.planning.bench import Rig
from pipeline.studies.planning.motions import MINIMUM
from pipeline.studies.planning.spread import (
    KINDS,
    PARTS,
    agreement,
    deviations,
    ends,
    least,
    predicted,
    products,
    summed_variance,
)

Sums = dict[tuple[str, str], dict[str, np.ndarray]]  # part and kind → motion → (1 + R,)


def realised(
    rig: Rig, motions: Mapping[str, np.ndarray], rng: np.random.Generator
) -> tuple[Sums, dict[str, np.ndarray]]:
    """Of every motion that the arm can perform the summed variance over all takes and then over
    each of R resamplings, the same for all motions; and (M,) tr Cov of the joints at each step.
    """
    everything = np.arange(rig.takes)
    chosen = [everything, *drawn_takes(rig.takes, rng)]
    sums: Sums = {key: {} for key in product(PARTS, KINDS)}
    course = {}
    for name, path in motions.items():
        try:
            beyond = deviations(rig.bench, path, rig.poses(path, "take"))
        except SingularJacobianError:
            continue
        course[name] = beyond["joints", "step"].var(axis=0, ddof=1).sum(axis=-1)
        for key, each in beyond.items():
            inner = products(each)
            sums[key][name] = np.array([summed_variance(inner, takes) for takes in chosen])
    return sums, course


def spread_rows(sums: Sums, motions: Iterable[str]) -> pd.DataFrame:
    """Table ``planning_spreads`` without arm and physics."""
    rows = []
    for (part, kind), by_motion in sums.items():
        names = [least(dict(zip(by_motion, each, strict=True))) for each in _replicates(by_motion)]
        for motion in motions:
            row = {"part": part, "kind": kind, "motion": motion}
            if (values := by_motion.get(motion)) is not None:
                row |= _with_ends("sum", values)
                row["least"] = names.count(motion) / len(names)
                if MINIMUM in by_motion:
                    row |= _with_ends("ratio", values / by_motion[MINIMUM])
            rows.append(row)
    columns = ["part", "kind", "motion", "least"]
    columns += [f"{name}{end}" for name in ("sum", "ratio") for end in ("", "_low", "_high")]
    return pd.DataFrame(rows, columns=columns)


def prediction_rows(
    rig: Rig, models: Mapping[str, MotionModel], motions: Mapping[str, np.ndarray]
) -> pd.DataFrame:
    """Table ``planning_predictions`` without arm and physics."""
    rows = []
    for model, path in product(models, motions):
        courses = predicted(rig.bench, models[model], motions[path])
        sums = dict.fromkeys(PARTS, np.nan)
        if courses is not None:
            sums = {part: each.sum() for part, each in courses.items()}
        rows.append({"model": model, "motion": path} | sums)
    return pd.DataFrame(rows)


def order_rows(sums: Sums, predictions: pd.DataFrame) -> pd.DataFrame:
    """Table ``planning_orders`` without arm and physics."""
    rows = []
    for (model, known), (part, kind) in product(
        predictions.groupby("model", sort=False), product(PARTS, KINDS)
    ):
        prediction = known.set_index("motion")[part].dropna().to_dict()
        by_motion = sums[part, kind]
        orders = np.argsort(np.stack(list(by_motion.values()), axis=-1), axis=-1).argsort(axis=-1)
        # of all resamplings there are few orders
        unlike, which = np.unique(orders, axis=0, return_inverse=True)
        taus = [agreement(prediction, dict(zip(by_motion, each, strict=True))) for each in unlike]
        rows.append({"model": model, "part": part, "kind": kind})
        rows[-1] |= _with_ends("tau", np.array(taus)[which.ravel()])
    return pd.DataFrame(rows)


def course_rows(
    rig: Rig,
    models: Mapping[str, MotionModel],
    motions: Mapping[str, np.ndarray],
    course: Mapping[str, np.ndarray],
) -> pd.DataFrame:
    """Table ``planning_courses`` without arm, of the joint whose angle differs most between the
    motions.
    """
    everything = np.stack(list(motions.values()))
    joint = int(np.ptp(everything, axis=0).max(axis=0).argmax())
    parts = []
    for name, path in motions.items():
        own = predicted(rig.bench, models[name], path) if name in models else None
        gap = np.full(len(path) - 1, np.nan)
        parts.append(
            pd.DataFrame(
                {
                    "motion": name,
                    "t": np.arange(len(path) - 1) / rig.bench.rate,
                    "joint": rig.bench.joints[joint],
                    "angle": path[:-1, joint],
                    "predicted": gap if own is None else np.sqrt(own["joints"]),
                    "realised": np.sqrt(course[name]) if name in course else gap,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def _replicates(by_motion: Mapping[str, np.ndarray]) -> np.ndarray:
    """(R, motions) the sums of each resampling."""
    return np.stack(list(by_motion.values()), axis=-1)[1:]


def _with_ends(name: str, values: np.ndarray) -> dict[str, float]:
    """The first of ``values`` (1 + R,) and the interval of the others."""
    low, high = ends(values[1:], TAILS)
    return {name: values[0], f"{name}_low": low, f"{name}_high": high}
