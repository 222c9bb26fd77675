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
from project_copy import (
    EVERY_COMMAND,
    GIT,
    ROOT,
    copy_reproduced,
    edit_text,
    error_line,
    in_one_process,
    outputs,
    reruns,
    run,
    set_parameters,
    succeeds,
)

MODULES = {file.stem for file in (ROOT / "pipeline/figures").glob("[a-z]*.py")}
IN_SPACE = {"wrench_planes", "wrench_marginals"}  # of six rows, where cables do not lie in a plane
FIGURES = MODULES - {"style", "drawing"} - IN_SPACE
NEED_DEPTH_OR_FORCE = {
    *("articulation", "kinect_noise", "filter_closed_loop", "filter_errors", "wrench_density"),
}
MODELS = ("additive", "wishart", "gaussian")
SHOWN = {"score", "figures", "publish", "report", "page"}


@pytest.fixture
def copy(reproduced: Path, tmp_path: Path) -> Path:
    """The reproduced project to edit, with what its stages wrote and their cache."""
    return copy_reproduced(reproduced, tmp_path / "copy")


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def metrics(folder: Path, dataset: str = "youbot") -> dict[str, dict[str, float]]:
    files = (folder / f"reports/{dataset}/metrics").glob("*.json")
    return {file.stem: json.loads(file.read_text()) for file in files}


def test_one_command_gives_every_figure_and_number(reproduced):
    drawn = contents(reproduced / "reports/youbot/figures")
    assert {*drawn} == {f"{name}.{kind}" for name in FIGURES for kind in ("svg", "png")}
    assert min(map(len, drawn.values())) > 1000
    numbers = metrics(reproduced)
    fits = {model: numbers[f"fit_{model}"] for model in MODELS}
    assert {"sigma_omega_11_rad2", "correlation_omega_12"} <= {*fits["additive"]}
    assert 0 < fits["wishart"]["sigma_b"] < 1 and {"u", "alpha"} <= {*fits["gaussian"]}
    assert {f"{model}_greatest_mean_error_rad" for model in MODELS} <= {*numbers["motion"]}
    assert {f"study_m{m}_mean_error" for m in (3, 5, 10, 15, 20)} <= {*numbers["wrench"]}
    assert {"C1_measured_fx", "C3_modelled_var_fy"} <= {*numbers["wrench"]}
    # shares and correlations are means over the takes, not sums
    means = [v for name, v in numbers["recordings"].items() if re.search("_share|_corr", name)]
    assert means and all(-1 <= value <= 1 for value in means)
    assert "dataset youbot" in (reproduced / "reports/youbot/report.md").read_text()
    # git has all that is not DVC's
    assert succeeds("git", "status", "--porcelain", cwd=reproduced) == ""


@pytest.mark.slow
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


@pytest.mark.slow
def test_an_edit_reruns_what_shows_it_and_going_back_restores_the_committed_bytes(copy):
    before, filters = outputs(copy), {f"filter@{model}" for model in MODELS}
    set_parameters(copy, filter="stratified")
    plan = reruns(copy)
    ran = set(re.findall(r"Running stage '([^']+)'", succeeds("dvc", "repro", cwd=copy)))
    assert ran == plan == {"readings"} | SHOWN | filters
    # the run cache holds all but what git does
    succeeds("git", "checkout", "params.yaml", cwd=copy)
    back = succeeds("dvc", "repro", cwd=copy)
    written = {"configure", "publish", "report", "page"}
    assert set(re.findall(r"Running stage '([^']+)'", back)) == written
    assert outputs(copy) == before
    assert succeeds("git", "status", "--porcelain", cwd=copy) == ""


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["wrench", "publish"])
def test_a_stage_that_fails_names_the_commands_that_restore_its_results(copy, stage):
    code, before = copy / f"pipeline/stages/{stage}.py", outputs(copy, stage)
    sound = code.read_text()
    first = re.search(r"\n    (?:settings|name) = config", sound)[0]
    edit_text(code, sound.replace(first, f'\n    raise OSError(28, "full"){first}'))
    message = error_line(run("dvc", "repro", "--single-item", stage, cwd=copy))
    assert not any((copy / path).exists() for path in before)
    edit_text(code, sound)
    for command in re.findall(r"`((?:dvc|git) checkout [^`]+)`", message):
        succeeds(*command.split(), cwd=copy)
    assert all((copy / path).exists() for path in before)
    assert outputs(copy, stage) == before
    assert succeeds("git", "status", "--porcelain", cwd=copy) == ""


