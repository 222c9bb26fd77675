"""The stage: all figures or the reasons why not, captions with numbers of other stages, the same bytes every time."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from pipeline import config, contracts
from pipeline.errors import ContractError
from pipeline.schema_compute import Compute
from pipeline.stages import figures

MODELS = {"additive": None, "wishart": None, "gaussian": None}
METRICS = {
    "motion": {"additive_greatest_mean_error_rad": 0.01, "recorded_std_q1_rms_rad": 0.02},
    "filter": {"additive_q1_rms_error_rad": 0.03},
    "wrench": {"study_m3_mean_error": 0.04, "C1_measured_fx": 3.0},
}
DEPTH = {"articulation", "kinect_noise", "filter_errors"}


@pytest.fixture
def project(tmp_path, monkeypatch, tables, configurations):
    """A folder with the tables of all stages, and the settings of the stage ``figures``."""
    monkeypatch.chdir(tmp_path)
    for sources in figures.FIGURES.values():
        for table, folder in sources.tables.items():
            folder.mkdir(parents=True, exist_ok=True)
            contracts.write(tables[table], table, folder)
    for name, metrics in METRICS.items():
        contracts.write_metrics(metrics, figures.MOTION.with_name(f"{name}.json"))
    force = SimpleNamespace(configurations=configurations)
    settings = SimpleNamespace(
        models=MODELS, dataset=SimpleNamespace(force=force), simulation=SimpleNamespace(mode="one_step"), compute=Compute(workers=1)
    )
    monkeypatch.setattr(config, "sections", lambda stage: settings)
    return tmp_path


def written(project):
    return {file.name: file.read_bytes() for file in (project / figures.OUT).iterdir()}


@pytest.mark.slow
def test_every_figure_is_written_in_both_formats_and_the_same_every_time(project):
    figures.run()
    first = written(project)
    assert {*first} == {f"{name}.{kind}" for name in figures.FIGURES for kind in ("svg", "png")} | {"captions.json"}
    figures.run()
    assert written(project) == first


def test_figures_without_their_instrument_are_left_out_and_the_reason_is_said(project, capsys):
    for sources in figures.FIGURES.values():
        for table, folder in sources.tables.items():
            if table in figures.INSTRUMENTS:
                (folder / f"{table}.parquet").unlink(missing_ok=True)
    figures.run()
    lines = capsys.readouterr().out.splitlines()
    reasons = dict.fromkeys(DEPTH, "depth camera") | {"wrench_density": "force transducer", "faults": "synthetic laboratory"}
    reasons |= dict.fromkeys(("model_scores", "parameter_recovery", "sigma_b_choices"), "time at rest")
    reasons["ridge"] = "fitted Gaussian matrix model"
    assert {line for line in lines if "left out" in line} == {
        f"figures: {name} left out: the dataset has no {instrument}" for name, instrument in reasons.items()
    }
    names = {name.partition(".")[0] for name in written(project)} - {"captions"}
    assert names == {*figures.FIGURES} - {*reasons}
    assert {*json.loads((figures.OUT / "captions.json").read_text())} == names


def test_a_table_that_every_dataset_has_is_not_left_out_in_silence(project):
    (figures.SCORE / "deviation.parquet").unlink()
    with pytest.raises(ContractError, match="no table 'deviation'"):
        figures.run()
    assert not figures.OUT.exists()


def test_numbers_beside_a_figure_are_those_that_another_stage_wrote(project):
    caption = figures._caption(figures.FIGURES["mean_error"])
    assert caption["numbers"] == {"additive_greatest_mean_error_rad": 0.01}
    assert caption["sources"] == ["data/score/deviation.parquet", "reports/metrics/motion.json"]
    assert caption["script"] == "pipeline/figures/mean_error.py"
    assert caption["title"] == "Error of the mean of each model's realisations"


def test_metrics_without_the_numbers_to_state_are_refused(project):
    contracts.write_metrics({"something_else": 1.0}, figures.MOTION)
    with pytest.raises(ContractError, match="no number named like"):
        figures._caption(figures.FIGURES["mean_error"])
    figures.MOTION.unlink()
    with pytest.raises(ContractError, match="no such metrics"):
        figures._caption(figures.FIGURES["mean_error"])


def test_every_figure_has_a_title_and_a_caption():
    for sources in figures.FIGURES.values():
        title, _, text = " ".join(sources.module.__doc__.split()).partition(". ")
        assert 10 < len(title) < 100 < len(text)
