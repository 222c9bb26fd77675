"""The paper's σ̂_B over the two choices that the paper leaves open: α₂/α₁ of (BsampOpt), and ε of
B⁻¹ ⪰ εI.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pipeline.core.errors import SolverError
from pipeline.models.steps import Recorded
from pipeline.models.wishart.decomposition import chosen
from pipeline.models.wishart.dispersion import step_dispersions
from pipeline.models.wishart.options import Options


def sigma_b_over_choices(
    recorded: Recorded,
    options: Options,
    ratio: float,
    shares: Sequence[float],
    floors: Sequence[float],
) -> pd.DataFrame:
    """σ̂_B for every α₂/α₁ = share·``ratio`` at the floor of ``options``, and for every floor at
    α₂/α₁ = ``ratio`` (rad).

    Rows: which of the two was ``varied`` ("ratio" or "floor"), ``share`` and ``floor``;
    ``sigma_b``, the paper's mean over all steps, ``sigma_b_moving``, that over the steps with a
    command alone, as a step at rest counts as σ̂_Bk = 0; and ``bound``, the share of the steps with
    a command that the floor held back. The last three are gaps where a problem was not solved to
    optimality, as may be where the weights are many decades apart.
    """
    moving = np.any(recorded.v, axis=-1)
    decomposition = chosen(options, recorded.chain.task, recorded.joints)
    rows = []
    choices = [("ratio", share, options.floor) for share in shares] + [
        ("floor", 1.0, floor) for floor in floors
    ]
    for varied, share, floor in choices:
        weights = 1 / (1 + share * ratio), share * ratio / (1 + share * ratio)
        row = {"varied": varied, "share": share, "floor": floor}
        try:
            by_step, fits = step_dispersions(
                recorded.chain,
                recorded.q,
                recorded.v,
                recorded.noise,
                decomposition,
                weights,
                floor,
            )
        except SolverError:
            rows.append(row)
            continue
        bound = fits.bound.reshape(recorded.q.shape[:2])[:, moving].mean()
        rows.append(
            row
            | {"sigma_b": by_step.mean(), "sigma_b_moving": by_step[moving].mean(), "bound": bound}
        )
    return pd.DataFrame(
        rows, columns=["varied", "share", "floor", "sigma_b", "sigma_b_moving", "bound"]
    )