@pytest.mark.slow
def test_an_edit_of_an_option_or_of_a_recording_reruns_only_what_depends_on_it(copy):
    parameters = copy / "params.yaml"
    sound = parameters.read_text()
    parameters.write_text(sound + "# a remark\n")
    assert reruns(copy) == set()
    set_parameters(copy, compute="dask")  # nor does the place of the trials change any result
    assert reruns(copy) == set()
    set_parameters(copy, compute="serial", wrench="paper", overrides="{wrench: {grid: 21}}")
    assert reruns(copy) == {"wrench"} | SHOWN
    set_parameters(copy, models="[additive, gaussian]", overrides="{}")
    assert reruns(copy) == {"predict", "readings"} | SHOWN
    succeeds("python", "-m", "pipeline", "score", cwd=copy)
    assert "wishart" not in (copy / "data/score/metrics/motion.json").read_text()
    parameters.write_text(sound)
    succeeds("dvc", "repro", cwd=copy)  # from the cache
    # as of a dataset that was recorded: what the laboratory wrote would be written anew
    for name in ("dvc.yaml", "dvc.lock"):
        (copy / "data/raw/youbot" / name).unlink()
    after_track = {f"{stage}@{model}" for stage in ("fit", "filter") for model in MODELS}
    motion = {"ingest@motion", "track", "articulate", "predict", "readings"} | after_track
    for name, parts in (
        ("force/C2.csv", {"ingest@force", "wrench"}),
        ("optitrack/train_001.csv", motion),
    ):
        file = copy / "data/raw/youbot/recordings" / name
        before = file.read_bytes()
        edit_text(file, before.decode().rstrip("\n")[:-1] + "7\n")
        ran = succeeds("dvc", "repro", "files", cwd=copy)
        assert re.findall(r"Running stage '([^']+)'", ran) == ["files"]
        assert reruns(copy, configure=False) | {"files"} == {"files"} | parts | SHOWN
        edit_text(file, before.decode())
        succeeds("dvc", "repro", "files", cwd=copy)
    # but score, which looks for the truth in the folder, and this has lost its dvc.yaml
    assert reruns(copy, configure=False) == SHOWN


@pytest.mark.slow
def test_experiments_metrics_and_plots_of_dvc(copy):
    shown = json.loads(succeeds("dvc", "metrics", "show", "--json", cwd=copy))
    assert "reports/youbot/summary.json" in shown[""]["data"]
    succeeds("dvc", "plots", "show", "-o", "plots-page", cwd=copy)
    page = (copy / "plots-page/index.html").read_text()
    # without a network
    assert "joint_std" in page and "http" not in re.sub(r"http://www\.w3\.org/\S+", "", page)
    shutil.rmtree(copy / "plots-page")
    run(*GIT, "add", "-A", cwd=copy)
    settings = ["-S", "+overrides.filter.particles=50", "-S", "filter=residual"]
    said = succeeds("dvc", "exp", "run", *settings, "filter@wishart", cwd=copy)
    expected = {"scheme": "residual", "threshold": 0.5, "particles": 50}
    assert OmegaConf.load(copy / "data/config.yaml").filter == expected
    assert set(re.findall(r"Running stage '([^']+)'", said)) == {"configure", "filter@wishart"}


@pytest.mark.slow
def test_a_bad_parameter_stops_with_one_message_and_keeps_all_results(copy):
    before, sound = (copy / "data/config.yaml").read_text(), (copy / "params.yaml").read_text()
    for parameters, names in (
        ({"filter": "bootstrap"}, ("configure", "filter", "stratified, systematic")),
        ({"overrides": "{filter: {particels: 5}}"}, ("configure", "particels")),
        ({"overrides": "{filter: {particles: lots}}"}, ("configure", "filter.particles")),
        ({"models": "[]"}, ("models",)),
        ({"dataset": "yuobot"}, ("choose", "dataset", "ur5", "youbot", "new-dataset")),
    ):
        (copy / "params.yaml").write_text(sound)
        set_parameters(copy, **parameters)
        message = error_line(run("dvc", "repro", cwd=copy))
        assert all(name in message for name in names), message
        assert (copy / "data/config.yaml").read_text() == before
        assert (copy / "reports/youbot/figures/joint_std.svg").exists()
        assert (copy / "data/filter/additive/posterior.parquet").exists()


@pytest.mark.slow
def test_the_motion_part_runs_on_a_real_robot_beside_the_results_of_another_dataset(copy):
    recordings, dataset = ROOT.parent / "shared/recordings", "ur5_planar"
    if not (recordings / "ur5").is_dir():
        pytest.skip("the UR5 recordings are not beside the project")
    (copy.parent / "shared").mkdir()
    (copy.parent / "shared/recordings").symlink_to(recordings)
    other = contents(copy / "reports/youbot")
    set_parameters(copy, dataset=dataset)
    stages, said = in_one_process(copy)
    assert f"data/raw/{dataset}/dvc.yaml:inventory" in stages
    for lacking in (
        *("no motion capture", "the dataset has no depth camera", "nothing to filter"),
        *(f"the dataset {dataset} has no {part}" for part in ("depth", "force")),
    ):
        assert lacking in said, said
    drawn = {file.stem for file in (copy / f"reports/{dataset}/figures").glob("*.svg")}
    assert drawn == FIGURES - NEED_DEPTH_OR_FORCE
    numbers = metrics(copy, dataset)
    # a position-controlled arm with encoders of micro-radians: the noise of a step is far below
    # that of the youBot
    assert 1e-12 < numbers["fit_additive"]["sigma_omega_22_rad2"] < 1e-7
    assert 0 < numbers["fit_wishart"]["sigma_b"] < 0.8 and numbers["fit_gaussian"]["alpha"] > 0
    assert numbers["filter"] == {}
    assert f"dataset {dataset}" in (copy / f"reports/{dataset}/report.md").read_text()
    assert contents(copy / "reports/youbot") == other
