"""What recorded directions add: Σ_S and Ψ_S of each system's own static Jacobian, against Σ_S from
bounds alone.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pandas as pd

from pipeline.statistics.scores import paired_difference
from pipeline.studies.wrench_moments.errors import Place
from pipeline.wrench.bounds import draw_systems
from pipeline.wrench.directions import sample_directions
from pipeline.wrench.kronecker import likelihood_fit, moment_fit
from pipeline.wrench.matrix import matrix_model
from pipeline.wrench.parametric import CableSystem, wrench_covariance
from pipeline.wrench.study import averaged_sigma_s, covariance_errors

BOUNDED = 1000  # systems that Σ_S from bounds alone is averaged over, as in the paper


def recorded_rows(
    place: Place, agents: int, systems: int, samples: int, rng: np.random.Generator
) -> pd.DataFrame:
    """Rows of the table ``recorded_psi``: means over ``systems`` systems of ``agents`` cables,
    ``samples`` recorded directions of each; the errors against those with Ψ_S = I are paired.
    """
    bounded = draw_systems(place.bounds, BOUNDED, agents, rng).in_units_of(place.length)
    sigma_s = averaged_sigma_s(bounded)["full"].mean
    drawn = draw_systems(place.bounds, systems, agents, rng).in_units_of(place.length)
    agreement, modelled, due = [], [], []
    for number in range(systems):
        system = one_of(drawn, number)
        directions = sample_directions(system.direction, system.concentration, samples, rng)
        jacobians = np.einsum("mnp,kmp->knm", system.maps(), directions)
        model, moments = matrix_model(system), moment_fit(jacobians)
        likelihood = likelihood_fit(jacobians)
        recorded = replace(model, jacobian=moments.mean)
        modelled.append(
            {
                "bounds": model.covariance(sigma_s),
                "identity": recorded.covariance(moments.sigma_s),
                "moments": replace(recorded, psi=moments.psi).covariance(moments.sigma_s),
                "likelihood": replace(recorded, psi=likelihood.psi).covariance(likelihood.sigma_s),
            }
        )
        due.append(wrench_covariance(system))
        agreement.append(np.corrcoef(np.diag(moments.psi), 1 / system.concentration)[0, 1])
    rows = []
    for part, block in place.parts():
        errors = {
            known: covariance_errors(
                np.array([each[known][block, block] for each in modelled]),
                np.array(due)[:, block, block],
            )
            for known in modelled[0]
        }
        for known, values in errors.items():
            against = paired_difference(values, errors["identity"])
            rows.append(
                {"agents": agents, "part": part, "known": known, "error": values.mean()}
                | {"difference": against.mean, "low": against.low, "high": against.high}
                | {"agreement": np.mean(agreement)}
            )
    return pd.DataFrame(rows)


def one_of(systems: CableSystem, number: int) -> CableSystem:
    """The system ``number`` of an array (s, m) of them."""
    values = {field.name: getattr(systems, field.name) for field in fields(systems)}
    return CableSystem(
        **{name: value if value is None else value[number] for name, value in values.items()}
    )
