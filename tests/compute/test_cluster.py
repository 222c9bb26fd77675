"""Trials on a Dask cluster: a real scheduler and worker processes, over loopback."""

from __future__ import annotations

import gc
import operator
import os
import pickle
import re
import shutil
import signal
import time
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from conftest import run
from distributed import Client
from distributed.utils import LoopRunner
from omegaconf import OmegaConf
from smoke import set_parameters

from pipeline.compute import trials as module
from pipeline.compute.cluster import cluster
from pipeline.compute.trials import run_trials
from pipeline.errors import ComputeError, RecordingError
from pipeline.instruments.delimited import read_text
from pipeline.schema_compute import Compute, Dask
from tests.compute.example_trials import articulated, filtered, give_up, late, layout, pause, time_out
from tests.compute.memory import peak

SERIAL = Compute(1)
STAGES = ("data/raw/youbot/dvc.yaml:record", "articulate", "filter@wishart")


@pytest.mark.parametrize("function", [partial(filtered, steps=np.full((30, 3), 1e-3)), partial(articulated, width=0.004)])
def test_the_bytes_are_those_of_this_process(function, running):
    tables = [list(run_trials(function, range(6), compute=compute, label="takes")) for compute in (SERIAL, running.compute())]
    # of the numbers: a pickle also tells apart arrays whose types are equal but not one object, as those of cached machine code may be
    of_this_process, of_the_cluster = [[table.to_numpy().tobytes() for table in of] for of in tables]
    assert len(set(of_this_process)) == 6
    assert of_the_cluster == of_this_process


def test_trials_and_results_are_laid_out_as_in_this_process(running):
    # what Dask sends without pickle may be read-only or lie in another order
    trials = [np.zeros((4, 6))[:, :-1], np.zeros((300, 300)).T, np.zeros((300, 300))[:, ::2]]
    found = []
    for compute in (SERIAL, running.compute()):
        results = list(run_trials(partial(layout, kept=[1, 2]), trials * 4, compute=compute, label="trials"))
        found.append([(kept, flags, str(result.flags)) for kept, flags, result in results])
    assert found[0] == found[1]
    assert len(set(found[0])) > 1


def tasks_of(address: str) -> set[str]:
    """The names by which the dashboard groups the tasks that the scheduler has now."""
    with Client(address, set_as_default=False) as client:
        return client.run_on_scheduler(lambda dask_scheduler: {task.prefix.name for task in dask_scheduler.tasks.values()})


def test_the_dashboard_shows_the_trials_by_their_name(running):
    results = run_trials(pause, [0.3] * 12, compute=running.compute(), label="filter wishart: takes")
    next(results)
    assert tasks_of(running.address) == {"filter wishart: takes", "filter wishart: takes, what they share"}
    assert len(list(results)) == 11
    assert tasks_of(running.address) == set()


def test_short_trials_go_out_in_blocks(running, monkeypatch):
    blocks = []

    def submit(client: Client, *arguments, **options):
        blocks.append(options["key"])
        return submitted(client, *arguments, **options)

    submitted = Client.submit
    monkeypatch.setattr(Client, "submit", submit)
    trials = (number for number in range(3000))
    assert list(run_trials(operator.neg, trials, compute=running.compute(), label="trials")) == [-number for number in range(3000)]
    assert len(blocks) == len(set(blocks)) < 300


def test_an_error_of_a_trial_arrives_with_its_evidence_and_stops_the_rest(running, tmp_path):
    taken = []

    def files() -> Iterator[Path]:
        (tmp_path / "good.txt").write_text("1\n")
        for number in range(2000):
            taken.append(number)
            yield tmp_path / ("absent.txt" if number == 5 else "good.txt")

    with pytest.raises(RecordingError, match="absent") as raised:
        list(run_trials(read_text, files(), compute=running.compute(), label="trials"))
    assert raised.value.evidence["file"] == tmp_path / "absent.txt"
    assert len(taken) < 100


def test_a_worker_killed_in_the_middle_costs_time_alone(running):
    results = run_trials(late, range(150), compute=running.compute(), label="trials")
    first = list(islice(results, 10))
    lost = first[-1][1]
    os.kill(lost, signal.SIGKILL)
    rest = list(results)
    assert [number for number, _ in first + rest] == list(range(150))
    assert lost not in {pid for _, pid in rest[-20:]}


@pytest.mark.slow
def test_memory_of_this_process_does_not_grow_with_the_number_of_trials(running, monkeypatch):
    monkeypatch.setattr(module, "AHEAD", 1)
    monkeypatch.setattr(module, "BLOCK", 0.0)

    def trials(number: int) -> Iterator[np.ndarray]:
        return run_trials(np.negative, (np.full(100_000, n) for n in range(number)), compute=running.compute(), label="trials")

    few, many = peak(trials(15)), peak(trials(60))
    assert many < 1.5 * few
    # who keeps the results has them all in memory
    assert peak(list(trials(60)) for _ in range(1)) > 2 * many


