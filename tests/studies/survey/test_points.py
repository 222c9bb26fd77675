"""Points are kept by all that decides them, found again by it alone, and the same whoever computes
them and in whatever order.
"""

from __future__ import annotations

import shutil
from dataclasses import replace

import pandas as pd
import pytest
from source_code import MODULES, covers, needed

from pipeline.core import contracts
from pipeline.core.options.analysis import Compute
from pipeline.studies.survey import points
from pipeline.studies.survey.conditions import (
    Factors,
    MotionCondition,
    WrenchCondition,
    motion_conditions,
)
from pipeline.studies.survey.points import SOURCES, Gathered, code_version, gather, keys_of

SERIAL = Compute(1)
CONDITIONS = [
    WrenchCondition(1, (2,)),
    WrenchCondition(2, (2,)),
    MotionCondition(1, "own", 20, Factors(sway_std=2.0)),
]


@pytest.fixture(scope="module")
def small(study):
    """A study of as little as can be decided."""
    wrench = replace(study.wrench, rig=replace(study.wrench.rig, duration=5.0))
    return replace(
        study, motion=replace(study.motion, training_takes=4, realizations=3), wrench=wrench
    )


def key_of(condition, study, code) -> str:
    """The name of one point alone."""
    (key,) = keys_of([condition], study, code)
    return key


def joined(gathered: Gathered) -> pd.DataFrame:
    return pd.concat(gathered.tables(), ignore_index=True)


@pytest.fixture(scope="module")
def whole(small, tmp_path_factory):
    """The folder and the table of a survey that nothing disturbed."""
    folder = tmp_path_factory.mktemp("points")
    return folder, joined(gather(CONDITIONS, small, folder, SERIAL))


@pytest.fixture
def kept(whole, tmp_path):
    """A copy of that folder."""
    return shutil.copytree(whole[0], tmp_path / "points")


def decided_alike(one, other) -> bool:
    return one.drop(columns="cpu_seconds").equals(other.drop(columns="cpu_seconds"))


def numbers(gathered) -> tuple[int, int, int]:
    return gathered.reused, gathered.computed, gathered.unreadable


def test_what_is_there_is_found_and_not_computed_again(whole, kept, small, monkeypatch):
    monkeypatch.setattr(points, "point", None)
    again = gather(CONDITIONS, small, kept, SERIAL)
    assert numbers(again) == (3, 0, 0) and joined(again).equals(whole[1])


@pytest.mark.slow
def test_an_interrupted_survey_goes_on_where_it_was_to_the_same_table(
    whole, small, tmp_path, monkeypatch
):
    original, written = points.point, []

    def interrupted(condition, study):
        if len(written) == 2:
            raise KeyboardInterrupt
        written.append(condition)
        return original(condition, study)

    monkeypatch.setattr(points, "point", interrupted)
    with pytest.raises(KeyboardInterrupt):
        gather(CONDITIONS, small, tmp_path, SERIAL)
    monkeypatch.setattr(points, "point", original)
    resumed = gather(CONDITIONS, small, tmp_path, SERIAL)
    assert numbers(resumed) == (2, 1, 0) and decided_alike(joined(resumed), whole[1])


@pytest.mark.slow
def test_the_order_of_the_conditions_changes_no_point(whole, small, tmp_path):
    backwards = joined(gather(CONDITIONS[::-1], small, tmp_path, SERIAL))
    for condition in CONDITIONS:
        key = key_of(condition, small, code_version())
        assert decided_alike(
            *(
                table[table["point"] == key].reset_index(drop=True)
                for table in (backwards, whole[1])
            )
        )


@pytest.mark.parametrize("damage", ["cut off", "another point's", "half written"])
def test_a_damaged_point_is_computed_anew_and_counted(whole, kept, small, damage):
    first, second = (
        kept / key[:2] / key / "survey.parquet"
        for key in (key_of(condition, small, code_version()) for condition in CONDITIONS[:2])
    )
    if damage == "cut off":
        first.write_bytes(first.read_bytes()[:-200])
    elif damage == "another point's":
        first.write_bytes(second.read_bytes())
    else:
        # as a killed process leaves it
        first.parent.rename(first.parent.with_name(f".{first.parent.name}.partial"))
    again = gather(CONDITIONS, small, kept, SERIAL)
    assert numbers(again) == ((2, 1, 0) if damage == "half written" else (2, 0, 1))
    assert decided_alike(joined(again), whole[1])


def test_another_configuration_is_another_point(small):
    condition, code = CONDITIONS[2], code_version()
    laboratory = small.motion.laboratory
    studies = [
        small,
        replace(small, motion=replace(small.motion, test_takes=5)),
        replace(small, motion=replace(small.motion, threshold=0.4)),
        replace(
            small,
            motion=replace(
                small.motion, laboratory=replace(laboratory, pose_noise=1.1 * laboratory.pose_noise)
            ),
        ),
        replace(small, claims=small.claims[1:]),
    ]
    conditions = [
        condition,
        replace(condition, seed=2),
        replace(condition, factors=Factors(sway_std=3.0)),
    ]
    keys = [key_of(condition, study, code) for study in studies] + [
        key_of(each, small, code) for each in conditions[1:]
    ]
    assert len({*keys, key_of(condition, small, "other code")}) == len(keys) + 1
    assert key_of(replace(condition), replace(small), code) == keys[0]
    # what decides the motion alone leaves the wrench its points
    assert key_of(CONDITIONS[0], studies[1], code) == key_of(CONDITIONS[0], small, code)


def test_what_conditions_have_in_common_is_hashed_once_however_many_they_are(small, monkeypatch):
    hashed, original = [], points._digest
    monkeypatch.setattr(points, "_digest", lambda values: hashed.append(1) or original(values))
    many = motion_conditions([*range(500)], ["own", "other"], [20, 30], {}, "factorial")
    assert len({*keys_of(many, small, "code")}) == 2000 and len(hashed) == 2


def test_other_code_is_another_version(tmp_path, monkeypatch):
    (tmp_path / "models").mkdir()
    (tmp_path / "models/model.py").write_text("x = 1\n")
    monkeypatch.setattr(points, "PACKAGE", tmp_path)
    before = code_version()
    (tmp_path / "models/__pycache__").mkdir()
    (tmp_path / "models/__pycache__/model.pyc").write_text("compiled")
    (tmp_path / "figures.py").write_text("what decides no point")
    assert code_version() == before
    (tmp_path / "models/model.py").write_text("x = 2\n")
    assert code_version() != before


def test_the_version_is_that_of_all_the_code_that_a_point_runs_on():
    # core is one entry, and what builds a package in passing decides nothing
    core = {name for name in MODULES if name.startswith("pipeline.core")}
    modules = needed("pipeline.studies.survey.points", core)
    files = {MODULES[name] for name in modules if MODULES[name].stat().st_size}
    names = {str(file.relative_to(points.PACKAGE)) for file in files} - {"__init__.py"}
    uncovered = [name for name in names if not any(covers(source, name) for source in SOURCES)]
    assert sorted(name for name in uncovered if not name.startswith("core/")) == []
    used = [source for source in SOURCES if any(covers(source, name) for name in names)]
    assert set(SOURCES) - set(used) <= {"core", "studies/survey/tables.yaml"}


def test_a_table_that_breaks_the_contract_is_not_kept(small, tmp_path, monkeypatch):
    original = points.point
    monkeypatch.setattr(
        points, "point", lambda condition, study: original(condition, study).assign(seed=-1)
    )
    with pytest.raises(contracts.ContractError, match="seed"):
        gather(CONDITIONS[:1], small, tmp_path, SERIAL)
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []
