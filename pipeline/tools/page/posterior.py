"""What a model says of the joints of a take: a filter's posterior, or one step ahead."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.core import contracts
from pipeline.core.columns import matrices, values
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded

FILTER, FIT = Path("data/filter"), Path("data/fit")


class Posterior(NamedTuple):
    """The ``mean`` (K, n) rad and ``covariance`` (K, n, n) rad² of the pose at K steps, and of a
    filter the effective number of particles ``ess`` (K,).
    """

    mean: np.ndarray
    covariance: np.ndarray
    ess: np.ndarray | None = None

    def at(self, steps: np.ndarray) -> Posterior:
        """Of these ``steps`` alone."""
        ess = None if self.ess is None else self.ess[steps]
        return Posterior(self.mean[steps], self.covariance[steps], ess)


def filtered_posterior(model: str, take: str, joints: Sequence[str]) -> Posterior:
    """What the filter of ``model`` says of the ``joints`` in ``take``."""
    table = contracts.read("posterior", FILTER / model)
    table = table[table["take"] == take]
    return Posterior(values(table, "m"), matrices(table, "c", joints), table["ess"].to_numpy())


def one_step_ahead(model: MotionModel, recorded: Recorded) -> Posterior:
    """What ``model`` says of each pose of the first take of ``recorded`` from the one before; of
    the first pose nothing is open. Raises ModelDomainError where it has no covariance.
    """
    q, v = recorded.q[0], recorded.v
    mean = np.concatenate([q[:1], model.mean(recorded.chain, q, v)])
    covariance = model.covariance(recorded.chain, q, v)
    return Posterior(mean, np.concatenate([np.zeros_like(covariance[:1]), covariance]))
