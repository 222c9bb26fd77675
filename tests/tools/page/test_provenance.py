"""What is stated of a run is what its files hold."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from hashlib import sha256

from pipeline.tools.page.provenance import (
    Costs,
    flat_options,
    locked_libraries,
    measured_costs,
    sha256_of,
)


@dataclass
class Inner:
    rate: float = 100.0


@dataclass
class Outer:
    inner: Inner = field(default_factory=Inner)
    parts: dict = field(default_factory=lambda: {"a": Inner(2.0), "none": None})
    names: list = field(default_factory=lambda: ["q1", "q2"])


def test_the_costs_are_those_of_the_stages_as_the_benchmarks_leave_them(tmp_path):
    file = tmp_path / "experiment.json"
    stage = {"stage": "fit additive", "cpu": 2.5, "elapsed": 1.5, "memory": 4}
    file.write_text(
        json.dumps({"machine": "two cores", "scale": "paper", "elapsed": 9, "stages": [stage]})
    )
    assert measured_costs(file) == Costs("two cores", "paper", [("fit additive", 1.5, 2.5)])


def test_libraries_are_read_with_markers_and_hashes_passed_over():
    text = (
        "numpy==2.4.0 \\\n    --hash=sha256:00\npandera[pandas]==1 \\\ncolorama==0.4.6 ; "
        "sys_platform == 'win32' \\\n    # via tqdm\n"
    )
    assert locked_libraries(text) == {"numpy": "2.4.0", "pandera": "1", "colorama": "0.4.6"}


def test_a_files_hash_is_that_of_its_bytes(tmp_path):
    (tmp_path / "lock").write_bytes(b"numpy==2.4.0\r\n")
    assert sha256_of(tmp_path / "lock") == sha256(b"numpy==2.4.0\r\n").hexdigest()


def test_options_are_named_by_their_way_from_the_section():
    assert flat_options(Outer(), "dataset") == {
        "dataset.inner.rate": 100.0,
        "dataset.parts.a.rate": 2.0,
        "dataset.parts.none": None,
        "dataset.names": ["q1", "q2"],
    }
    assert flat_options(2017, "seed") == {"seed": 2017}
    assert flat_options({"a": Inner()}, "models") == {"models.a.rate": 100.0}
