"""One-step predictions of a motion model, scored by the poses that were measured, the measurement noise added to the model's step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.arm.chain import PlanarChain
from pipeline.errors import ModelDomainError
from pipeline.motion.gaussian import frobenius
from pipeline.motion.model import MotionModel
from pipeline.statistics.scores import energy_score, log_determinant, nees

ENSEMBLE = 50  # draws per step for the energy score, whose estimate is unbiased for any number


def score_steps(
    model: MotionModel, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray,
    rng: np.random.Generator,
) -> tuple[dict[str, np.ndarray], dict[str, str]]:  # fmt: skip
    """Scores (..., M) by name of the steps from ``q`` to ``q_next`` (..., M, 3), measured poses in rad; why the missing ones are missing.

    ``v`` (M, 3) are the commanded steps (m, m, rad), ``measurement`` Σ_m (3, 3) in rad². The scores: whether the step was ``moving``;
    ``log_density`` in ln rad⁻³ with Σ_m, and ``log_density_noiseless`` without, a gap at rest; the ``energy`` score in rad; the error
    ``z1``…``z3`` in standard deviations of the prediction, its ``nees``, and the ``log_determinant`` of the covariance in ln rad⁶, all
    three a gap where the model has no covariance; ``inverse_norm`` ‖J(q)⁻¹‖_F. Raises SingularJacobianError.
    """
    v = np.broadcast_to(v, q.shape)
    moving = np.any(v, axis=-1)
    reasons: dict[str, str] = {}
    scores = {
        "moving": moving,
        "log_density": _existing(lambda: model.log_density(chain, q, v, q_next, measurement), q.shape[:-1], "log density", reasons),
        "log_density_noiseless": np.full(q.shape[:-1], np.nan),
        "energy": _energy(model, chain, q, v, q_next, measurement, rng),
    }
    scores["log_density_noiseless"][moving] = _existing(
        lambda: model.log_density(chain, q[moving], v[moving], q_next[moving]),
        moving.sum(), "log density without measurement noise", reasons,
    )  # fmt: skip
    calibration = _existing(
        lambda: _calibration(model, chain, q, v, q_next, measurement), (5, *q.shape[:-1]), "mean and covariance", reasons
    )
    scores |= dict(zip(("z1", "z2", "z3", "nees", "log_determinant"), calibration, strict=True))
    return scores | {"inverse_norm": frobenius(chain.inverse_jacobian(q))}, reasons


def _existing(values: Callable[[], np.ndarray], shape: object, what: str, reasons: dict[str, str]) -> np.ndarray:
    """``values``, or a gap of ``shape`` where the model has none; then the reason is kept under ``what``."""
    try:
        return values()
    except ModelDomainError as error:
        reasons[what] = str(error)
        return np.full(shape, np.nan)


def _energy(
    model: MotionModel, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    shape = (ENSEMBLE, *q.shape)
    drawn, _ = model.sample(chain, np.broadcast_to(q, shape), np.broadcast_to(v, shape), rng)
    return energy_score(drawn + rng.multivariate_normal(np.zeros(3), measurement, shape[:-1]), q_next)


def _calibration(
    model: MotionModel, chain: PlanarChain, q: np.ndarray, v: np.ndarray, q_next: np.ndarray, measurement: np.ndarray
) -> np.ndarray:
    """(5, ...) the error in standard deviations of each joint, its NEES, and the log determinant of the covariance."""
    error, covariance = q_next - model.mean(chain, q, v), model.covariance(chain, q, v) + measurement
    scaled = error / np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return np.stack([*np.moveaxis(scaled, -1, 0), nees(error, covariance), log_determinant(covariance)])
