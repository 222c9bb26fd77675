"""The experiment as a whole, on the smoke scale: what comes out, that it comes out the same, and what an edit reruns."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path

import pytest
from conftest import GIT, run
from omegaconf import OmegaConf
from smoke import planned, set_parameters

pytestmark = pytest.mark.slow

FIGURES = (
    "joint_realizations", "mean_error", "joint_std", "articulation", "kinect_noise", "filter_errors", "recording_quality",
    "wrench_error_histograms", "wrench_density", "parameter_recovery", "sigma_b_choices", "ridge", "sensitivity", "cable_robot",
    "model_scores", "faults",
)  # fmt: skip
MODELS = ("additive", "wishart", "gaussian")
EVERY_STAGE = """
import sys
from importlib import import_module

for stage, *item in map(str.split, sys.argv[1:]):
    import_module(f"pipeline.stages.{stage}").run(*item)
"""
AFTER_THE_MODELS = {"configure", "sensitivity", "score", "figures", "play", "evidence", "report", "crate", "page"}


@pytest.fixture
def copy(reproduced: Path, tmp_path: Path) -> Path:
    """The reproduced project to edit, with what its stages wrote and their cache."""
    folder = tmp_path / "copy"
    shutil.copytree(reproduced, folder, symlinks=True)
    return folder


def stages_run(output: str) -> set[str]:
    return {name.rsplit(":", 1)[-1] for name in re.findall(r"Running stage '([^']+)'", output)}


def outputs(folder: Path) -> dict[str, str]:
    """Hash of every output in both lock files but the configuration, which names where trials run."""
    locked = {}
    for file in ("dvc.lock", "data/raw/youbot/dvc.lock"):
        for stage in OmegaConf.to_container(OmegaConf.load(folder / file))["stages"].values():
            locked |= {out["path"]: out["md5"] for out in stage["outs"]}
    locked.pop("data/config.yaml")
    return locked


def test_one_command_gives_every_figure_and_number(reproduced):
    for name in FIGURES:
        for kind in ("svg", "png"):
            assert (reproduced / f"reports/figures/{name}.{kind}").stat().st_size > 1000
    metrics = {file.stem: json.loads(file.read_text()) for file in (reproduced / "reports/metrics").glob("*.json")}
    assert {"sigma_omega_11_rad2", "sigma_omega_23_rad2", "correlation_omega_12"} <= set(metrics["fit_additive"])
    assert 0 < metrics["fit_wishart"]["sigma_b"] < 1
    assert {"u", "alpha"} <= set(metrics["fit_gaussian"])
    assert {f"{model}_greatest_mean_error_rad" for model in MODELS} <= set(metrics["motion"])
    assert {f"study_m{m}_{kind}_error" for m in (3, 5, 10, 15, 20) for kind in ("mean", "greatest")} <= set(metrics["wrench"])
    assert {f"C{i}_{source}_{value}" for i in (1, 2, 3) for source in ("measured", "modelled") for value in ("fx", "var_fy")} <= set(
        metrics["wrench"]
    )
    # the closed form of the convex problem against the solver, on the problems as printed
    assert metrics["fit_wishart"]["convex_check_greatest_relative_gap"] < 1e-4


def test_metrics_and_plots_show_without_a_network(copy):
    shown = run("dvc", "metrics", "show", "--json", cwd=copy)
    assert shown.returncode == 0
    assert "reports/metrics/fit_wishart.json" in json.loads(shown.stdout)[""]["data"]
    plots = run("dvc", "plots", "show", "-o", "plots-page", cwd=copy)
    assert plots.returncode == 0, plots.stderr
    page = (copy / "plots-page/index.html").read_text()
    assert "http" not in re.sub(r"http://www\.w3\.org/\S+", "", page)
    assert "joint_std" in page


def test_the_same_seed_gives_the_same_bytes_whatever_the_number_of_workers(copy):
    before = outputs(copy)
    set_parameters(copy, compute="local")
    for path in before:
        remove = shutil.rmtree if (copy / path).is_dir() else os.remove
        remove(copy / path)
    plan = run("dvc", "repro", "--force", "--dry", cwd=copy)
    assert plan.returncode == 0, plan.stderr
    stages = planned(plan.stdout)
    # all of them in one process: half the time of a run is that of starting one for each
    for command in (["python", "-c", EVERY_STAGE, *stages.values()], ["dvc", "commit", "--force", *stages]):
        done = run(*command, cwd=copy)
        assert done.returncode == 0, done.stdout + done.stderr
    assert outputs(copy) == before


def test_another_seed_gives_other_numbers(copy):
    before = outputs(copy)
    set_parameters(copy, seed=1)
    done = run("dvc", "repro", "wrench", cwd=copy)
    assert done.returncode == 0, done.stdout + done.stderr
    assert outputs(copy)["data/wrench"] != before["data/wrench"]


def test_an_edit_reruns_only_what_depends_on_it(copy):
    set_parameters(copy, filter="stratified")
    done = run("dvc", "repro", cwd=copy)
    assert done.returncode == 0, done.stdout + done.stderr
    assert stages_run(done.stdout) == AFTER_THE_MODELS | {f"filter@{model}" for model in MODELS}
    set_parameters(copy, models="[additive, gaussian]")
    done = run("dvc", "repro", cwd=copy)
    assert done.returncode == 0, done.stdout + done.stderr
    assert stages_run(done.stdout) == AFTER_THE_MODELS | {"control"}
    assert "wishart" not in json.loads((copy / "reports/metrics/motion.json").read_text()).__str__()


def test_an_edit_of_a_comment_reruns_configure_alone(copy):
    file = copy / "params.yaml"
    file.write_text(file.read_text() + "# a remark\n")
    done = run("dvc", "repro", cwd=copy)
    assert stages_run(done.stdout) == {"configure"}


def test_an_experiment_sets_a_nested_value_from_the_command_line(copy):
    run(*GIT, "add", "-A", cwd=copy)
    done = run("dvc", "exp", "run", "-S", "+overrides.filter.particles=50", "-S", "filter=residual", "filter@wishart", cwd=copy)
    assert done.returncode == 0, done.stdout + done.stderr
    assert OmegaConf.load(copy / "data/config.yaml").filter == {"scheme": "residual", "threshold": 0.5, "particles": 50}
    assert stages_run(done.stdout) == {"configure", "filter@wishart"}


@pytest.mark.parametrize(
    ("parameters", "names"),
    [
        ({"filter": "bootstrap"}, ("filter", "stratified, systematic")),
        ({"seed": "many"}, ("seed",)),
        ({"overrides": "{filter: {particels: 5}}"}, ("particels",)),
        ({"overrides": "{filter: {particles: lots}}"}, ("filter.particles",)),
        ({"models": "[]"}, ("models",)),
        ({"dataset": "yuobot"}, ("dataset", "ur5", "youbot", "new-dataset")),
    ],
)
def test_a_bad_parameter_stops_with_one_message_and_leaves_what_stood(copy, parameters, names):
    before = (copy / "data/config.yaml").read_text()
    set_parameters(copy, **parameters)
    done = run("dvc", "repro", cwd=copy)
    message = [line for line in done.stderr.splitlines() if line.startswith(("error: choose:", "error: configure:"))]
    assert done.returncode != 0
    if parameters.get("models") != "[]":  # DVC itself refuses an empty matrix
        assert len(message) == 1 and all(name in message[0] for name in names), done.stderr
    assert (copy / "data/config.yaml").read_text() == before
    assert (copy / "reports/figures/joint_std.svg").exists() and (copy / "data/filter/additive/posterior.parquet").exists()


@pytest.mark.parametrize("dataset", ["ur5", "ur5_rounds"])
def test_the_motion_part_runs_on_a_real_robot_and_the_rest_says_what_it_lacks(copy, dataset):
    recordings = Path(__file__).parents[2] / "shared/recordings"
    if not (recordings / "ur5").is_dir():
        pytest.skip("the UR5 recordings are not beside the project")
    (copy.parent / "shared").mkdir()
    (copy.parent / "shared/recordings").symlink_to(recordings)
    set_parameters(copy, dataset=dataset)
    done = run("dvc", "repro", cwd=copy)
    assert done.returncode == 0, done.stdout + done.stderr
    for lacking in ("no mocap", "no depth camera", "nothing to filter", "no force transducer"):
        assert lacking in done.stdout
    drawn = {file.stem for file in (copy / "reports/figures").glob("*.svg")}
    study = {"parameter_recovery", "sigma_b_choices", "ridge", "sensitivity", "model_scores"}
    assert drawn == {"recording_quality", "joint_realizations", "mean_error", "joint_std", "wrench_error_histograms", "cable_robot"} | study
    metrics = {file.stem: json.loads(file.read_text()) for file in (copy / "reports/metrics").glob("*.json")}
    # a position-controlled arm with encoders of micro-radians: the noise of a step is far below that of the youBot
    assert 1e-12 < metrics["fit_additive"]["sigma_omega_22_rad2"] < 1e-7
    assert 0 < metrics["fit_wishart"]["sigma_b"] < 0.8 and metrics["fit_gaussian"]["alpha"] > 0
    assert metrics["filter"] == {} and f"dataset {dataset}" in (copy / "reports/report.md").read_text()
