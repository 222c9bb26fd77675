"""Evidence on the question of whether the pose matters beyond the joint speed."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy import ndarray
from numpy.random import Generator

from pipeline.arm.chain import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_error.samples import JointRun
from pipeline.models.model import MotionModel, frobenius
from pipeline.statistics.pose_effect import (
    ALL,
    DIFFERING,
    NORM,
    REPEATED,
    pose_effect,
    windows_of,
)

NUMBERS = dict.fromkeys(["exponent", "low", "high", "power"], float)
NUMBERS |= {"windows": int, "groups": int, "spread": float, "needed": float}


def pose_table(
    runs: Sequence[JointRun],
    chain: Chain,
    models: Mapping[str, MotionModel],
    generator: Callable[[str], Generator],
) -> pd.DataFrame:
    """Return the table ``pose_effect``: the exponent of ‖J⁺‖ and of each model's standard deviation
    in the size of the joints' noise, after the joint speed, with its interval over motions; for all
    noise, for the part that differs between repetitions of a motion and for the part that repeats
    (:func:`noise_parts`). Runs of one motion count as one. Steps at singular poses are left out. No
    row for too few windows. Each row has a random stream of ``generator`` of its own.
    """
    by_motion: dict[str, list[JointRun]] = {}
    for run in runs:
        by_motion.setdefault(run.motion, []).append(run)
    samples: dict[tuple[str, str], list[tuple[ndarray, ndarray, ndarray]]] = {}
    for repetitions in by_motion.values():
        earliest = min(repetitions, key=lambda run: run.lag.mean())
        first = RunSteps(earliest, chain, models)
        steps = [RunSteps(run, chain, models) for run in repetitions]
        late = [(run.lag - earliest.lag) * run.rate for run in repetitions]
        parts = noise_parts([of_run.noise for of_run in steps], late)
        for part, noises in parts.items():
            for name in first.shapes:
                selected = []
                for of_run, noise in zip(steps, noises, strict=False):
                    compared = of_run if part == ALL else first
                    selected.append(compared.samples(name, noise))
                joined = tuple(map(np.concatenate, zip(*selected, strict=True)))
                samples.setdefault((part, name), []).append(joined)
    rows = []
    for (part, name), motions in samples.items():
        suffix = "" if part == ALL else f".{part}"
        stream = generator(f"predict.pose.{name}{suffix}")
        effect = pose_effect(windows_of(motions), stream)
        if effect is not None:
            exponent, *others = effect
            rows.append((part, name, *exponent[:3], *others))
    table = pd.DataFrame(rows, columns=["noise", "quantity", *NUMBERS])
    return table.astype(NUMBERS)  # also without rows


class RunSteps:
    """Steps of one run: noise (M, n) in rad, and pose quantities (M, n) by name in ``shapes``."""

    def __init__(
        self,
        run: JointRun,
        chain: Chain,
        models: Mapping[str, MotionModel],
    ) -> None:
        q = run.measured[:-1]
        dq = np.diff(run.command, axis=0)
        self.regular = ~chain.singular(q)
        self.steps = dq
        self.noise = np.diff(run.measured, axis=0) - dq
        q = q[self.regular]
        dq = dq[self.regular]
        norms = frobenius(chain.inverse_jacobian(q))[:, None]
        self.shapes = {NORM: np.repeat(norms, q.shape[1], axis=1)}
        v = np.matvec(chain.jacobian(q), dq)
        for name, model in models.items():
            try:
                covariance = model.covariance(chain, q, v)
            except ModelDomainError:  # no covariance at this dispersion
                continue
            variances = np.diagonal(covariance, axis1=-2, axis2=-1)
            self.shapes[name] = np.sqrt(variances)

    def samples(self, name: str, noise: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """Return ``noise``, commanded steps and the pose quantity ``name`` at the first steps, as
        many as ``noise`` has, without singular poses.
        """
        regular = self.regular[: len(noise)]
        count = int(np.count_nonzero(regular))
        return (
            noise[regular],
            self.steps[: len(noise)][regular],
            self.shapes[name][:count],
        )


def noise_parts(
    noises: Sequence[ndarray],
    late: Sequence[ndarray],
) -> dict[str, list[ndarray]]:
    """Return by name all noise of the repetitions of a motion, each (M, n) in rad, and of two or
    more repetitions over their common steps the mean over the repetitions, which is a repeated
    tracking error, and the deviations from it with the variance of the noise of one repetition.
    Repetition i performs the motion ``late[i]`` (n,) samples later than the earliest one; without
    this shift a repeated error would differ.
    """
    parts = {ALL: list(noises)}
    if len(noises) < 2:
        return parts
    shifted = [_earlier(*pair) for pair in zip(noises, late, strict=True)]
    length = min(map(len, shifted))
    common = np.stack([noise[:length] for noise in shifted])
    mean = common.mean(axis=0)
    factor = np.sqrt(len(noises) / (len(noises) - 1))
    return parts | {DIFFERING: [*(factor * (common - mean))], REPEATED: [mean]}


def _earlier(noise: ndarray, late: ndarray) -> ndarray:
    """Return ``noise`` (M, n) of the steps ``late`` (n,) samples later, between two steps by linear
    interpolation, without the last steps.
    """
    count = len(noise)
    steps = np.arange(count)
    latest = np.ceil(np.max(late, initial=0.0))
    common = steps[: count - int(latest)]
    columns = []
    for samples, of_joint in zip(late, noise.T, strict=True):
        columns.append(np.interp(common + samples, steps, of_joint))
    return np.stack(columns, axis=1)
