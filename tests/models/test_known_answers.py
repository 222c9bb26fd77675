"""Steps drawn from each model on an arm of seven joints and six task rows, and on three joints that
hold x and z alone, come back through every estimator; drawn from another they do not.

Drawn in plain NumPy, of the Wishart model by Algorithm 1: matrices by Bartlett's decomposition and
the pseudo-inverse of J₁BJ₂.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from oracles import algorithm_1_steps
from random_arm import motion, random_arm

from pipeline.arm.serial import SerialChain
from pipeline.models.additive.fit import Options as Additive
from pipeline.models.closed_loop import MeanPath, fit_closed_loop
from pipeline.models.gaussian.fit import Options as Gaussian
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.kinds import estimate, truths
from pipeline.models.noise import process_noise
from pipeline.models.scaled.fit import Options as Scaled
from pipeline.models.scaled.law import ScaledModel
from pipeline.models.steps import Recorded
from pipeline.models.wishart.decomposition import Decomposition
from pipeline.models.wishart.fit import Options as Wishart
from pipeline.models.wishart.law import WishartModel

TAKES, STEPS, REST = 40, 80, 20
every_arm = pytest.mark.parametrize(
    ("n", "m"), [pytest.param(7, 6, marks=pytest.mark.slow), (3, 2)]
)


@dataclass(frozen=True)
class Scene:
    """An arm, a motion of it, and noise of a tenth of the steps' size."""

    arm: SerialChain
    q: np.ndarray
    v: np.ndarray
    covariance: np.ndarray

    @property
    def measurement(self) -> np.ndarray:
        """A hundredth of it in the measured pose."""
        return 1e-2 * np.diag(np.diag(self.covariance))


def scene(n: int, m: int) -> Scene:
    arm = random_arm(n, m)
    q, v = motion(arm, STEPS, REST)
    step = np.sqrt(np.mean(np.diff(q[REST:], axis=0) ** 2))
    root = np.eye(n) + 0.5 * np.random.default_rng(1).standard_normal((n, n)) / np.sqrt(n)
    return Scene(arm, q, v, (0.1 * step) ** 2 * root @ root.T)


def draw(model, arm, q, v, rng) -> np.ndarray:
    """(N, n) one step after each of the poses ``q`` (N, n) under the command ``v``."""
    if isinstance(model, WishartModel):
        return algorithm_1_steps(arm, q, v, model.sigma_b, model.decomposition, rng)
    covariance = np.broadcast_to(model.covariance(arm, q, v), (*q.shape, q.shape[-1]))
    values, axes = np.linalg.eigh(covariance)
    white = np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(q.shape)
    return q + arm.nominal_step(q, v) + np.matvec(axes, white)


def recorded(scene: Scene, model, seed: int = 1) -> Recorded:
    """Takes of steps that begin at the poses of the motion, measured with noise."""
    rng, (arm, q) = np.random.default_rng(seed), (scene.arm, scene.q[:-1])
    drawn = [
        draw(model, arm, np.tile(pose, (TAKES, 1)), command, rng)
        for pose, command in zip(q, scene.v, strict=True)
    ]
    noise = np.swapaxes(drawn, 0, 1) - q - arm.nominal_step(q, scene.v)
    noise += rng.multivariate_normal(np.zeros(q.shape[1]), scene.measurement, noise.shape[:2])
    joints = tuple(f"joint_{j}" for j in range(q.shape[1]))
    return Recorded(arm, np.tile(q, (TAKES, 1, 1)), scene.v, noise, joints, scene.measurement)


def likelihood(name: str) -> Wishart:
    return Wishart("wishart", "", estimator="likelihood", decomposition=name)


def of_additive(estimator: str):
    """Greatest relative error of a variance along any axis, of which sampling alone takes 0.1; the
    paper's covariance holds the measurement's too.
    """

    def error(case: Scene, factor: float) -> float:
        data = recorded(case, ScaledModel(factor * case.covariance))
        fitted = estimate(data, Additive("additive", "", estimator=estimator)).model.floor
        known = case.covariance + (case.measurement if estimator == "paper" else 0.0)
        return np.abs(np.linalg.eigvals(np.linalg.solve(known, fitted)) - 1).max()

    return error, 0.15, 1.3


