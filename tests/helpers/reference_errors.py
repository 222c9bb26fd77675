"""Four simple predictions of a joint's error, against which the joint error law is scored: constant
σ about the command, the last value, AR(2) with Student's t and σ(speed), least squares for the
horizon.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize

from pipeline.models.joint_error.law import (
    Outlook,
    standard_log_density,
    unit_variance_factor,
)
from pipeline.models.joint_error.samples import JointRun

Prediction = Callable[[JointRun, int], Outlook]  # of run and joint
NORMAL = np.array([np.inf])


def inputs(run: JointRun, j: int) -> np.ndarray:
    """(N, 4) constant, commanded speed, acceleration and sign of the speed."""
    speed = run.rate * np.diff(run.command[:, j], prepend=run.command[0, j])
    change = run.rate * np.diff(speed, prepend=speed[0])
    return np.stack(
        [np.ones_like(speed), speed, change, np.tanh(speed / 0.01)], axis=-1
    )


def references(runs: Sequence[JointRun], j: int, steps: int) -> dict[str, Prediction]:
    """The four predictions of joint ``j``, ``steps`` ahead, fitted to ``runs``."""

    def rows(run: JointRun, ahead: int) -> tuple[np.ndarray, ...]:
        e, x = (run.measured - run.command)[:, j], inputs(run, j)
        now, past = (
            e[: len(e) - ahead],
            np.concatenate([e[:1], e[:-1]])[: len(e) - ahead],
        )
        return (
            e[ahead:],
            now,
            np.column_stack([now, past, x[ahead:]]),
            np.abs(x[ahead:, 1]),
        )

    def all_rows(ahead: int) -> list[np.ndarray]:
        kept = [
            [part[run.moving[ahead:, j]] for part in rows(run, ahead)] for run in runs
        ]
        return [np.concatenate(each) for each in zip(*kept, strict=True)]

    def normal(mean: Callable, variance: float) -> Prediction:
        def predict(run: JointRun, ahead: int) -> Outlook:
            centre = mean(*rows(run, ahead)[1:3])[:, None]
            return Outlook(centre, np.full(centre.shape, variance), NORMAL)

        return predict

    e, now, x, _ = all_rows(steps)
    gain = np.linalg.lstsq(x, e, rcond=1e-10)[0]
    return {
        "constant": normal(lambda now, _: np.zeros_like(now), np.mean(e**2)),
        "last value": normal(lambda now, _: now, np.mean((e - now) ** 2)),
        "for the horizon": normal(lambda _, x: x @ gain, np.mean((e - x @ gain) ** 2)),
        "AR(2)": _autoregression(*all_rows(1), rows, j),
    }


def _autoregression(e, now, x, speed, rows: Callable, j: int) -> Prediction:
    gain = np.linalg.lstsq(x, e, rcond=1e-10)[0]
    off, size = e - x @ gain, np.std(e - x @ gain)

    def loss(theta: np.ndarray) -> float:
        degrees = np.array([4 + np.exp(min(theta[2], 4.0))])
        variance = np.exp(theta[0]) + np.exp(theta[1]) * speed
        scale = np.sqrt(variance * unit_variance_factor(degrees))
        return -np.mean(
            standard_log_density(off / size / scale, degrees) - np.log(scale)
        )

    a, b, nu = minimize(loss, np.array([-1.0, 0.0, 1.5]), method="Nelder-Mead").x

    def predict(run: JointRun, ahead: int) -> Outlook:
        target, now, x, _ = rows(run, ahead)
        exogenous = inputs(run, j)
        mean, before = now.copy(), x[:, 1].copy()
        noise = size**2 * (np.exp(a) + np.exp(b) * np.abs(exogenous[:, 1]))
        variance, impulse = np.zeros(len(target)), [1.0, gain[0]]
        for _ in range(ahead):
            impulse.append(gain[0] * impulse[-1] + gain[1] * impulse[-2])
        for i in range(1, ahead + 1):
            driven = exogenous[i : len(exogenous) - ahead + i] @ gain[2:]
            mean, before = gain[0] * mean + gain[1] * before + driven, mean
            variance += impulse[ahead - i] ** 2 * noise[i : len(noise) - ahead + i]
        return Outlook(
            mean[:, None], variance[:, None], np.array([4 + np.exp(min(nu, 4.0))])
        )

    return predict
