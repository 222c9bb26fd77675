"""which_decomposition: which decomposition of the Jacobian the paper's printed numbers allow, over
random paths of its arm; the decompositions on an arm in space and at the recorded level.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from pipeline.arm.chain import PlanarChain
from pipeline.arm.interface import Chain
from pipeline.arm.model import arm_of, chain_of
from pipeline.cases.readings import read_claims
from pipeline.core import config, rng
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ModelDomainError
from pipeline.core.options.dataset import Robot
from pipeline.core.typed_yaml import read_yaml
from pipeline.core.validation import options, validated
from pipeline.models.steps import Recorded
from pipeline.models.wishart.law import StepSquares, dispersion_of_trace
from pipeline.recordings.steps import training_steps
from pipeline.studies.frame import Study, Tables
from pipeline.studies.which_decomposition import evidence as laws
from pipeline.studies.which_decomposition.evidence import Published, Widths
from pipeline.studies.which_decomposition.page import draw, facts
from pipeline.studies.which_decomposition.paths import KINDS, TimeLaw, draw_paths, with_tool

STEPS, RATE = 320, 100.0  # M and steps a second of the paper
RAMPED, FULL_SPEED = "ramps and rest", "constant full speed"
PAPER_ARM, SPACE_ARM = "youbot", "ur5"  # whatever dataset is analysed
GENERAL = (laws.PIVOTED, laws.QR, laws.QR_TRANSPOSED)  # readings for a task of any size

Range = tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]]
Factor = Annotated[float, Field(gt=1)]
Several = Annotated[int, Field(ge=2)]


@options()
class Options:
    """Path prior, tolerances and a motion of an arm in space; params.yaml describes each."""

    chunks: Annotated[int, Field(ge=1)]
    paths: Several
    full_speed_paths: Several
    tool: Range
    rest: Range
    ramp: Range
    peak: Range
    once: Range
    least_norm: float
    tolerances: Annotated[list[Factor], Field(min_length=1)]
    span: tuple[Factor, Factor]
    start: list[float]
    end: list[float]
    poses: Several
    turns: list[float]

    @property
    def laws(self) -> dict[str, tuple[TimeLaw, int]]:
        """Time laws, and the number of paths of each kind in a chunk."""
        still = (0.0, 0.0)
        full = TimeLaw(STEPS, RATE, still, still, (1.0, 1.0), self.once)
        ramped = TimeLaw(STEPS, RATE, self.rest, self.ramp, self.peak)
        return {RAMPED: (ramped, self.paths), FULL_SPEED: (full, self.full_speed_paths)}


def evaluate(settings: SimpleNamespace, options: Options) -> Tables:
    """Return the study's tables; ``level`` only if the measurement noise is known."""
    stated, chain = laws.published(read_claims()), arm_of(robot_of(PAPER_ARM)).chain
    trial = partial(
        widths_of_chunk, chain=chain, options=options, stated=stated, seed=settings.seed
    )
    label = "which_decomposition: paths"
    chunks = list(run_trials(trial, range(options.chunks), compute=settings.compute, label=label))
    drawn = {name: laws.joined([chunk[name] for chunk in chunks]) for name in options.laws}
    ramped = drawn[RAMPED]
    priors = {RAMPED: ramped}
    priors |= {f"{kind}s alone": ramped.subset(ramped.kind == kind) for kind in KINDS}
    near = ramped.norm > options.least_norm
    priors[f"greatest ‖J⁻¹‖ above {options.least_norm:g}"] = ramped.subset(near)
    priors[FULL_SPEED] = drawn[FULL_SPEED]
    likelihoods = [
        laws.evidence_rows(part, stated, options.tolerances, options.span).assign(prior=name)
        for name, part in priors.items()
    ]
    sizes = [laws.width_rows(part, stated).assign(prior=name) for name, part in drawn.items()]
    q = np.linspace(options.start, options.end, options.poses)
    tables = {
        "evidence": pd.concat(likelihoods, ignore_index=True),
        "widths": pd.concat(sizes, ignore_index=True),
        "unsquared": laws.unsquared_rows(ramped, stated, options.tolerances),
        "units": unit_rows(chain_of(robot_of(SPACE_ARM)), q, options.turns, stated.sigma_b),
    }
    try:
        recorded = training_steps(settings.dataset.robot, settings.dataset.motion)
        tables["level"] = level_rows(recorded)
    except ModelDomainError as reason:
        print(f"which_decomposition: no level of the recordings: {reason}")
    return tables


