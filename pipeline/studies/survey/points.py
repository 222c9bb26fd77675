"""The points of a survey: each is decided by itself and kept under the hash of all that decides it.

A point is a function of its condition, of what the study's conditions have in common and of the
code, and of nothing else: neither of the order, nor of where it is computed. Whoever computes a
point writes it, whole or not at all, so that an interrupted survey goes on where it was; on a
cluster the folder of the points has to be one that all workers share.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd

from pipeline.cases.verdict import decided
from pipeline.core import contracts
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ContractError
from pipeline.core.options.analysis import Compute
from pipeline.studies.survey.conditions import (
    FACTORS,
    Condition,
    MotionCondition,
    WrenchCondition,
)
from pipeline.studies.survey.motion import MotionStudy, motion_evidence
from pipeline.studies.survey.wrench import WrenchStudy, claims_for, wrench_evidence
from pipeline.verdicts.claims import Claim

PACKAGE, TABLES = Path(__file__).parents[2], Path(__file__).with_name("tables.yaml")
# what decides a point, below pipeline; a test compares it with what this module imports
SOURCES = (
    "arm",
    "core",
    "filtering",
    "laboratory",
    "models",
    "perception/depth_noise.py",
    "randommatrix",
    "recordings/commands.py",
    "recordings/tare.py",
    "statistics",
    "cases",
    *(
        f"studies/survey/{name}"
        for name in ("conditions.py", "motion.py", "options.py", "points.py", "robots.py")
    ),
    "studies/survey/tables.yaml",
    "studies/survey/wrench.py",
    "verdicts",
    "wrench",
)
SCALED = (*FACTORS, "kappa", "tension_std")
# files that the evidence of a condition is in; a claim whose evidence lies elsewhere is not asked
MOTION = (
    "metrics/fit_",
    "metrics/motion",
    "metrics/recordings",
    "metrics/filter",
    "tables/one_step_scores",
    "tables/filter_comparison",
    "tables/filter_against_none",
)
WRENCH = (
    "metrics/wrench",
    "tables/wrench_study",
    "tables/sigma_s",
    "tables/force_moments",
    "tables/force_test",
)


@dataclass(frozen=True)
class Study:
    """What all conditions have in common, and the claims that are decided in each."""

    motion: MotionStudy
    wrench: WrenchStudy
    claims: tuple[Claim, ...]


@dataclass(frozen=True)
class Gathered:
    """Where the points of a survey lie: how many were there, how many were computed, and how many
    were computed anew because they could not be read.
    """

    folder: Path
    keys: list[str]
    reused: int
    computed: int
    unreadable: int
    size: int  # bytes of all points

    def tables(self) -> Iterator[pd.DataFrame]:
        """The rows of the table ``survey``, one point after the other in the order of the
        conditions: all at once may be too many.
        """
        return (contracts.read("survey", _place(self.folder, key), TABLES) for key in self.keys)


def code_version() -> str:
    """A hash of the sources that decide a point."""
    files = [
        file
        for source in SOURCES
        for file in [PACKAGE / source, *(PACKAGE / source).rglob("*")]
        if file.is_file()
    ]
    sources = sorted(file for file in files if "__pycache__" not in file.parts)
    return _digest(
        {
            str(file.relative_to(PACKAGE)): hashlib.sha256(file.read_bytes()).hexdigest()
            for file in sources
        }
    )


def keys_of(conditions: Iterable[Condition], study: Study, code: str) -> list[str]:
    """The names of the conditions' points: each a hash of the condition, of what it is decided
    with, of the claims and of the ``code``.
    """
    claims = [asdict(claim) for claim in study.claims]
    # of a million conditions, what all have in common is hashed once
    common = {
        kind: _digest([asdict(shared), claims, code])
        for kind, shared in ((MotionCondition, study.motion), (WrenchCondition, study.wrench))
    }
    return [_hash(f"{condition} {common[type(condition)]}") for condition in conditions]


def _place(folder: Path, key: str) -> Path:
    """Where in ``folder`` the point of that name lies: no folder holds too many."""
    return folder / key[:2] / key


def _digest(values: object) -> str:
    return _hash(json.dumps(values, sort_keys=True, default=np.ndarray.tolist))


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def decidable(claims: Sequence[Claim], files: tuple[str, ...]) -> list[Claim]:
    """The claims all of whose evidence lies in ``files``."""
    return [
        claim
        for claim in claims
        if all(reference.file.startswith(files) for reference in claim.references())
    ]


def point(condition: Condition, study: Study) -> pd.DataFrame:
    """The rows of the table ``survey`` of one condition, and the processor time they took."""
    begin, arm = process_time(), study.motion.laboratory.arm
    if isinstance(condition, MotionCondition):
        evidence, claims = motion_evidence(condition, study.motion), study.claims
        rows = decided(decidable(claims, MOTION), evidence, arm)
        place = {
            "study": "motion",
            "trajectory": condition.trajectory,
            "particles": condition.particles,
            "agents": "",
        }
        factors = asdict(condition.factors)
    else:
        claims = claims_for(study.claims, condition.agents)
        evidence = wrench_evidence(condition, study.wrench)
        rows = decided(decidable(claims, WRENCH), evidence, arm)
        place = {
            "study": "wrench",
            "trajectory": "",
            "particles": 0,
            "agents": " ".join(map(str, condition.agents)),
        }
        factors = {"kappa": condition.kappa, "tension_std": condition.tension_std}
    place |= dict.fromkeys(SCALED, np.nan) | factors
    return rows.assign(seed=condition.seed, **place, cpu_seconds=process_time() - begin)


def gather(
    conditions: Sequence[Condition], study: Study, folder: Path, compute: Compute
) -> Gathered:
    """The points of ``conditions``: every one that ``folder`` has, and the others computed there
    first.
    """
    keys = keys_of(conditions, study, code_version())
    folder = folder.resolve()
    missing = [
        (condition, key)
        for condition, key in zip(conditions, keys, strict=True)
        if not _whole(_place(folder, key))
    ]
    broken = sum(_place(folder, key).exists() for _, key in missing)
    if missing:
        compute_one = partial(_compute, study=study, folder=folder)
        # each writes its own point; there is nothing to keep
        deque(
            run_trials(compute_one, missing, compute=compute, label="survey: conditions"), maxlen=0
        )
    size = sum(file.stat().st_size for key in keys for file in _place(folder, key).iterdir())
    reused, computed = len(conditions) - len(missing), len(missing) - broken
    return Gathered(folder, keys, reused, computed, broken, size)


def _compute(trial: tuple[Condition, str], study: Study, folder: Path) -> None:
    condition, key = trial
    with contracts.replacing(_place(folder, key)) as place:
        contracts.write(point(condition, study).assign(point=key), "survey", place, TABLES)


def _whole(place: Path) -> bool:
    """Whether there is a point at ``place`` that is whole and its own."""
    try:
        table = contracts.read("survey", place, TABLES)
    except ContractError:
        return False
    return bool((table["point"] == place.name).all())
