"""Random streams: the same for the same arguments, independent for any others."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations

import numpy as np

from pipeline.core.rng import stream


def test_equal_arguments_give_equal_numbers():
    assert np.array_equal(stream(7, "filter", 3).random(100), stream(7, "filter", 3).random(100))


def test_another_process_gives_the_same_numbers():
    # strings hash differently in every process; the streams must not
    said = subprocess.run(
        [
            sys.executable,
            "-c",
            "from pipeline.core.rng import stream; print(*stream(7, 'filter', "
            "3).random(5).tolist())",
        ],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert [float(number) for number in said.split()] == stream(7, "filter", 3).random(5).tolist()


def test_streams_that_differ_in_seed_stage_or_trial_are_uncorrelated():
    keys = [
        (7, "filter"),
        (8, "filter"),
        (7, "record"),
        (7, "filter", 0),
        (7, "filter", 1),
        (7, "filter", 0, 1),
        (7, "filter", 1, 0),
    ]
    count = 4000
    drawn = [stream(*key).standard_normal(count) for key in keys]
    assert all(abs(np.corrcoef(a, b)[0, 1]) < 4 / np.sqrt(count) for a, b in combinations(drawn, 2))
    # control: a stream is correlated with itself
    assert np.corrcoef(drawn[0], stream(*keys[0]).standard_normal(count))[0, 1] > 4 / np.sqrt(count)


def test_taking_more_from_one_trial_changes_no_other():
    first, second = stream(7, "filter", 0), stream(7, "filter", 1)
    first.random(1000)
    assert np.array_equal(second.random(10), stream(7, "filter", 1).random(10))
