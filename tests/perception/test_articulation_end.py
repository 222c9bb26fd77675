"""The fitted end of the tool: its objective against plain NumPy, its search against SciPy's, and
what becomes of an arm that is not where it is commanded to be.
"""

from __future__ import annotations

import numpy as np
import pytest
from articulation_in_numpy import plain_halved
from compiled_calls import from_python
from rectangle_clouds import CHAIN, LENGTHS, cloud, limits, motion
from scipy.optimize import minimize

from pipeline.perception.articulation import ArticulationOptions, FittedSequence, fit_sequence
from pipeline.perception.articulation_objective import ENDS, STEP, Frame, at_fitted, frame_of

FITTED = ENDS["fitted"]
VALUE = from_python(at_fitted)
OPTIONS = ArticulationOptions(end_point="fitted")
GAMMAS = (OPTIONS.gamma1, OPTIONS.gamma2)


def problem(points: np.ndarray, q: np.ndarray) -> Frame:
    ee = CHAIN.points(q)[3]
    return frame_of(points.T, CHAIN.origin, ee, LENGTHS, OPTIONS.length_range, GAMMAS)


def fit(clouds: list[np.ndarray], commanded: np.ndarray) -> FittedSequence:
    ee = CHAIN.points(commanded)[:, 3]
    return fit_sequence(clouds, CHAIN.origin, ee, CHAIN, OPTIONS, commanded[0])


@pytest.fixture(scope="module")
def sequence() -> tuple[np.ndarray, list[np.ndarray]]:
    rng = np.random.default_rng(7)
    q = motion()
    return q, [cloud(pose, rng) for pose in q]


def test_the_objective_is_the_printed_one_with_an_asymmetry_for_each_half_of_the_tool(sequence):
    q, clouds = sequence
    rng = np.random.default_rng(1)
    for number in range(0, 97, 24):
        frame = problem(clouds[number], q[number])
        v = FITTED.variables(frame, CHAIN.points(q[number])[1:]) + rng.normal(scale=0.01, size=5)
        plain = plain_halved(v, clouds[number], CHAIN.origin, limits(), *GAMMAS)
        assert VALUE(frame, v) == pytest.approx(plain, rel=1e-10)


def test_variables_and_nodes_are_each_others_inverse_within_the_bounds_on_the_lengths():
    rng = np.random.default_rng(2)
    q = motion()[30]
    frame = problem(np.zeros((1, 2)), q)
    for v in rng.uniform(-STEP, STEP, size=(20, 5)):
        nodes = FITTED.nodes(frame, v)
        np.testing.assert_allclose(FITTED.variables(frame, nodes), v, atol=1e-9)
    far = FITTED.nodes(frame, np.array([0.3, -7.0, 0.1, 0.2, 0.3]))
    lengths = np.linalg.norm(np.diff(np.vstack([CHAIN.origin, far]), axis=0), axis=1)
    assert np.all((limits()[:, 0] <= lengths) & (lengths <= limits()[:, 1]))
    assert lengths[2] == pytest.approx(LENGTHS[2], rel=1e-12)


@pytest.mark.slow
def test_the_search_finds_what_scipys_finds_or_better(sequence):
    q, clouds = sequence
    ours, reference = [], []
    for number in range(0, 97, 16):
        away = q[number] + [0.05, -0.05, 0.05]
        ours.append(fit(clouds[number : number + 1], away[None]).objective[0])
        frame = problem(clouds[number], away)
        v = FITTED.variables(frame, CHAIN.points(away)[1:])
        for step, extent in FITTED.runs:
            solution = minimize(
                plain_halved,
                v,
                (clouds[number], CHAIN.origin, limits(), *GAMMAS),
                method="Nelder-Mead",
                options={
                    "initial_simplex": v + step * np.vstack([np.zeros(5), np.eye(5)]),
                    "xatol": extent,
                    "fatol": np.inf,
                },
            )
            v = solution.x
        reference.append(solution.fun)
    # ours has five starts in a first frame, SciPy's one
    assert np.all(np.array(ours) <= np.array(reference) + 2e-4)
    assert np.mean(ours) <= np.mean(reference)


@pytest.mark.slow
def test_points_on_the_lines_of_the_links_give_the_angles_wherever_the_end_is_commanded():
    rng = np.random.default_rng(3)
    commanded = motion()[:25]
    q = commanded + rng.normal(scale=0.02, size=commanded.shape)
    clouds = [cloud(pose, rng, width=0.0, noise=0.0) for pose in q]
    assert np.abs(fit(clouds, commanded).q - q).max() < 0.02
    # the control: with the commanded end the last segment must miss its points
    ee = CHAIN.points(commanded)[:, 3]
    missed = fit_sequence(clouds, CHAIN.origin, ee, CHAIN, ArticulationOptions(), commanded[0])
    assert np.abs(missed.q - q).max() > 0.06


def test_the_errors_are_of_the_size_that_is_stated_for_the_commanded_end(sequence):
    q, clouds = sequence
    fitted = fit(clouds, q)
    assert np.all(np.sqrt(((fitted.q - q) ** 2).mean(axis=0)) < [0.04, 0.06, 0.06])
    assert fitted.lost == fitted.gaps == 0
