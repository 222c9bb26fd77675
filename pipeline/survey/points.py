"""The points of a survey, each decided by itself, kept by the hash of all that decides it, and found again by it.

A point is a function of its condition, of what the study's conditions have in common and of the code, and of nothing else: neither of the
order, nor of where it is computed. Whoever computes a point writes it, whole or not at all, so that an interrupted survey goes on where it
was; on a cluster the folder of the points has to be one that all workers share.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd

from pipeline import contracts, schema
from pipeline.audit.claims import Claim, decide, verdict_table
from pipeline.audit.evidence import Evidence
from pipeline.audit.sensitivity import FAILS, HOLDS, UNKNOWN
from pipeline.compute.trials import run_trials
from pipeline.errors import ContractError
from pipeline.survey.conditions import Condition, MotionCondition
from pipeline.survey.motion import MotionStudy, motion_evidence
from pipeline.survey.table import SCALED
from pipeline.survey.wrench import WrenchStudy, asked_of, wrench_evidence

PACKAGE = Path(__file__).parents[1]
# what decides a point, below pipeline; a test compares it with what this module imports
SOURCES = (
    *("__init__.py", "rng.py", "compiled.py", "arm", "filtering", "motion", "randommatrix", "statistics", "sensitivity", "wrench"),
    *(f"audit/{name}.py" for name in ("claims", "evidence", "rules", "sensitivity", "strict")),
    *(f"survey/{name}.py" for name in ("conditions", "laboratory", "motion", "options", "points", "table", "wrench")),
    *(f"twin/{name}.py" for name in ("dynamics", "force", "options", "trajectory")),
    "perception/depth_noise.py",
)
# files that the evidence of a condition is in; a claim whose evidence lies elsewhere is not asked
MOTION = ("metrics/fit_", "metrics/motion", "metrics/recordings", "metrics/filter", "tables/one_step_scores", "tables/filter_comparison")
WRENCH = ("metrics/wrench", "tables/wrench_study", "tables/sigma_s", "tables/force_moments", "tables/force_test")


@dataclass(frozen=True)
class Study:
    """What all conditions have in common, and the claims that are decided in each."""

    motion: MotionStudy
    wrench: WrenchStudy
    claims: tuple[Claim, ...]


@dataclass(frozen=True)
class Gathered:
    """Where the points of a survey lie, and how many were found, computed, and computed anew for they could not be read."""

    places: list[Path]
    found: int
    computed: int
    unreadable: int
    size: int  # bytes of all points

    def tables(self) -> Iterator[pd.DataFrame]:
        """The rows of the table ``survey``, one point after the other in the order of the conditions: all at once may be too many."""
        return (contracts.read("survey", place) for place in self.places)


def code_version() -> str:
    """A hash of the sources that decide a point."""
    files = [file for source in SOURCES for file in [PACKAGE / source, *(PACKAGE / source).rglob("*")] if file.is_file()]
    kept = sorted(file for file in files if "__pycache__" not in file.parts)
    return _digest({str(file.relative_to(PACKAGE)): hashlib.sha256(file.read_bytes()).hexdigest() for file in kept})


def key_of(condition: Condition, study: Study, code: str) -> str:
    """The name of the condition's point: a hash of the condition, of what it is decided with, of the claims and of the ``code``."""
    common = study.motion if isinstance(condition, MotionCondition) else study.wrench
    claims = [asdict(claim) for claim in study.claims]
    return _digest([type(condition).__name__, asdict(condition), asdict(common), claims, code])


def _digest(values: object) -> str:
    text = json.dumps(values, sort_keys=True, default=np.ndarray.tolist)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def decided(claims: Sequence[Claim], evidence: Evidence, files: tuple[str, ...]) -> pd.DataFrame:
    """A row for every case of the claims whose evidence lies in ``files``: value, interval, whether the rule holds, and the verdict.

    ``verdict`` is whether it holds in every case there is evidence on, whatever recordings that is, as in the table ``sensitivity``.
    """
    asked = [claim for claim in claims if all(of.file.startswith(files) for of in claim.references)]
    rows = verdict_table(decide(asked, evidence, "paper")).rename(columns={"id": "claim"})
    rows["holds"] = rows["holds"].map({True: HOLDS, False: FAILS}).fillna(UNKNOWN)
    worst = rows["holds"].map({FAILS: 0, HOLDS: 1, UNKNOWN: 2}).groupby(rows["claim"]).transform("min")
    rows["verdict"] = worst.map({0: FAILS, 1: HOLDS, 2: UNKNOWN})
    rows["about"] = rows["claim"].map({claim.id: claim.about for claim in asked})
    columns = ["claim", "about", "case", "value", "than", "low", "high", "holds", "verdict"]
    return rows[columns].astype(dict.fromkeys(["value", "than", "low", "high"], float))


def point(condition: Condition, study: Study) -> pd.DataFrame:
    """The rows of the table ``survey`` of one condition, and the processor time they took."""
    begin = process_time()
    if isinstance(condition, MotionCondition):
        rows = decided(study.claims, motion_evidence(condition, study.motion), MOTION)
        place = {"study": "motion", "trajectory": condition.trajectory, "particles": condition.particles, "agents": ""}
        factors = asdict(condition.factors)
    else:
        claims = asked_of(study.claims, condition.agents)
        rows = decided(claims, wrench_evidence(condition, study.wrench), WRENCH)
        place = {"study": "wrench", "trajectory": "", "particles": 0, "agents": " ".join(map(str, condition.agents))}
        factors = {"kappa": condition.kappa, "tension_std": condition.tension_std}
    place |= dict.fromkeys(SCALED, np.nan) | factors
    return rows.assign(seed=condition.seed, **place, cpu_seconds=process_time() - begin)


def gather(conditions: Sequence[Condition], study: Study, folder: Path, compute: schema.Compute) -> Gathered:
    """The points of ``conditions``: every one that ``folder`` has, and the others computed there first."""
    code = code_version()
    keys = [key_of(condition, study, code) for condition in conditions]
    places = [folder.resolve() / key[:2] / key for key in keys]
    missing = [(condition, place) for condition, place in zip(conditions, places, strict=True) if not _whole(place)]
    broken = sum(place.exists() for _, place in missing)
    if missing:
        # each writes its own point; there is nothing to keep
        deque(run_trials(partial(_compute, study=study), missing, compute=compute, label="survey: conditions"), maxlen=0)
    size = sum(file.stat().st_size for place in places for file in place.iterdir())
    return Gathered(places, len(conditions) - len(missing), len(missing) - broken, broken, size)


def _compute(trial: tuple[Condition, Path], study: Study) -> None:
    condition, place = trial
    with contracts.replacing(place) as folder:
        contracts.write(point(condition, study).assign(point=place.name), "survey", folder)


def _whole(place: Path) -> bool:
    """Whether there is a point at ``place`` that is whole and its own."""
    try:
        table = contracts.read("survey", place)
    except ContractError:
        return False
    return bool((table["point"] == place.name).all())