def of_wishart(name: str):
    """Relative error of σ̂_B by likelihood, of which sampling takes 2 % of the fewest rows."""

    def error(case: Scene, factor: float) -> float:
        data = recorded(case, WishartModel(0.25 * factor, Decomposition(name)))
        return abs(estimate(data, likelihood(name)).estimates["sigma_b"] / 0.25 - 1)

    return error, 0.04, 1.12


def of_gaussian(estimator: str):
    """Of α·sqrt(u² − ⟨‖J⁺‖²⟩): α and u themselves are hardly told apart."""

    def error(case: Scene, factor: float) -> float:
        options = Gaussian("gaussian", "", estimator=estimator, beta=0.5)
        (truth,) = truths(recorded(case, ScaledModel(case.covariance)), options, ())
        model = GaussianModel(factor * truth.values["alpha"], truth.parameters["u"])
        found = estimate(recorded(case, model), options).estimates["noise_level"]
        return abs(found / truth.values["noise_level"] - 1)

    return error, 0.04, 1.1


def of_scaled(structure: str):
    """Greatest error of the standard deviations at rest and of the shares of the step."""

    def error(case: Scene, factor: float) -> float:
        options = Scaled("scaled", "", structure=structure)
        (truth,) = truths(recorded(case, ScaledModel(case.covariance)), options, ())
        parts = (factor * np.array(truth.parameters[part]) for part in ("floor", "gain"))
        result = estimate(recorded(case, ScaledModel(*parts)), options).estimates
        return max(abs(result[name] / value - 1) for name, value in truth.values.items())

    return error, 0.15, 1.5


ESTIMATORS = {
    **{f"additive {each}": of_additive(each) for each in ("paper", "shrinkage")},
    **{f"wishart {each}": of_wishart(each) for each in ("qr_transposed", "pivoted_lu")},
    **{f"gaussian {each}": of_gaussian(each) for each in ("paper", "likelihood")},
    **{f"scaled {each}": of_scaled(each) for each in ("diagonal", "full")},
}


@every_arm
@pytest.mark.parametrize("name", ESTIMATORS)
def test_known_parameters_come_back_on_any_arm_and_others_do_not(n, m, name):
    """The control is a model whose noise is a factor away."""
    (error, band, factor), case = ESTIMATORS[name], scene(n, m)
    assert error(case, 1.0) < band < error(case, factor)


@every_arm
@pytest.mark.parametrize("kind", ["additive", pytest.param("wishart", marks=pytest.mark.slow)])
def test_the_share_of_the_closed_loop_comes_back(n, m, kind):
    """Band: 4.5 standard errors, which tell the share from one a third as large again."""
    case = scene(n, m)
    arm, path = case.arm, MeanPath(case.arm, case.q)
    model, options = {
        "additive": (ScaledModel(case.covariance), Additive("additive", "", estimator="shrinkage")),
        "wishart": (WishartModel(0.2, Decomposition("qr_transposed")), likelihood("qr_transposed")),
    }[kind]

    def fitted(share: float):
        rng = np.random.default_rng(3)
        q = np.tile(case.q[0], (TAKES, STEPS + 1, 1))
        for k in range(STEPS):
            v = path.v[k] * np.ones((TAKES, 1))
            v[:, :m] += share * arm.displacement(arm.pose(q[:, k]), arm.pose(case.q[k]))
            q[:, k + 1] = q[:, k] if k < REST else draw(model, arm, q[:, k], v, rng)
        q += rng.multivariate_normal(np.zeros(n), case.measurement / 2, q.shape[:2])
        noise, joints = process_noise(arm, q, path.v), tuple(f"joint_{j}" for j in range(n))
        data = Recorded(arm, q[:, :-1], path.v, noise, joints, case.measurement)
        return fit_closed_loop(data, options, estimate(data, options))

    fit = fitted(0.4)
    assert abs(fit.share - 0.4) < 4.5 * fit.standard_error < 0.13
    # control: another loop
    other = fitted(0.6)
    assert abs(other.share - 0.4) > 4.5 * other.standard_error
