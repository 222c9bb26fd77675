"""A and B of the model whose noise grows with the joint speed, of greatest likelihood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.models.noise import mean_covariance
from pipeline.models.scaled.options import Options
from pipeline.models.steps import Estimate, Recorded, Truth


def estimate(recorded: Recorded, options: Options) -> Estimate:
    """A and B; raises ModelDomainError and SolverError as
    :func:`pipeline.models.scaled.likelihood.fit_scaled`.
    """
    # here, as it loads the compiler, which building a model does not need
    from pipeline.models.scaled.likelihood import fit_scaled

    steps = recorded.chain.nominal_step(recorded.q, recorded.v)
    fit = fit_scaled(recorded.noise, steps, recorded.measurement, options.structure)
    return _estimate(fit.floor, fit.gain, recorded.joints)


def truths(recorded: Recorded, options: Options, dispersions: Sequence[float]) -> list[Truth]:
    """Half of the recorded variance from speed and half at rest; ``dispersions`` do not matter."""
    covariance = mean_covariance(recorded.noise)
    square = np.mean(recorded.chain.nominal_step(recorded.q, recorded.v) ** 2, axis=(0, 1))
    kept = np.diag(np.diag(covariance)) if options.structure == "diagonal" else covariance
    gain = kept / np.sqrt(np.outer(square, square)) / 2
    known = _estimate(kept / 2, gain, recorded.joints)
    return [Truth(f"scaled {options.structure}", known.parameters, known.estimates)]


def _estimate(floor: np.ndarray, gain: np.ndarray, joints: tuple[str, ...]) -> Estimate:
    at_rest, shares = np.sqrt(np.diag(floor)), np.sqrt(np.diag(gain))
    values = {f"std_at_rest_{joint}_rad": std for joint, std in zip(joints, at_rest, strict=True)}
    values |= {
        f"std_share_of_the_step_{joint}": share for joint, share in zip(joints, shares, strict=True)
    }
    parameters = {"kind": "scaled", "floor": floor.tolist(), "gain": gain.tolist()}
    return Estimate(parameters, values, {})
