"""Evidence on the question of whether the pose matters beyond the joint speed."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.random import Generator

from pipeline.arm.interface import Chain
from pipeline.core.errors import ModelDomainError
from pipeline.models.joint_error.samples import JointRun
from pipeline.models.model import MotionModel, frobenius
from pipeline.statistics.pose_effect import NORM, pose_effect, windows_of

NUMBERS = dict.fromkeys(["exponent", "low", "high", "power"], float)
NUMBERS |= {"windows": int, "groups": int, "spread": float, "needed": float}


def pose_table(
    runs: Sequence[JointRun],
    chain: Chain,
    models: Mapping[str, MotionModel],
    generator: Callable[[str], Generator],
) -> pd.DataFrame:
    """Return the table ``pose_effect``: the exponent of ‖J⁺‖ and of each model's standard deviation
    in the size of the joints' noise, after the joint speed, with its interval over motions. Runs of
    one motion count as one. Steps at singular poses are left out. No row for too few windows. Each
    model has a random stream of ``generator`` of its own.
    """
    motions: dict[str, dict[str, list]] = {}
    for run in runs:
        q, dq = run.measured[:-1], np.diff(run.command, axis=0)
        regular = ~chain.singular(q)
        q, dq = q[regular], dq[regular]
        noise = np.diff(run.measured, axis=0)[regular] - dq
        shapes = {
            NORM: np.repeat(
                frobenius(chain.inverse_jacobian(q))[:, None], q.shape[1], 1
            )
        }
        v = np.matvec(chain.jacobian(q), dq)
        for name, model in models.items():
            try:
                covariance = model.covariance(chain, q, v)
            except ModelDomainError:  # no covariance at this dispersion
                continue
            shapes[name] = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        for name, x in shapes.items():
            motions.setdefault(name, {}).setdefault(run.motion, []).append(
                (noise, dq, x)
            )
    rows = []
    for name, by_motion in motions.items():
        whole = [
            tuple(map(np.concatenate, zip(*each, strict=True)))
            for each in by_motion.values()
        ]
        stream = generator(f"predict.pose.{name}")
        if (found := pose_effect(windows_of(whole), stream)) is not None:
            exponent, *others = found
            rows.append((name, *exponent[:3], *others))
    return pd.DataFrame(rows, columns=["quantity", *NUMBERS]).astype(
        NUMBERS
    )  # also without rows
