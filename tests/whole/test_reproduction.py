"""The paper's part as a whole, on the smoke scale: its results, their bytes in another run, and the
stages that an edit reruns.
"""

import json
import os
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml
from project_copy import (
    EVERY_COMMAND,
    contents,
    copy_reproduced,
    edit_text,
    error_line,
    in_one_process,
    outputs,
    planned,
    run,
    set_parameters,
    succeeds,
)

from pipeline.figures.drawing import figures_in

pytestmark = pytest.mark.slow

IN_SPACE = {"wrench_marginals"}  # of six rows, where cables do not lie in a plane
FIGURES = {*figures_in()} - IN_SPACE
MODELS = ("additive", "wishart", "gaussian")
CONTROL = "no_noise"
SHOWN = {"score", "figures", "publish", "report", "page"}
FILTERS = {f"filter@{model}" for model in MODELS}
MOTION = {"ingest@motion", "track", "articulate", "predict", "readings"} | FILTERS
MOTION |= {f"fit@{model}" for model in MODELS}


@pytest.fixture
def copy(reproduced: Path, tmp_path: Path) -> Path:
    """The reproduced project to edit, with what its stages wrote and their cache."""
    return copy_reproduced(reproduced, tmp_path / "copy")


def reruns(folder: Path, first: str = "configure") -> set[str]:
    """The stages that ``dvc repro`` would run at most after an edit, once ``first`` has run: those
    whose dependencies have changed, and all that follow them.
    """
    succeeds("dvc", "repro", first, cwd=folder)
    return {
        *planned(succeeds("dvc", "repro", "--dry", "--force-downstream", cwd=folder)),
    }


def ran(output: str) -> set[str]:
    return set(re.findall(r"Running stage '([^']+)'", output))


def git_status(folder: Path) -> str:
    return succeeds("git", "status", "--porcelain", cwd=folder)


def test_one_command_gives_every_figure_and_number(reproduced):
    drawn = contents(reproduced / "reports/youbot/figures")
    assert {*drawn} == {f"{name}.{kind}" for name in FIGURES for kind in ("svg", "png")}
    assert min(map(len, drawn.values())) > 1000

    files = (reproduced / "reports/youbot/metrics").glob("*.json")
    numbers = {file.stem: json.loads(file.read_text()) for file in files}
    fits = {model: numbers[f"fit_{model}"] for model in MODELS}

    assert {"sigma_omega_11_rad2", "correlation_omega_12"} <= {*fits["additive"]}
    assert 0 < fits["wishart"]["sigma_b"] < 1 and "noise_level" in fits["gaussian"]

    tables = reproduced / "reports/youbot/tables"
    evidence = pd.read_csv(tables / "evidence.csv").set_index("quantity")
    assert {*evidence.loc["greatest_mean_error", "model"]} == {*MODELS, CONTROL}

    studied = evidence.loc["mean_error_of_variances"]
    cables = studied["configuration"].astype(int)
    assert cables[studied["estimator"].isna()].tolist() == [3, 5, 10, 15, 20]
    assert {f"C{n}_sigma_s_clipped" for n in (1, 2, 3)} <= {*numbers["wrench"]}

    moments = (tables / "force_moments.csv").read_text()
    assert "C1,measured" in moments and "C3,modelled" in moments
    # the closed form of the convex problem against the solver, on the problems as printed
    assert fits["wishart"]["convex_check_greatest_relative_gap"] < 1e-4

    # shares and correlations are means over the takes, not sums
    losses = pd.read_csv(tables / "recording_quality.csv")
    means = losses.loc[losses["quantity"].str.contains("_share|_corr"), "mean"]
    assert len(means) and means.between(-1, 1).all()
    assert "dataset youbot" in (reproduced / "reports/youbot/report.md").read_text()

    # every table is written by a stage that names it
    stages = yaml.safe_load((reproduced / "dvc.yaml").read_text())["stages"]
    for name, stage in stages.items():
        written = {
            file.stem for file in (reproduced / "data" / name).rglob("*.parquet")
        }
        named = set()
        for entry in stage.get("params", []):
            if isinstance(entry, dict):
                named |= {*entry.get("pipeline/tables.yaml", [])}
        assert written <= named, name
    # git has all that is not DVC's
    assert git_status(reproduced) == ""


def test_the_same_seed_gives_the_same_bytes_whatever_the_number_of_workers(copy):
    before = outputs(copy)
    set_parameters(copy, compute="local")
    for path in before:
        remove = shutil.rmtree if (copy / path).is_dir() else os.remove
        remove(copy / path)
    succeeds("dvc", "commit", "--force", *in_one_process(copy)[0], cwd=copy)
    assert outputs(copy) == before

    # the control: another seed gives other numbers
    wrench = contents(copy / "data/wrench")
    set_parameters(copy, seed=1)
    succeeds("python", "-c", EVERY_COMMAND, "configure", "wrench", cwd=copy)
    again = contents(copy / "data/wrench")
    assert wrench.keys() == again.keys() and not wrench.items() & again.items()


