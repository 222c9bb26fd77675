"""What compares the bytes of results: a digest tells the last bit, the report every difference, and
what a processor lacks is taken from the emulator alone.
"""

from __future__ import annotations

import json

import equal_bytes
import numpy as np
from equal_bytes import CONTROL, NEEDED, SETTINGS, computed, lacking
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


def written(folder, skipped):
    """The report where the third setting differs in a piece, with ``skipped`` emulated."""
    names = [one.name for one in SETTINGS]
    hashes = {name: {"fit": "a", "filter": "b"} for name in [*names, CONTROL.name]}
    hashes[names[2]] = {"fit": "a", "filter": "c"}
    hashes[CONTROL.name]["fit"] = "d"
    emulated = {name: hashes.pop(name) for name in skipped}
    measured = {"machine": "M", "skipped": skipped, "hashes": hashes}
    (folder / "equal_bytes.json").write_text(json.dumps(measured))
    (folder / "emulated.json").write_text(json.dumps({"machine": "E", "hashes": emulated}))
    return section(folder)


def test_the_report_shows_what_differs_and_what_ran_elsewhere(tmp_path):
    text = written(tmp_path, V4)
    assert text.splitlines()[-2:] == [
        "| fit | equal | equal | equal | equal | equal | other |",
        "| filter | equal | **other** | equal | equal | equal | equal |",
    ]
    assert f"lacks the instructions of {'; '.join(V4)}" in text and "as E." in text


def test_what_a_machine_has_is_not_taken_from_the_emulator(tmp_path):
    assert "All ran on this processor." in written(tmp_path, [])


def test_a_piece_that_the_emulator_did_not_run_is_not_called_equal(tmp_path):
    written(tmp_path, V4)
    file = tmp_path / "emulated.json"
    emulated = json.loads(file.read_text())
    del emulated["hashes"][V4[0]]["filter"]
    file.write_text(json.dumps(emulated))
    assert section(tmp_path).splitlines()[-1].split(" | ")[-3] == "**other**"


def test_a_machine_lacks_the_settings_whose_instructions_it_has_not(monkeypatch):
    monkeypatch.setattr(equal_bytes, "features", lambda: {"avx2", "fma", "avx512f"})
    assert [one.name for one in lacking()] == V4
    monkeypatch.setattr(equal_bytes, "features", lambda: NEEDED["x86-64-v4"])
    assert lacking() == []


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
