"""The command that runs a stage: what it refuses before anything runs."""

from __future__ import annotations

import sys

import pytest

from pipeline.__main__ import main


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nonsense"], "invalid choice: 'nonsense' (choose from"),
        ([], "required: stage"),
        (["fit"], "fit runs for one item: name it"),
        (["track", "wishart"], "track takes no item"),
    ],
)
def test_a_command_that_names_no_stage_or_the_wrong_number_of_items_is_refused(arguments, said, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["pipeline", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert said in capsys.readouterr().err


def test_a_refusal_is_one_line_that_names_the_stage(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["pipeline", "configure"])
    assert main() == 1
    assert capsys.readouterr().err == "error: configure: no such file; run the pipeline from the project's root [file params.yaml]\n"
