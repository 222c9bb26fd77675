"""Smoothness of the Gaussian matrix model's bounds: inverse Jacobian or Jacobian as random matrix.

The paper states the model for the Jacobian, and models its inverse in the experiment because that
gives smoother bounds (Secs. 3.1.2 and 4.1.2). Both forms are drawn here along the mean recorded
motion. At every step they have one total variance to first order, so their bounds differ in the
form only.
"""

from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd
from numpy import ndarray
from numpy.random import Generator

from pipeline.core.errors import SingularJacobianError
from pipeline.evidence.case import Takes
from pipeline.evidence.motion import Outcome
from pipeline.evidence.table import difference_row, evidence_row, evidence_table
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import frobenius
from pipeline.statistics.curves import root_mean_square
from pipeline.statistics.takes import paired_difference

REALIZATIONS = 100  # of which a bound is the standard deviation, as in the paper
REPEATS = 20  # pairs of bounds
# forms
INVERSE = "inverse"
JACOBIAN = "jacobian"
RIVAL = "{}_jacobian"  # name of the Jacobian form of a model


def smoothness_evidence(
    outcomes: Mapping[str, Outcome],
    takes: Takes,
    generator: Callable[[str], Generator],
) -> pd.DataFrame:
    """Return for each Gaussian matrix model the :func:`roughness` of the bounds of both forms, and
    inverse form minus Jacobian form with its interval over REPEATS pairs of bounds. No row
    for an arm whose Jacobian is not square, and without noise or through a singular pose.
    """
    training = takes.training
    q = training.q.mean(axis=0)
    v = training.v
    square = q.shape == v.shape
    rows = []
    for name, outcome in outcomes.items():
        if not (square and isinstance(outcome.model, GaussianModel)):
            continue
        try:
            covariance = outcome.model.covariance(training.chain, q, v)
        except SingularJacobianError:
            continue
        variances = covariance[:, 0, 0]
        noisy = variances > 0
        if np.count_nonzero(noisy) < 2:
            continue
        jacobians = training.chain.jacobian(q[noisy])
        stream = generator(f"smoothness.{name}")
        bounds = form_bounds(jacobians, v[noisy], variances[noisy], stream)
        rough = {}
        for form, of_form in bounds.items():
            rough[form] = np.array([roughness(bound) for bound in of_form])
        smoother = paired_difference(rough[INVERSE], rough[JACOBIAN])
        rival = RIVAL.format(name)
        for model, form in ((name, INVERSE), (rival, JACOBIAN)):
            rows.append(
                evidence_row("bound_roughness", rough[form].mean(), model=model),
            )
        rows.append(
            difference_row("bound_roughness", smoother, model=name, rival=rival),
        )
    return evidence_table(rows)


def form_bounds(
    jacobians: ndarray,
    v: ndarray,
    variances: ndarray,
    rng: Generator,
) -> dict[str, ndarray]:
    """Return by form REPEATS bounds (REPEATS, M, n) in rad, standard deviations of REALIZATIONS
    steps with the ``jacobians`` (M, n, n) and the task steps ``v`` (M, n).

    A step of the inverse form has independent joints with the ``variances`` (M,) in rad². A step of
    the Jacobian form is (J + N)⁻¹v, Eq. (GausMod): N has independent entries of the variance s for
    which the linear part of the step, −J⁻¹NJ⁻¹v, has the total variance s‖J⁻¹‖²‖J⁻¹v‖² = n times
    ``variances``.
    """
    inverses = np.linalg.inv(jacobians)
    nominal = np.matvec(inverses, v)
    n = v.shape[-1]
    linear = frobenius(inverses) ** 2 * np.vecdot(nominal, nominal)
    scale = np.sqrt(n * variances / linear)[:, None, None]
    std = np.sqrt(variances)[:, None]

    bounds = {INVERSE: [], JACOBIAN: []}
    for _ in range(REPEATS):
        steps = std * rng.standard_normal((REALIZATIONS, *v.shape))
        bounds[INVERSE].append(steps.std(axis=0, ddof=1))
        noise = scale * rng.standard_normal((REALIZATIONS, *jacobians.shape))
        steps = np.linalg.solve(jacobians + noise, v[..., None])[..., 0]
        bounds[JACOBIAN].append(steps.std(axis=0, ddof=1))
    return {form: np.stack(of_form) for form, of_form in bounds.items()}


def roughness(bound: ndarray) -> float:
    """Return the root mean square over steps and joints of the change of ln ``bound`` (M, n) from
    one step to the next.
    """
    return root_mean_square(np.diff(np.log(bound), axis=0))
