"""The parameters that the paper publishes for its three models, from reports/claims.yaml."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.core.errors import ConfigError
from pipeline.verdicts.claims import Claim


@dataclass(frozen=True)
class Published:
    """Sec. 4.1.2, results of the parameter estimations."""

    sigma_b: float  # σ̂_B of the Wishart model
    alpha: float  # α̂ of the Gaussian model
    u: float  # û, the bound on ‖J⁻¹‖_F
    covariance: np.ndarray  # (n, n) Σ̂_ω of the additive model, rad²

    @property
    def spread(self) -> np.ndarray:
        """(n,) recorded standard deviation of a step in rad, the root of the mean variance over all
        steps.
        """
        return np.sqrt(np.diag(self.covariance))


def published(claims: Sequence[Claim]) -> Published:
    """The published values of ``claims``; raises ConfigError where one of them is not stated."""
    stated = {claim.id: claim for claim in claims}
    if absent := {"sigma-b", "alpha", "u", "sigma-omega"} - set(stated):
        raise ConfigError("no claim with a published value", claim=", ".join(sorted(absent)))
    covariance = stated["sigma-omega"]
    entries = [tuple(int(digit) - 1 for digit in case["entry"]) for case in covariance.cases()]
    matrix = np.full((1 + max(i for entry in entries for i in entry),) * 2, np.nan)
    for (i, j), value in zip(entries, covariance.published, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return Published(
        stated["sigma-b"].published, stated["alpha"].published, stated["u"].published, matrix
    )
