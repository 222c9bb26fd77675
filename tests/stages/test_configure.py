"""The stage configure leaves nothing of a model that params.yaml does not name."""

from __future__ import annotations

from pathlib import Path

from made_options import parameters

from pipeline.stages import configure


def test_results_of_models_that_are_not_chosen_go_and_the_others_stay(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parameters(tmp_path, models="[additive]")
    for place in ("fit/additive", "fit/scaled", "filter/wishart"):
        Path("data", place).mkdir(parents=True)
        Path("data", place, "parameters.json").write_text("{}")
    configure.run()
    assert sorted(str(file) for file in Path("data").rglob("*.json")) == [
        "data/fit/additive/parameters.json"
    ]
    assert Path("data/config.yaml").is_file()
