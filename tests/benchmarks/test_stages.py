"""What a stage costs and how much of it is work: no stage is missed, and nothing is counted
twice.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from functools import partial
from types import SimpleNamespace

import pytest
import stages
import work
from project_copy import ROOT


def test_a_command_of_the_pipeline_leaves_its_cost_and_no_other_process_does(tmp_path):
    environment = os.environ | {
        "PYTHONPATH": str(stages.HERE / "probe"),
        "COST_OF_STAGES": str(tmp_path / "costs"),
    }
    for command in (["-c", "pass"], ["-m", "pipeline", "inspect", "--help"]):
        subprocess.run(
            [sys.executable, *command], cwd=ROOT, env=environment, check=True, capture_output=True
        )
    (cost,) = map(json.loads, (tmp_path / "costs").read_text().splitlines())
    assert cost["stage"] == "inspect --help"
    assert 0 < cost["cpu"] <= 2 * cost["elapsed"] + 1 and cost["memory"] > 5e6


@pytest.fixture
def busy(monkeypatch):
    """What takes a given processor time, by a clock of its own."""
    clock = [0.0]

    def take(seconds: float) -> None:
        clock[0] += seconds

    monkeypatch.setattr(work, "time", SimpleNamespace(process_time=lambda: clock[0]))
    return take


@pytest.fixture(autouse=True)
def nothing_spent():
    work.spent.clear()


def test_time_is_counted_once_where_counted_functions_call_each_other(busy):
    inner = work.counted(busy, "inner")
    work.counted(lambda: (busy(0.03), inner(0.03)), "outer")()
    inner(0.02)
    assert work.spent["outer"] == pytest.approx(0.06)
    assert work.spent["inner"] == pytest.approx(0.02)


def test_after_an_error_time_is_counted_on(busy):
    def fail():
        raise ArithmeticError

    with pytest.raises(ArithmeticError):
        work.counted(fail, "room")()
    work.counted(busy, "room")(0.02)
    assert work.spent["room"] == pytest.approx(0.02)


def test_what_a_counted_function_hands_back_to_be_called_is_counted(busy, monkeypatch):
    def follow(seconds: float) -> None:
        busy(seconds)

    follow.__module__ = "pipeline.room.follow"
    module = SimpleNamespace(follow=follow)
    monkeypatch.setitem(sys.modules, "pipeline.room.follow", module)
    handed = work.counted(lambda: partial(follow, 0.03), "outer")()
    handed()
    assert work.spent["room"] == pytest.approx(0.03)
    assert module.follow is handed.func


@pytest.mark.slow
def test_what_a_stage_calls_is_counted_under_its_room_and_can_still_be_pickled():
    # in a process of its own: the functions of the whole pipeline stay replaced
    script = """
import pickle, work
work.count_calls("filter")
from pipeline.stages import filter as stage
counted = [name for name, value in vars(stage).items() if hasattr(value, "__wrapped__")]
assert counted, "nothing of a room"
for name in counted:
    function = getattr(stage, name)
    assert function.__module__.split(".")[1] not in work.BETWEEN
    assert pickle.loads(pickle.dumps(function)) is function
assert not hasattr(stage.run, "__wrapped__")
"""
    environment = os.environ | {"PYTHONPATH": str(stages.HERE)}
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, env=environment, check=True)


def test_what_a_stage_calls_by_the_name_of_its_module_is_counted_too():
    script = """
import work
work.count_calls("score")
from pipeline.stages import score
assert hasattr(score.quality.quality_row, "__wrapped__")
assert not hasattr(score.contracts.write, "__wrapped__")
"""
    environment = os.environ | {"PYTHONPATH": str(stages.HERE)}
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, env=environment, check=True)


@pytest.mark.slow
def test_what_is_compiled_by_an_import_or_by_a_call_is_counted_until_it_is_cached(tmp_path):
    (tmp_path / "pipeline/core").mkdir(parents=True)
    for name in ("__init__", "core/__init__", "core/compiled", "core/machine_code"):
        shutil.copy(ROOT / f"pipeline/{name}.py", tmp_path / f"pipeline/{name}.py")
    stage = (
        "from pipeline.core.compiled import compiled\n@compiled({signature})\ndef "
        "doubled(x):\n    return 2 * x\n"
    )
    (tmp_path / "pipeline/__main__.py").write_text(
        "def main():\n    from pipeline.stage import doubled\n    return doubled(1.0) - 2.0\n"
    )
    for signature in ("", '"float64(float64)"'):
        (tmp_path / "pipeline/stage.py").write_text(stage.format(signature=signature))
        for cached in (False, True):
            subprocess.run(
                [sys.executable, stages.HERE / "first_use.py", tmp_path / "answer"],
                cwd=tmp_path,
                check=True,
                timeout=120,
            )
            assert (float((tmp_path / "answer").read_text()) == 0.0) == cached


def test_the_cost_of_a_stage_holds_that_of_its_workers(tmp_path):
    loop = """
import time

def busy(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
"""
    script = """
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pipeline.loop import busy

with ProcessPoolExecutor(2, mp_context=get_context("forkserver")) as pool:
    list(pool.map(busy, [0.4, 0.4]))
"""
    (tmp_path / "pipeline").mkdir()
    (tmp_path / "pipeline/loop.py").write_text(loop)
    (tmp_path / "pipeline/__main__.py").write_text(script)
    environment = os.environ | {
        "PYTHONPATH": str(stages.HERE / "probe"),
        "COST_OF_STAGES": str(tmp_path / "costs.jsonl"),
    }
    subprocess.run(
        [sys.executable, "-m", "pipeline"], cwd=tmp_path, env=environment, check=True, timeout=60
    )
    (cost,) = [json.loads(line) for line in (tmp_path / "costs.jsonl").read_text().splitlines()]
    assert cost["cpu"] > 0.8
