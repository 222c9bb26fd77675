"""The command that says what recordings are, as it is called."""

from __future__ import annotations

import json
import sys

import pytest

from pipeline.__main__ import main


@pytest.fixture
def inspected(monkeypatch, capsys):
    """Exit code, output and errors of the command."""

    def call(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["pipeline", "inspect", *words])
        code = main()
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


def test_a_folder_is_a_table(inspected, exports):
    code, table, _ = inspected(str(exports))
    assert code == 0
    rows = [line.split("  ")[0] for line in table.splitlines()[2:] if not line.startswith("    ")]
    assert rows == [
        "force/C1.csv",
        "kinect/camera.yaml",
        "kinect/hold_*/depth.txt (2)",
        "mocap/fit_*.csv (3)",
        "mocap/hold_*.csv (2)",
    ]


def test_a_file_is_json_for_programs(inspected, exports):
    code, text, _ = inspected(str(exports / "mocap/fit_1.csv"), "--json")
    (take,) = json.loads(text)
    assert code == 0 and (take["format"], take["rate"], take["units"]) == (
        "Motive CSV",
        100.0,
        {"length": "m"},
    )


def test_a_place_that_does_not_exist_is_one_line(inspected, tmp_path):
    code, table, said = inspected(str(tmp_path / "nothing"))
    assert (code, table) == (1, "") and said.startswith(
        "error: inspect: there is no such file or folder [file "
    )
