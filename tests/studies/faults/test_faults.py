"""Every fault, of any severity and wherever it strikes, is repaired and counted, refused by name,
or harmless: nothing else.
"""

from __future__ import annotations

import re
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pipeline.core.options.limits import Limits

from pipeline.core.typed_yaml import read_yaml
from pipeline.studies.faults.bench import Bench, Recovered, suffer
from pipeline.studies.faults.fault import REFUSED, REPAIRED, UNHARMED, UNNOTICED, Fault, in_file
from pipeline.studies.faults.registry import FAULTS, FILE, text_faults

# the synthetic dataset has no joint logs, so that the stage has no use for these
JOINT_LOG = {
    "instrument": "joint log",
    "files": "joints/*/actual.csv",
    "owed": {
        "truncated": {
            "expected": [REPAIRED, REFUSED, UNHARMED],
            "rule": "a last line that is short is left out, with the other logs' of its time",
            "counted": ["cut_rows", "rows_without_partner", "repetitions"],
        },
        "dropped rows": {
            "expected": [REFUSED],
            "rule": "times have to step at the rate, and be those of the other logs",
        },
        "doubled rows": {
            "expected": [REPAIRED],
            "rule": "the same line at the same time is left out",
            "counted": ["doubled_rows"],
        },
        "swapped rows": {"expected": [REFUSED], "rule": "times have to increase"},
    },
}
JOINT_LOGS = text_faults("joint log", JOINT_LOG, read_yaml(FILE)["text"])
ALL = FAULTS | {fault.name: fault for fault in JOINT_LOGS}

SECONDS, MEGABYTES = 5.0, 600  # that reading a recording of a few hundred kilobytes may take


@contextmanager
def bounded(seconds: float = SECONDS) -> Iterator[None]:
    """What takes longer, or more memory beyond what is in use, fails."""

    def overdue(*_: object) -> None:
        raise TimeoutError(f"longer than {seconds} s")

    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    limits, handler = resource.getrlimit(resource.RLIMIT_AS), signal.signal(signal.SIGALRM, overdue)
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEGABYTES * 2**20, limits[1]))
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
        resource.setrlimit(resource.RLIMIT_AS, limits)


def between(fault: Fault, share: float) -> float:
    """The severity at a share of the way from the mildest to the gravest level; whole where the
    levels are.
    """
    low, high = min(fault.levels), max(fault.levels)
    severity = low * (high / low) ** share if low > 0 else low + share * (high - low)
    return (
        float(round(severity))
        if all(float(level).is_integer() for level in fault.levels)
        else severity
    )


@pytest.mark.parametrize("name", ALL)
@settings(
    max_examples=4,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(share=st.floats(0, 1), seed=st.integers(0, 2**32 - 1))
def test_a_fault_is_repaired_and_counted_or_refused_with_its_place(benches, name, share, seed):
    fault = ALL[name]
    with bounded():
        outcome = suffer(
            benches[fault.instrument], fault, between(fault, share), np.random.default_rng(seed)
        )
    assert outcome.kind in fault.expected, (outcome.kind, outcome.said)
    if outcome.kind == REFUSED:
        assert {"file", "take"} & set(outcome.evidence), outcome.said
        assert "\n" not in outcome.said
        # where a file lies is evidence, so that messages are the same on every machine
        assert "/tmp" not in outcome.said


@pytest.mark.parametrize("name", ALL)
def test_a_fault_changes_the_files_and_is_the_same_for_the_same_draws(benches, name):
    fault = ALL[name]
    files = benches[fault.instrument].files
    before = dict(files)
    for level in fault.levels:
        faulty = fault.inflict(files, level, np.random.default_rng(7))
        assert faulty != files
        assert faulty == fault.inflict(files, level, np.random.default_rng(7))
    assert files == before


@pytest.mark.parametrize(
    "instrument", ["motion capture", "depth camera", "force transducer", "joint log"]
)
@settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_file_cut_at_any_byte_never_gives_a_number_that_was_not_there(benches, instrument, seed):
    bench, rng = benches[instrument], np.random.default_rng(seed)
    name = sorted(bench.files)[rng.integers(len(bench.files))]

    def cut(content: bytes, severity: float, rng: np.random.Generator) -> bytes:
        return content[: int(rng.integers(len(content)))]

    with bounded():
        outcome = suffer(
            bench, Fault("cut", instrument, in_file(name, cut), "", (1,), (), ""), 1, rng
        )
    if outcome.recovered is not None and instrument in ("motion capture", "joint log"):
        cut_values, clean = outcome.recovered.values, bench.clean.values
        # what is left of a log are its first rows, unchanged
        np.testing.assert_allclose(cut_values, clean[: len(cut_values)], rtol=0, atol=1e-9)


# the controls: what the outcomes above would miss


def invented(name: str, change) -> Fault:
    return Fault("invented", "", in_file(name, change), "", (1,), (), "", ("skipped_frames",))


def test_a_number_changed_in_silence_is_unnoticed_and_an_equal_one_unharmed(benches):
    bench, rng = benches["motion capture"], np.random.default_rng(0)
    row = bench.files["optitrack/test_001.csv"].splitlines()[60]
    other = row[:-2] + (b"9" if row[-2:-1] < b"5" else b"1") + row[-1:]
    fault = invented("*.csv", lambda content, *_: content.replace(row, other))
    assert suffer(bench, fault, 1, rng).kind == UNNOTICED
    fault = invented("*.csv", lambda content, *_: content.replace(b"\r\n", b"\n"))
    assert suffer(bench, fault, 1, rng).kind == UNHARMED


def test_what_a_library_raises_is_no_refusal(benches):
    def broken(folder: Path) -> Recovered:
        raise ValueError("from inside a library")

    bench = Bench(
        benches["force transducer"].files,
        broken,
        benches["force transducer"].clean,
        np.zeros(1),
        np.zeros((1, 4)),
    )
    with pytest.raises(ValueError, match="library"):
        suffer(bench, FAULTS["log: doubled rows"], 1, np.random.default_rng(0))


def test_bounds_on_time_and_memory_are_felt():
    with pytest.raises(MemoryError), bounded():
        np.ones(2**28)
    with pytest.raises(TimeoutError), bounded(0.1):
        while True:
            pass


# what repairs are worth


@pytest.mark.parametrize(
    ("name", "severity", "times"),
    [
        ("take: labels swapped on a link", 60, 1.05),
        ("take: labels swapped between links", 60, 1.05),
        ("take: label lost", 60, 1.05),
        ("take: doubled rows", 10, 1.0001),
        ("take: tracker frozen", 10, 6.0),
        ("frames: camera frozen", 5, 1.5),
        ("index: dropped rows", 5, 1.5),
        ("frames: clock offset", 0.1, 1.5),
    ],
)
def test_joint_angles_of_a_repaired_recording_are_as_good_as_of_a_clean_one(
    benches, name, severity, times
):
    fault = ALL[name]
    bench = benches[fault.instrument]
    for seed in range(3):
        outcome = suffer(bench, fault, severity, np.random.default_rng(seed))
        assert outcome.kind == REPAIRED
        assert bench.error(outcome.recovered) <= times * bench.error(bench.clean)


def test_the_limits_that_rules_speak_of_are_those_of_a_dataset():
    named = {
        name
        for fault in FAULTS.values()
        for name in re.findall(r"(?:dataset\.limits| or )\.(\w+)", fault.rule)
    }
    assert {"longest_gap", "missing_share", "clock_drift"} <= named <= set(vars(Limits()))