def test_an_edit_reruns_what_depends_on_it_and_going_back_restores_the_committed_bytes(
    copy,
):
    before = outputs(copy)
    parameters = copy / "params.yaml"
    sound = parameters.read_text()
    set_parameters(copy, filter="multinomial")
    plan = reruns(copy)
    assert plan == {"readings"} | SHOWN | FILTERS
    assert ran(succeeds("dvc", "repro", cwd=copy)) == plan
    # DVC's run cache holds all but what git does
    succeeds("git", "checkout", "params.yaml", cwd=copy)
    back = ran(succeeds("dvc", "repro", cwd=copy))
    assert back == {"configure", "publish", "report", "page"}
    assert outputs(copy) == before and git_status(copy) == ""

    # neither a comment nor the place of the trials changes any result
    parameters.write_text(
        sound.replace("compute: serial", "compute: dask") + "# a remark\n",
    )
    assert reruns(copy) == set()
    for edit, stages in (
        ({"wrench": "paper", "overrides": "{wrench: {grid: 21}}"}, {"wrench"}),
        ({"models": "[additive, gaussian]"}, {"predict", "readings"}),
    ):
        parameters.write_text(sound)
        set_parameters(copy, **edit)
        assert reruns(copy) == stages | SHOWN
    parameters.write_text(sound)
    succeeds("dvc", "repro", cwd=copy)  # from the cache
    # a word in a claim decides again and computes nothing
    claims = copy / "pipeline/verdicts/claims.yaml"
    stated = claims.read_text(encoding="utf-8")
    edited = stated.replace("reason: the printed limit", "reason: the limit in print")
    edit_text(claims, edited)
    assert reruns(copy) == {"report", "page"}
    edit_text(claims, stated)

    # as of a dataset that was recorded: what the laboratory wrote would be written anew
    for name in ("dvc.yaml", "dvc.lock"):
        (copy / "data/raw/youbot" / name).unlink()
    recordings = copy / "data/raw/youbot/recordings"
    for name, stages in (
        ("force/C2.csv", {"ingest@force", "wrench"}),
        ("optitrack/train_001.csv", MOTION),
    ):
        content = (recordings / name).read_bytes().decode()
        edit_text(recordings / name, content.rstrip("\n")[:-1] + "7\n")
        assert reruns(copy, "files") == stages | SHOWN
        edit_text(recordings / name, content)
    # score alone, which reads the folder for the truth, as its dvc.yaml is gone
    assert reruns(copy, "files") == SHOWN


def test_a_stage_that_fails_names_the_commands_that_restore_its_results(copy):
    code = copy / "pipeline/stages/wrench.py"
    before = outputs(copy, "wrench")
    sound = code.read_text()
    first = "\n    settings = config"
    assert first in sound
    edit_text(code, sound.replace(first, f'\n    raise OSError(28, "full"){first}'))
    message = error_line(run("dvc", "repro", "--single-item", "wrench", cwd=copy))
    assert not any((copy / path).exists() for path in before)

    edit_text(code, sound)
    for command in re.findall(r"`((?:dvc|git) checkout [^`]+)`", message):
        succeeds(*command.split(), cwd=copy)

    assert all((copy / path).exists() for path in before)
    assert outputs(copy, "wrench") == before and git_status(copy) == ""


def test_a_bad_parameter_stops_with_one_message_and_keeps_all_results(copy):
    before = contents(copy / "data")
    sound = (copy / "params.yaml").read_text()
    # output of the stage choose, which fails
    chosen = {"dataset.txt": before["dataset.txt"]}

    for parameters, names in (
        ({"filter": "bootstrap"}, ("configure", "filter", "none, systematic")),
        ({"dataset": "yuobot"}, ("choose", "dataset", "ur5", "youbot", "new-dataset")),
    ):
        (copy / "params.yaml").write_text(sound)
        set_parameters(copy, **parameters)
        message = error_line(run("dvc", "repro", cwd=copy))
        assert all(name in message for name in names), message
        assert contents(copy / "data") | chosen == before


def test_dvc_shows_the_summary_and_the_figures_without_a_network(copy):
    shown = json.loads(succeeds("dvc", "metrics", "show", "--json", cwd=copy))
    assert "reports/youbot/summary.json" in shown[""]["data"]

    succeeds("dvc", "plots", "show", "-o", "plots-page", cwd=copy)
    page = (copy / "plots-page/index.html").read_text()
    figures = re.findall(r"<img[^>]*figures_(\w+)\.", page)
    drawn = {file.stem for file in (copy / "reports/youbot/figures").iterdir()}

    assert sorted(figures) == sorted(drawn) and "joint_std" in drawn
    assert "http" not in re.sub(r"http://www\.w3\.org/\S+", "", page)


def test_a_kill_while_dvc_writes_its_cache_of_runs_is_mended_by_the_same_command(copy):
    runs = copy / ".dvc/cache/runs"
    for file in [path for path in runs.rglob("*") if path.is_file()]:
        file.unlink()
    assert any(runs.iterdir())
    (copy / "dvc.lock").unlink()
    assert run("dvc", "repro", "files", cwd=copy).returncode != 0

    succeeds("make", "-o", ".venv/.ready", "mend", cwd=copy)
    assert not any(runs.glob("*/*"))
    succeeds("dvc", "repro", "files", cwd=copy)