def test_a_lost_scheduler_is_named_at_once(start):
    started = start()
    results = run_trials(pause, [0.05] * 400, compute=started.compute(), label="trials")
    next(results)
    started.scheduler.kill()
    begin = time.monotonic()
    with pytest.raises(ComputeError, match="has been lost; start it anew") as raised:
        list(results)
    assert raised.value.evidence["address"] == started.address
    # the trials alone would take 20 s
    assert time.monotonic() - begin < 15


@pytest.mark.slow
def test_a_scheduler_that_no_longer_answers_is_named_after_the_timeout(start):
    started = start()
    results = run_trials(pause, [0.05] * 400, compute=started.compute(timeout=5.0), label="trials")
    next(results)
    started.scheduler.send_signal(signal.SIGSTOP)
    begin = time.monotonic()
    with pytest.raises(ComputeError, match="has been lost"):
        list(results)
    assert time.monotonic() - begin < 40


@pytest.mark.slow
def test_a_scheduler_that_no_longer_answers_when_a_result_is_there_is_named_too(start):
    started = start()
    with cluster(pickle.dumps(operator.neg), started.compute(timeout=3.0), "trials") as running:
        results = running.submit([pickle.dumps(1)])
        # the client knows now that it is done, and has not asked for it
        time.sleep(3)
        started.scheduler.send_signal(signal.SIGSTOP)
        with pytest.raises(ComputeError, match="has been lost"):
            results()


def test_a_trials_own_timeout_is_its_error(running):
    with pytest.raises(TimeoutError, match="of trial 0"):
        list(run_trials(time_out, [0], compute=running.compute(), label="trials"))


def test_a_scheduler_that_is_not_there_is_named_within_the_timeout():
    begin = time.monotonic()
    with pytest.raises(ComputeError, match=r"no Dask scheduler answers within 1 s.*tcp://127.0.0.1:9"):
        list(run_trials(operator.neg, [1], compute=Compute(dask=Dask("tcp://127.0.0.1:9", 1.0)), label="trials"))
    assert time.monotonic() - begin < 15


@pytest.mark.parametrize("address", ["nowhere", "127.0.0.1", "http://127.0.0.1:9", "tcp://127.0.0.1:port", ""])
def test_what_is_no_address_of_a_scheduler_is_refused(address):
    with pytest.raises(ComputeError, match="no Dask scheduler answers"):
        list(run_trials(operator.neg, [1], compute=Compute(dask=Dask(address, 1.0)), label="trials"))


def test_a_client_that_found_no_scheduler_is_garbage_whose_collection_waits_for_no_other():
    gc.collect()
    with pytest.raises(ComputeError):
        list(run_trials(operator.neg, [1], compute=Compute(dask=Dask("nowhere", 1.0)), label="trials"))
    # as another client holds it that is just being started
    with LoopRunner._lock:
        collecting = Thread(target=gc.collect, daemon=True)
        collecting.start()
        collecting.join(20)
        assert not collecting.is_alive()


def test_a_scheduler_without_workers_is_waited_for_and_then_named(idle):
    with pytest.raises(ComputeError, match="without workers for 1 s"):
        list(run_trials(operator.neg, [1], compute=idle.compute(timeout=1.0), label="trials"))


@pytest.mark.parametrize(
    ("threads", "variables", "reason"),
    [
        (2, {"PYTHONPATH": "."}, "threads is 2 there and 1 here"),
        (1, {"PYTHONPATH": ".", "OPENBLAS_CORETYPE": "Prescott"}, "OPENBLAS_CORETYPE is Prescott there and Haswell here"),
        (1, {}, "cannot import what it needs: No module named 'pipeline'"),
    ],
)
def test_a_worker_that_might_not_give_the_same_bytes_is_refused_with_the_reason(threads, variables, reason, idle):
    with idle.worker(threads, **variables), pytest.raises(ComputeError, match=reason):
        list(run_trials(operator.neg, [1], compute=idle.compute(), label="trials"))


@pytest.mark.slow
def test_trials_that_end_their_workers_are_named(running):
    with pytest.raises(ComputeError, match=r"ended 4 workers.*memory runs out.*trials wishart: takes-0"):
        list(run_trials(give_up, [1], compute=running.compute(), label="trials wishart: takes"))


@pytest.mark.slow
def test_stages_write_the_same_bytes_on_a_cluster_and_the_choice_of_it_invalidates_none(reproduced, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(reproduced, folder, symlinks=True)
    before = {stage: locked(folder, stage) for stage in STAGES}
    set_parameters(folder, compute="dask", overrides="{compute: {workers: 2}}")
    done = run("dvc", "repro", "score", "sensitivity", "faults", "wrench", cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.findall(r"Running stage '([^']+)'", done.stdout) == ["configure"]
    for stage in STAGES:
        done = run("dvc", "repro", "--force", "--single-item", stage, cwd=folder)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "2 worker(s) of tcp://127.0.0.1:" in done.stdout
    assert {stage: locked(folder, stage) for stage in STAGES} == before


def locked(folder: Path, stage: str) -> list[str]:
    """Hashes of what a stage wrote."""
    file, _, name = stage.rpartition(":")
    stages = OmegaConf.to_container(OmegaConf.load((folder / (file or "dvc.yaml")).with_name("dvc.lock")))["stages"]
    return [out["md5"] for out in stages[name]["outs"]]
