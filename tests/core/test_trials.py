"""Trials in this process, in worker processes and on a Dask cluster of real processes: the same
bytes in the same order. A cluster that is lost, absent or unfit is named, with what to do about it.
"""

import json
import operator
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from distributed import Client, LocalCluster

from pipeline.core.compute import trials as module
from pipeline.core.compute.trials import run_trials
from pipeline.core.errors import ComputeError, ConfigError
from pipeline.core.options.analysis import Compute, Dask
from pipeline.core.rng import stream

ROOT = Path(__file__).parents[2]
WAIT = 60.0  # s, until a process counts as not starting
SERIAL = Compute(1)
TWO = Compute(2)
each_way = pytest.mark.parametrize(
    "compute",
    [SERIAL, TWO],
    ids=["serial", "processes"],
)
# trials, which workers import from this module


def computed(number: int) -> bytes:
    """Sums and functions whose last bits depend on the layout and the instruction set."""
    x = stream(7, "filter", number).standard_normal((300, 40))
    return np.exp(x).tobytes() + np.linalg.inv(x.T @ x).tobytes()


def pause(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def late(number: int) -> tuple[int, int]:
    return number, pause(0.05)


def give_up(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def time_out(number: int) -> None:
    raise TimeoutError("of the trial itself")


def begin(number: int, folder: Path) -> None:
    """Leave a file, and fail at the second trial."""
    (folder / str(number)).touch()
    if number == 1:
        raise ConfigError("refused", key="a")
    time.sleep(0.02)


def results(
    function: Callable,
    trials: Iterable,
    compute: Compute,
    label: str = "trials",
) -> list:
    return list(run_trials(function, trials, compute=compute, label=label))


@pytest.fixture
def at_once(monkeypatch):
    """Workers are started after the first trial, however short it was."""
    monkeypatch.setattr(module, "START", 0.0)


def test_results_and_their_order_do_not_depend_on_the_workers_and_a_log_sees_one_line(
    capsys,
):
    drawn = [
        generator.random()
        for generator in results(partial(stream, 7, "test"), range(6), SERIAL)
    ]
    assert drawn == [stream(7, "test", trial).random() for trial in range(6)]
    assert capsys.readouterr() == ("trials: 6 done\n", "")
    assert results(operator.neg, [], TWO) == []


@each_way
def test_a_trials_error_arrives_with_its_evidence_and_stops_the_rest(
    compute,
    tmp_path,
    at_once,
):
    with pytest.raises(ConfigError, match="refused") as raised:
        results(partial(begin, folder=tmp_path), range(400), compute)
    assert raised.value.evidence == {"key": "a"}

    begun = {file.name for file in tmp_path.iterdir()}
    assert begun == {"0", "1"} if compute is SERIAL else len(begun) < 300


@pytest.mark.slow
def test_trials_in_processes_see_and_give_what_they_do_in_this_one(at_once):
    numbers = results(computed, range(4), SERIAL)
    assert results(computed, range(4), TWO) == numbers and len({*numbers}) == 4


def test_a_worker_process_that_is_killed_is_named_as_the_reason(at_once):
    with pytest.raises(ComputeError, match=r"memory runs out.*filter: takes"):
        results(give_up, range(6), TWO, "filter: takes")


# a Dask cluster


@contextmanager
def process(*words: str, **variables: str) -> Iterator[subprocess.Popen]:
    """A Dask process in the project's folder, with these environment variables; killed in the end,
    as its children then end too.
    """
    dask = str(Path(sys.executable).parent / "dask")
    command = [dask, *words, "--host", "127.0.0.1", "--no-dashboard"]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}

    with subprocess.Popen(command, cwd=ROOT, env=variables, **silent) as started:
        try:
            yield started
        finally:
            started.kill()


@contextmanager
def scheduler(folder: Path) -> Iterator[tuple[subprocess.Popen, str]]:
    """A scheduler and its address."""
    file = folder / "scheduler.json"
    end = time.monotonic() + WAIT
    words = "scheduler", "--port", "0", "--scheduler-file", str(file)

    with process(*words, PATH=os.environ["PATH"]) as started:
        # the file is there before it is written to its end
        while not (file.exists() and file.read_text().endswith("}")):
            assert started.poll() is None, "the scheduler ends"
            assert time.monotonic() < end, "no scheduler starts"
            time.sleep(0.05)
        yield started, json.loads(file.read_text())["address"]


def on(address: str, timeout: float = WAIT) -> Compute:
    return Compute(dask=Dask(address, timeout))


def test_the_dashboard_shows_trials_by_name_and_an_error_stops_them(tmp_path):
    label = "filter wishart: takes"

    def tasks(dask_scheduler) -> set[str]:
        return {task.prefix.name for task in dask_scheduler.tasks.values()}

    # the worker is a thread of this process
    here = {
        "processes": False,
        "protocol": "tcp",
        "host": "127.0.0.1",
        "dashboard_address": None,
    }
    with LocalCluster(n_workers=1, threads_per_worker=1, **here) as cluster:
        compute = on(cluster.scheduler_address)
        numbers = iter(range(300))
        running = run_trials(operator.neg, numbers, compute=compute, label=label)
        first = next(running)
        with Client(compute.dask.address, set_as_default=False) as client:
            assert label in client.run_on_scheduler(tasks)
            assert [first, *running] == [-number for number in range(300)]
            assert not client.run_on_scheduler(tasks)
        numbers = iter(range(2000))
        with pytest.raises(ConfigError, match="refused") as raised:
            results(partial(begin, folder=tmp_path), numbers, compute)
    assert raised.value.evidence == {"key": "a"}
    assert next(numbers) < 100 and len([*tmp_path.iterdir()]) < 100


@pytest.mark.slow
def test_a_cluster_gives_the_bytes_of_this_process_and_a_killed_worker_costs_time_alone(
    tmp_path,
):
    # as pipeline/conf/compute/dask.yaml says, of a person who has set none of our variables
    words = "--nthreads 1 --nworkers 2 --preload pipeline.core.environment".split()
    path = {"PATH": os.environ["PATH"], "PYTHONPATH": "."}
    with (
        scheduler(tmp_path) as (_, address),
        process("worker", address, *words, **path),
    ):
        compute = on(address)
        assert results(computed, range(6), compute) == results(
            computed,
            range(6),
            SERIAL,
        )
        running = run_trials(late, range(150), compute=compute, label="trials")
        first = list(islice(running, 10))
        lost = first[-1][1]
        os.kill(lost, signal.SIGKILL)
        rest = list(running)
        assert [number for number, _ in first + rest] == list(range(150))
        assert lost not in {pid for _, pid in rest[-20:]}
        with pytest.raises(TimeoutError, match="of the trial itself"):
            results(time_out, [1], compute)
        words = r"4 workers ended.*memory runs out.*trials wishart: takes-0"
        with pytest.raises(ComputeError, match=words):
            results(give_up, [3], compute, "wishart: takes")


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_scheduler_that_is_lost_or_silent_is_named(tmp_path, end):
    with ExitStack() as stack:
        started, address = stack.enter_context(scheduler(tmp_path))
        words = "worker", address, "--nthreads", "1", "--no-nanny"
        stack.enter_context(process(*words, **os.environ | {"PYTHONPATH": "."}))
        with Client(address, timeout=WAIT, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=WAIT)
        running = run_trials(
            pause,
            [0.05] * 400,
            compute=on(address, 5.0),
            label="trials",
        )
        next(running)
        started.send_signal(end)
        before = time.monotonic()
        with pytest.raises(
            ComputeError,
            match=r"is lost; start it again|no scheduler or workers",
        ) as raised:
            list(running)
        assert raised.value.evidence["address"] == address
        # the trials alone would take 20 s; a killed one is missed at once
        assert time.monotonic() - before < 18


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere"])
def test_what_is_no_address_of_a_scheduler_is_refused(address):
    with pytest.raises(ComputeError, match="no Dask scheduler answers"):
        results(operator.neg, [1], on(address, 1.0))


def test_a_client_that_does_not_begin_is_refused(monkeypatch):
    def begin(*_: object, **__: object) -> None:
        raise AssertionError("of Dask, whose thread has not begun")

    monkeypatch.setattr(Client, "start", begin)
    with pytest.raises(ComputeError, match=r"answers within 1 s \(.*not begun"):
        results(operator.neg, [1], on("tcp://127.0.0.1:9", 1.0))


@pytest.mark.slow
def test_a_cluster_without_workers_or_with_one_of_other_bytes_is_refused_with_the_reason(
    tmp_path,
):
    with scheduler(tmp_path) as (_, address):
        with pytest.raises(ComputeError, match="no scheduler or workers for 1 s"):
            results(operator.neg, [1], on(address, 1.0))
        here, empty = ({"PYTHONPATH": place} for place in (".", str(tmp_path)))
        older = here | {"OPENBLAS_CORETYPE": "Prescott"}
        (
            tmp_path / "pipeline"
        ).mkdir()  # a package of this name without the project's modules
        (tmp_path / "pipeline/__init__.py").touch()
        for threads, variables, reason in (
            ("2", here, "threads is 2 there and 1 here"),
            ("1", older, "(CORETYPE|arithmetic) is .* there and"),
            ("1", empty, "cannot import what it needs: No module named 'pip"),
        ):
            words = "worker", address, "--nthreads", threads, "--no-nanny"
            with process(*words, **os.environ | variables):
                with pytest.raises(ComputeError, match=reason):
                    results(operator.neg, [1], on(address))
