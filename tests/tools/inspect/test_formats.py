"""Which format a file is named as, and what its program's own quirks add to that."""

from __future__ import annotations

import pytest

from pipeline.tools.inspect.examine import inspect


@pytest.mark.parametrize("first", ["Format Version;1.23;Length Units;Meters", "info\tversion\t1.1"])
def test_a_take_that_another_program_saved_is_still_named_one(tmp_path, first):
    (tmp_path / "take.csv").write_text(f"{first}\n\n")
    (one,) = inspect(tmp_path / "take.csv")
    assert one.format.startswith("Motive CSV")
    assert "another program saved the take" in one.stops[0]


def test_text_of_two_bytes_a_letter_is_named_and_refused(tmp_path):
    (tmp_path / "log.csv").write_bytes("t,x\n0,1\n".encode("utf-16"))
    (one,) = inspect(tmp_path / "log.csv")
    assert (one.format, "export it as UTF-8" in one.stops[0]) == ("text in UTF-16", True)


def test_a_force_log_says_its_units_in_whichever_row_they_stand_and_whether_it_has_times(tmp_path):
    axes = [f"{kind} {axis}" for kind in ("Force", "Torque") for axis in "XYZ"]
    rows = "".join(f"{k * 0.01:.2f},{k}.5,2,3,4,5,6\n" for k in range(9) if k != 4)
    settings = "Frequency = 100,Averaging Level = 1\n"
    (tmp_path / "timed.csv").write_text(
        f"Time,{','.join(axes)}\n(s),N,N,N,N-mm,N-mm,N-mm\n{settings}{rows}"
    )
    (timed,) = inspect(tmp_path / "timed.csv")
    assert (timed.units, timed.gaps["missing_samples"]) == ({"force": "N", "torque": "N-mm"}, 1)
    assert "times" not in timed.facts
    bare = "\n".join(row.partition(",")[2] for row in rows.splitlines())
    (tmp_path / "bare.csv").write_text(
        f"{','.join(f'{axis} (lbf)' for axis in axes[:3])}\n{settings}"
        + bare.replace(",4,5,6", "")
        + "\n"
    )
    (without,) = inspect(tmp_path / "bare.csv")
    assert without.units == {"force": "lbf"}
    assert "row that it lost" in without.facts["times"]
