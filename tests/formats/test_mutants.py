"""Ten thousand damaged files of all formats: none crashes or holds up its reader, or takes more
than 1 GiB, and what is read of them with other values and without a word is known by its kind.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from mutant_campaign import COUNT, TABLE, run
from mutants import BYTES, TEXT, mutants
from mutated_samples import SAMPLES, write_samples


@pytest.fixture(scope="module")
def samples(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    write_samples(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLES)
def test_no_damage_ends_a_reader_and_what_is_accepted_in_silence_is_known(samples, name):
    campaign = run(name, samples)
    assert campaign.failures == []
    known = pd.read_csv(TABLE, keep_default_na=False)
    known = known[known["format"] == name].reset_index(drop=True)
    pd.testing.assert_frame_equal(campaign.table(name), known, check_dtype=False)


def test_the_campaign_is_of_ten_thousand_mutants():
    assert COUNT * len(SAMPLES) >= 10**4
    assert COUNT >= 5 * len(BYTES | TEXT)


def test_mutants_are_the_same_each_time_and_most_are_another_file(samples):
    content = (samples / "points.csv").read_bytes()
    once, again = (list(mutants(content, 45, text=True)) for _ in range(2))
    assert once == again
    assert sum(mutant != content for _, mutant in once) > 35


def test_a_reader_that_takes_what_it_is_given_is_found_out(samples, monkeypatch):
    """The control: float and split take every word for a number that they can."""
    monkeypatch.setitem(SAMPLES, "credulous", SAMPLES["index of frames"].__class__("q.csv", _read))
    campaign = run("credulous", samples, 90)
    assert campaign.failures and "its reader fails on it (ValueError" in campaign.failures[0]
    assert "number as word" in {failure.partition(":")[0] for failure in campaign.failures}
    assert {"row lost", "number 1e9"} <= {*campaign.table("credulous")["change"]}


def _read(file: Path) -> dict[str, float]:
    rows = file.read_text().splitlines()
    return {"sum": sum(float(cell) for row in rows for cell in row.replace(",", " ").split())}
