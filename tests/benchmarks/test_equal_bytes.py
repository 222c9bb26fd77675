"""What compares the bytes of results: a digest tells the last bit, the report every difference, and
what a processor lacks is skipped.
"""

from __future__ import annotations

import json

import equal_bytes
import numpy as np
from equal_bytes import CONTROL, SETTINGS, computed
from equal_bytes_section import section
from result_bytes import digest

V4 = [one.name for one in SETTINGS if one.level == "x86-64-v4"]


def test_a_digest_tells_the_last_bit():
    one = np.array([1.0, 2.0])
    assert digest([one]) == digest([one.copy()]) == digest([one[:1], one[1:]])
    assert digest([one]) != digest([np.nextafter(one, 3.0)])


def test_the_levels_are_those_of_other_processors_each_on_one_thread_and_on_two():
    assert [one.threads for one in SETTINGS] == [1, 2] * 3
    assert len({one.name for one in SETTINGS}) == len(SETTINGS) and len(V4) == 2


def test_the_report_shows_what_differs_and_what_is_skipped(tmp_path):
    names = [one.name for one in SETTINGS if one.name not in V4]
    hashes = {name: {"fit": "a", "filter": "b"} for name in [*names, CONTROL.name]}
    hashes[names[2]] = {"fit": "a", "filter": "c"}
    hashes[CONTROL.name]["fit"] = "d"
    measured = {"machine": "M", "skipped": V4, "hashes": hashes}
    (tmp_path / "equal_bytes.json").write_text(json.dumps(measured))
    text = section(tmp_path)
    assert f"| piece | {names[1]} | {names[2]} | {names[3]} | control |" in text
    assert text.splitlines()[-2:] == [
        "| fit | equal | equal | equal | other |",
        "| filter | equal | **other** | equal | equal |",
    ]
    assert f"lacks the instructions: {'; '.join(V4)}" in text


def test_a_setting_reaches_the_process_that_computes(tmp_path, monkeypatch):
    (tmp_path / "host").mkdir()
    script = tmp_path / "result_bytes.py"
    script.write_text(
        "import json, os, sys\n"
        "keys = ('NUMBA_NUM_THREADS', 'OPENBLAS_CORETYPE')\n"
        "said = {key: os.environ[key] for key in keys} | {'threads': sys.argv[2]}\n"
        "json.dump(said, open(sys.argv[1], 'w'))\n"
    )
    monkeypatch.setattr(equal_bytes, "HERE", tmp_path)
    said = computed(CONTROL, tmp_path)
    assert said == {"NUMBA_NUM_THREADS": "1", **CONTROL.environment, "threads": "1"}
