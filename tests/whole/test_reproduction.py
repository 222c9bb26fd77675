"""The paper's part as a whole, on the smoke scale: what comes out, that it comes out the same, and
what an edit reruns.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from project_copy import GIT, ROOT, edit_text, outputs, planned, reruns, run, set_parameters

FIGURES = {file.stem for file in (ROOT / "pipeline/figures").glob("[a-z]*.py")} - {
    "style",
    "drawing",
}
IN_SPACE = {"wrench_planes", "wrench_marginals"}  # of six rows, where cables do not lie in a plane
MODELS = ("additive", "wishart", "gaussian")
# half the time of a run is that of starting a process for each stage
EVERY_STAGE = """
import sys
from pipeline.__main__ import main

for words in map(str.split, sys.argv[1:]):
    sys.argv = ["pipeline", *words]
    assert main() == 0, words
"""


@pytest.fixture
def copy(reproduced: Path, tmp_path: Path) -> Path:
    """The reproduced project to edit, with what its stages wrote and their cache."""
    folder = tmp_path / "copy"
    shutil.copytree(reproduced, folder, symlinks=True)
    return folder


def succeeds(*command: str, cwd: Path) -> str:
    done = run(*command, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def in_one_process(folder: Path) -> list[str]:
    """Run every stage of the plan of ``dvc repro`` in one process; their names."""
    stages = planned(succeeds("dvc", "repro", "--force", "--dry", cwd=folder))
    succeeds("python", "-c", EVERY_STAGE, *stages.values(), cwd=folder)
    return list(stages)


def metrics(folder: Path, dataset: str = "youbot") -> dict[str, dict[str, float]]:
    files = (folder / f"reports/{dataset}/metrics").glob("*.json")
    return {file.stem: json.loads(file.read_text()) for file in files}


def test_one_command_gives_every_figure_and_number(reproduced):
    drawn = {
        file.name: file.stat().st_size for file in (reproduced / "reports/youbot/figures").iterdir()
    }
    expected = {f"{name}.{kind}" for name in FIGURES - IN_SPACE for kind in ("svg", "png")}
    assert {*drawn} == expected
    for name in FIGURES - IN_SPACE:
        assert all(drawn[f"{name}.{kind}"] > 1000 for kind in ("svg", "png"))
    numbers = metrics(reproduced)
    fits = {model: numbers[f"fit_{model}"] for model in MODELS}
    assert {"sigma_omega_11_rad2", "sigma_omega_23_rad2", "correlation_omega_12"} <= set(
        fits["additive"]
    )
    assert 0 < fits["wishart"]["sigma_b"] < 1
    assert {"u", "alpha"} <= set(fits["gaussian"])
    assert {f"{model}_greatest_mean_error_rad" for model in MODELS} <= set(numbers["motion"])
    assert {
        f"study_m{m}_{kind}_error" for m in (3, 5, 10, 15, 20) for kind in ("mean", "greatest")
    } <= set(numbers["wrench"])
    assert {
        f"C{i}_{source}_{value}"
        for i in (1, 2, 3)
        for source in ("measured", "modelled")
        for value in ("fx", "var_fy")
    } <= set(numbers["wrench"])
    # the closed form of the convex problem against the solver, on the problems as printed
    assert fits["wishart"]["convex_check_greatest_relative_gap"] < 1e-4
    # shares and correlations are means over the takes, not sums
    summed = {name: v for name, v in numbers["recordings"].items() if "_share" in name}
    summed |= {name: v for name, v in numbers["recordings"].items() if "_correlation" in name}
    assert summed and all(-1 <= value <= 1 for value in summed.values())
    assert "dataset youbot" in (reproduced / "reports/youbot/report.md").read_text()
    # git has all that is not DVC's
    assert run("git", "status", "--porcelain", cwd=reproduced).stdout == ""


@pytest.mark.slow
def test_metrics_and_plots_show_without_a_network(copy):
    shown = json.loads(succeeds("dvc", "metrics", "show", "--json", cwd=copy))
    assert "reports/youbot/summary.json" in shown[""]["data"]
    succeeds("dvc", "plots", "show", "-o", "plots-page", cwd=copy)
    page = (copy / "plots-page/index.html").read_text()
    assert "http" not in re.sub(r"http://www\.w3\.org/\S+", "", page)
    assert "joint_std" in page


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_whatever_the_number_of_workers(copy):
    before = outputs(copy)
    set_parameters(copy, compute="local")
    for path in before:
        remove = shutil.rmtree if (copy / path).is_dir() else os.remove
        remove(copy / path)
    succeeds("dvc", "commit", "--force", *in_one_process(copy), cwd=copy)
    assert outputs(copy) == before
    # the control: another seed gives other numbers
    wrench = {file.name: file.read_bytes() for file in (copy / "data/wrench").iterdir()}
    set_parameters(copy, seed=1)
    succeeds("python", "-c", EVERY_STAGE, "configure", "wrench", cwd=copy)
    for file in (copy / "data/wrench").iterdir():
        assert file.read_bytes() != wrench[file.name], file.name


@pytest.mark.slow
def test_an_edit_of_the_filter_reruns_the_filters_and_what_shows_them(copy):
    set_parameters(copy, filter="stratified")
    said = succeeds("dvc", "repro", cwd=copy)
    ran = set(re.findall(r"Running stage '([^']+)'", said))
    filters = {f"filter@{model}" for model in MODELS}
    assert ran == {"configure", "readings", "score", "figures", "report", "page"} | filters
    # and that is what the plan said that the other tests look at
    set_parameters(copy, filter="systematic")
    assert reruns(copy) == ran - {"configure"}


@pytest.mark.slow
def test_an_edit_reruns_only_what_depends_on_it(copy):
    shown = {"score", "figures", "report", "page"}
    parameters = copy / "params.yaml"
    parameters.write_text(parameters.read_text() + "# a remark\n")
    assert reruns(copy) == set()
    set_parameters(copy, wrench="paper", overrides="{wrench: {grid: 21}}")
    assert reruns(copy) == {"wrench"} | shown
    set_parameters(copy, models="[additive, gaussian]", overrides="{}")
    assert reruns(copy) == {"predict", "readings"} | shown
    succeeds("python", "-m", "pipeline", "score", cwd=copy)
    assert "wishart" not in str(metrics(copy)["motion"])


@pytest.mark.slow
def test_an_edit_of_a_recording_reruns_the_part_that_reads_it_and_what_follows(copy):
    # as of a dataset that was recorded: what the laboratory wrote would be written anew
    for name in ("dvc.yaml", "dvc.lock"):
        (copy / "data/raw/youbot" / name).unlink()
    after_track = {f"{stage}@{model}" for stage in ("fit", "filter") for model in MODELS}
    shown = {"score", "figures", "report", "page"}
    force, take = "force/C2.csv", "optitrack/train_001.csv"
    for name, expected in (
        (force, {"files", "ingest@force", "wrench"}),
        (
            take,
            {"files", "ingest@motion", "track", "articulate", "predict", "readings"} | after_track,
        ),
    ):
        file = copy / "data/raw/youbot/recordings" / name
        before = file.read_bytes()
        edit_text(file, before.decode().rstrip("\n")[:-1] + "7\n")
        ran = succeeds("dvc", "repro", "files", cwd=copy)
        assert re.findall(r"Running stage '([^']+)'", ran) == ["files"]
        assert reruns(copy, configure=False) | {"files"} == expected | shown
        edit_text(file, before.decode())
        succeeds("dvc", "repro", "files", cwd=copy)
    # but score, which looks for the truth in the folder, and this has lost its dvc.yaml
    assert reruns(copy, configure=False) == shown


@pytest.mark.slow
def test_an_experiment_sets_a_nested_value_from_the_command_line(copy):
    run(*GIT, "add", "-A", cwd=copy)
    settings = ["-S", "+overrides.filter.particles=50", "-S", "filter=residual"]
    said = succeeds("dvc", "exp", "run", *settings, "filter@wishart", cwd=copy)
    assert OmegaConf.load(copy / "data/config.yaml").filter == {
        "scheme": "residual",
        "threshold": 0.5,
        "particles": 50,
    }
    assert set(re.findall(r"Running stage '([^']+)'", said)) == {"configure", "filter@wishart"}


@pytest.mark.slow
def test_a_bad_parameter_stops_with_one_message_and_leaves_what_stood(copy):
    before, sound = (copy / "data/config.yaml").read_text(), (copy / "params.yaml").read_text()
    for parameters, names in (
        ({"filter": "bootstrap"}, ("filter", "stratified, systematic")),
        ({"seed": "many"}, ("seed",)),
        ({"overrides": "{filter: {particels: 5}}"}, ("particels",)),
        ({"overrides": "{filter: {particles: lots}}"}, ("filter.particles",)),
        ({"models": "[]"}, ("models",)),
        ({"dataset": "yuobot"}, ("dataset", "ur5", "youbot", "new-dataset")),
    ):
        (copy / "params.yaml").write_text(sound)
        set_parameters(copy, **parameters)
        done = run("dvc", "repro", cwd=copy)
        starts = ("error: choose:", "error: configure:")
        message = [line for line in done.stderr.splitlines() if line.startswith(starts)]
        assert done.returncode != 0
        assert len(message) == 1 and all(name in message[0] for name in names), done.stderr
        assert (copy / "data/config.yaml").read_text() == before
        assert (copy / "reports/youbot/figures/joint_std.svg").exists()
        assert (copy / "data/filter/additive/posterior.parquet").exists()


@pytest.mark.slow
@pytest.mark.parametrize("dataset", ["ur5_planar", "ur5_rounds"])
def test_the_motion_part_runs_on_a_real_robot_and_the_rest_says_what_it_lacks(copy, dataset):
    recordings = ROOT.parent / "shared/recordings"
    if not (recordings / "ur5").is_dir():
        pytest.skip("the UR5 recordings are not beside the project")
    (copy.parent / "shared").mkdir()
    (copy.parent / "shared/recordings").symlink_to(recordings)
    set_parameters(copy, dataset=dataset)
    stages = planned(succeeds("dvc", "repro", "--force", "--dry", cwd=copy))
    assert any(name.endswith(f"{dataset}/dvc.yaml:inventory") for name in stages)
    said = succeeds("python", "-c", EVERY_STAGE, *stages.values(), cwd=copy)
    for lacking in (
        *("no motion capture", "the dataset has no depth camera", "nothing to filter"),
        *(f"the dataset {dataset} has no {part}" for part in ("depth", "force")),
    ):
        assert lacking in said, said
    drawn = {file.stem for file in (copy / f"reports/{dataset}/figures").glob("*.svg")}
    assert drawn == FIGURES - IN_SPACE - {
        "articulation",
        "kinect_noise",
        "filter_closed_loop",
        "filter_errors",
        "wrench_density",
    }
    numbers = metrics(copy, dataset)
    # a position-controlled arm with encoders of micro-radians: the noise of a step is far below
    # that of the youBot
    assert 1e-12 < numbers["fit_additive"]["sigma_omega_22_rad2"] < 1e-7
    assert 0 < numbers["fit_wishart"]["sigma_b"] < 0.8 and numbers["fit_gaussian"]["alpha"] > 0
    assert numbers["filter"] == {}
    assert f"dataset {dataset}" in (copy / f"reports/{dataset}/report.md").read_text()
