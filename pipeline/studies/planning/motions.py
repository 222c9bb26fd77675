"""The motions of one task path that are held against each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.core.errors import ModelDomainError, SolverError
from pipeline.models import kinds
from pipeline.models.model import MotionModel
from pipeline.models.steps import Recorded
from pipeline.planning.cost import uncertainty
from pipeline.planning.motions import best_conditioned, least_uncertain, minimum_norm
from pipeline.planning.problem import Problem
from pipeline.studies.planning.bench import Bench

RECORDED, MINIMUM, BEST = "recorded", "minimum_norm", "best_conditioned"
FIXED = (RECORDED, MINIMUM, BEST)  # whatever the physics
GIVEN = "wishart_scaled"  # its J₁ makes the task's rows of one unit by the arm's own length


@dataclass(frozen=True)
class Terms:
    """On which motions are planned."""

    margin: float  # least singular value of J, as a share of the least on the recorded motion
    # what a rad² in the null space costs, as a share of what the model says of a rad² of the
    # recorded motion
    smoothness: float
    # what a rad² in the null space costs the best-conditioned motion, in ln w, w the
    # manipulability; without it that motion jumps where the arm rests
    conditioned: float


def problem_of(bench: Bench, terms: Terms, smoothness: float = 0.0) -> Problem:
    """The task path of the recorded motion, and the margin of ``terms``."""
    path = bench.recorded
    clearance = np.linalg.svd(bench.chain.jacobian(path), compute_uv=False)[:, -1].min()
    margin = terms.margin * float(clearance)
    return Problem(bench.chain, bench.chain.pose(path), bench.rate, margin, smoothness)


def fixed_motions(bench: Bench, terms: Terms) -> dict[str, np.ndarray]:
    """The motions (M+1, n) in rad that need no model, each from a first pose of its own but the
    minimum-norm one, which starts where the recorded one does.

    Raises InfeasibleError where there is none.
    """
    problem = problem_of(bench, terms)
    return {
        RECORDED: bench.recorded,
        MINIMUM: minimum_norm(problem, bench.recorded[0]).joints,
        BEST: best_conditioned(replace(problem, smoothness=terms.conditioned)).joints,
    }


def fitted(
    bench: Bench, recorded: Recorded, options: dict[str, object]
) -> tuple[dict[str, MotionModel], dict[str, str]]:
    """The models of ``options`` by name, their parameters of the ``recorded`` steps; and by name
    why a model has none.
    """
    lengths = bench.built.lengths
    length = float(lengths[lengths > 0].mean())
    units = np.diag([1.0 if row.startswith(("r", "phi")) else length for row in bench.chain.task])
    models, refused = {}, {}
    for name, each in options.items():
        own = replace(each, left=units.tolist()) if name == GIVEN else each
        try:
            models[name] = kinds.estimate(recorded, own).model
        except (ModelDomainError, SolverError) as error:
            refused[name] = f"no fit: {error.message}"
    return models, refused


def planned(bench: Bench, model: MotionModel, terms: Terms) -> np.ndarray:
    """(M+1, n) rad, the motion of least Σ tr Cov under the ``model`` from a first pose of its own.

    Raises InfeasibleError where there is none, ModelDomainError for a model without a covariance
    and for one that says the same of every step.
    """
    cost, problem = uncertainty(model, bench.chain, "trace"), problem_of(bench, terms)
    each = cost(bench.recorded[:-1], problem.steps)
    if np.ptp(each) == 0:
        raise ModelDomainError("it says the same of every step, and so of every motion")
    per_square = each.sum() / np.sum(np.diff(bench.recorded, axis=0) ** 2)
    weight = float(terms.smoothness * per_square)
    return least_uncertain(replace(problem, smoothness=weight), cost).joints