def widths_of_chunk(
    chunk: int, chain: PlanarChain, options: Options, stated: Published, seed: int
) -> dict[str, Widths]:
    """Return both models on the paths of one ``chunk`` of the arm ``chain``, by time law."""
    stream = rng.stream(seed, "which_decomposition", chunk)
    chain, parts = with_tool(chain, stream.uniform(*options.tool)), {}
    for name, (law, count) in options.laws.items():
        drawn = {kind: draw_paths(chain, law, kind, stated.u, count, stream) for kind in KINDS}
        parts[name] = laws.joined([laws.widths(chain, drawn[kind], stated, kind) for kind in KINDS])
    return parts


def unit_rows(chain: Chain, q: np.ndarray, turns: list[float], sigma_b: float) -> pd.DataFrame:
    """Return the table ``units`` of the poses ``q`` (K, n), equally far apart on a straight line in
    the joints, of an arm whose task is its whole pose: the decompositions in other units, and in
    axes turned about z by ``turns`` in degrees.

    Pivoted LU compares entries of different units and axes with each other. The QR of J depends on
    the units alone, the QR of Jᵀ on neither.
    """
    jacobian, pseudoinverse = chain.jacobian(q), chain.inverse_jacobian(q)
    cases = [("m", 0.0, np.eye(6)), ("mm", 0.0, np.diag([1000.0] * 3 + [1.0] * 3))]
    for degrees in turns:
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        cases.append(("m", degrees, np.kron(np.eye(2), turn)))
    rows = []
    for unit, degrees, change in cases:
        changed = np.moveaxis(change @ jacobian, 0, -1)
        inverse = np.moveaxis(pseudoinverse @ np.linalg.inv(change), 0, -1)
        v = np.einsum("ijk,j->ik", changed, q[1] - q[0])
        for reading in GENERAL:
            parts = laws.wishart_parts(reading, changed, inverse, v)
            variance = laws.wishart_variance(parts, len(v), sigma_b)
            rows.append((reading, unit, degrees, np.sqrt(variance.sum() / parts[1].sum())))
    return pd.DataFrame(rows, columns=["reading", "unit", "turn", "noise"])


def level_rows(recorded: Recorded) -> pd.DataFrame:
    """Return the table ``level``: σ_B by moments, at which the trace of the exact covariance of a
    step, averaged over steps and takes, plus that of the measurement noise is the recorded one. A
    reading without such a σ_B, as where a pivot vanishes on the motion, has gaps.

    Raises ModelDomainError where the motion never rests and the measurement noise is not stated.
    """
    chain, (takes, steps, n) = recorded.chain, recorded.q.shape
    m, q = len(chain.task), recorded.q.reshape(-1, n)
    v = np.broadcast_to(recorded.v[..., :m], (takes, steps, m)).reshape(-1, m).T.copy()
    jacobian, inverse = (
        np.moveaxis(of(q), 0, -1).copy() for of in (chain.jacobian, chain.inverse_jacobian)
    )
    variance = recorded.noise.var(axis=0, ddof=1).mean(axis=0) - np.diag(recorded.measurement)
    plain = tuple(laws.PLAIN) if m == n == 3 else ()
    levels = [("recorded", np.nan, variance)]
    for reading in (laws.PIVOTED, *plain, laws.QR, laws.QR_TRANSPOSED):
        parts = [part.mean(axis=-1) for part in laws.wishart_parts(reading, jacobian, inverse, v)]
        try:
            squares = StepSquares(*(part.sum() for part in parts))
            sigma_b = dispersion_of_trace(squares, variance.sum(), m)
        except ModelDomainError:
            sigma_b = np.nan
        levels.append((reading, sigma_b, laws.wishart_variance(parts, m, sigma_b)))
    rows = [
        (j, np.sqrt(max(one, 0.0)), reading, sigma_b)
        for reading, sigma_b, variances in levels
        for j, one in enumerate(variances, start=1)
    ]
    return pd.DataFrame(rows, columns=["joint", "std", "reading", "sigma_b"])


def robot_of(dataset: str) -> Robot:
    """Return the robot of ``pipeline/conf/dataset``."""
    file = config.CONF / f"dataset/{dataset}.yaml"
    return validated(Robot, read_yaml(file)["robot"], "robot", file)


run = Study(Options, evaluate, facts, draw).run
