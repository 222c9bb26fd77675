"""The dual: six legs of uncertain thrust and direction, and the wrench that they give the platform.

A leg pushes where a cable pulls: its thrust T acts along n, from base to platform, and is negative
where the leg pulls. The law of the wrench is the cables', and S̲ = J⁻ᵀ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.studies.hexapod.motion import Motion
from pipeline.studies.hexapod.options import Options
from pipeline.wrench.matrix import matrix_model
from pipeline.wrench.measured_force import rows_of
from pipeline.wrench.parametric import CableSystem, wrench_covariance
from pipeline.wrench.study import averaged_sigma_s, variance_errors


def legs_of(motion: Motion, options: Options) -> CableSystem:
    """The system of the legs at every pose of ``motion``, their thrusts in balance with the load;
    moments are in N, divided by the characteristic length.
    """
    robot, load = motion.robot, options.load
    wrench = np.array([*load.force, *np.divide(load.moment, robot.length)])
    thrust = np.matvec(
        np.linalg.inv(np.swapaxes(robot.inverse_at(motion.pose), -1, -2)), wrench
    )  # S̲T̲ holds the load
    return CableSystem(
        tension=thrust,
        direction=robot.legs(motion.pose)[1],
        tension_sd=np.full(thrust.shape, options.thrust_sd),
        concentration=np.full(thrust.shape, options.concentration),
        attachment=robot.arms(motion.pose),
    ).in_units_of(robot.length)


@dataclass(frozen=True)
class OneSigmaS:
    """The matrix model of the whole motion."""

    diagonal: np.ndarray  # (6,) of Σ_S, the mean of the optimal ones over the motion
    errors: np.ndarray  # (K,) ‖diag Cov − Var‖/‖Var‖ along the motion


def wrench_rows(system: CableSystem, places: np.ndarray) -> tuple[pd.DataFrame, OneSigmaS]:
    """The table ``hexapod_wrench``, a row for each place of ``places`` (K,) and row of the wrench,
    and the matrix model that is in it.
    """
    exact, sigma_s = wrench_covariance(system), averaged_sigma_s(system)["diagonal"].mean
    modelled = matrix_model(system).covariance(sigma_s)
    covariances = {"exact": exact, "matrix": modelled}
    rows = rows_of(system)
    table = {"place": np.repeat(places, len(rows)), "row": np.tile(rows, len(places))}
    for name, covariance in covariances.items():
        table[name] = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)).ravel()
    return pd.DataFrame(table), OneSigmaS(np.diag(sigma_s), variance_errors(modelled, exact))


def thrust_rows(system: CableSystem, places: np.ndarray) -> pd.DataFrame:
    """The table ``hexapod_thrust``: a row for each place of ``places`` (K,) and leg."""
    legs = system.tension.shape[-1]
    return pd.DataFrame(
        {
            "place": np.repeat(places, legs),
            "leg": np.tile(np.arange(1, legs + 1), len(places)),
            "thrust": system.tension.ravel(),
        }
    )
