"""The reader beside an exported model is one file, needs only NumPy and gives the project's own
numbers; worked examples run with it: filters, a planner's cost, the covariance of a frame.
"""

import json
import re
import shutil
import subprocess
import sys
import types
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from case_tables import cases_beside
from error_runs import known_law, runs_of_law, sweep
from exported_models import PARAMETERS, write_model
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from source_code import ROOT

from pipeline.configuration import config
from pipeline.core.errors import (
    ContractError,
    ModelDomainError,
    SingularJacobianError,
)
from pipeline.models import load
from pipeline.models.exported.copied import READER_NAME, reader_source
from pipeline.models.exported.reader import SCORED, OutsideRanges, UnconfirmedBands
from pipeline.models.exported.writer import (
    error_record,
    require_covariance,
    write_export,
)
from pipeline.models.joint_error.samples import HORIZONS
from pipeline.models.kinds import kinds
from pipeline.models.steps import Recorded
from pipeline.tools.export import command

cases = cases_beside(__file__)
REFUSED = (
    "dvc hydra omegaconf pydantic pandas pinocchio matplotlib numba llvmlite scipy yaml"
)
ALONE = """
import importlib, json, sys, time
class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in sys.argv[3].split():
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Refused())
begun = time.process_time()  # of the processor: other tests run beside
import numpy as np
model = importlib.import_module(sys.argv[1]).load(sys.argv[2])
took, rng = time.process_time() - begun, np.random.default_rng(1)
q = np.array([0.3, 1.5, -0.4]) + 0.1 * np.arange(5)[:, None]
v = np.array([0.001, -0.001, 0.01])
mean = model.mean(q, task_step=v)
out = {"mean": mean.tolist(), "repr": repr(model), "took": took}
assert model.command(q, model.chain.pose(mean), task_step=v).shape == (5, 3)
try:
    out["covariance"] = model.covariance(q, task_step=v).tolist()
    out["density"] = model.log_density(q, model.step(q, task_step=v, rng=rng), task_step=v).tolist()
    assert model.sample(q, task_step=v, size=7, rng=rng).shape == (7, 5, 3)
except Exception as error:
    out["refused"] = str(error)
print(json.dumps(out))
"""


def alone(module: str, file: Path) -> subprocess.CompletedProcess:
    """Run ALONE with the project's reader, or in a colleague's folder with the copied one."""
    copied = module != "pipeline.models"
    refused = f"{REFUSED} pipeline" if copied else REFUSED
    words = [sys.executable, "-c", ALONE, module, file, refused]
    folder = file.parent if copied else ROOT
    return subprocess.run(words, cwd=folder, capture_output=True, text=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("colleague")
    (place / READER_NAME).write_text(text := reader_source())
    assert text.count("def build(parameters") == len(kinds())  # none replaces another
    return place


@pytest.mark.parametrize("module", [READER_NAME.removesuffix(".py"), "pipeline.models"])
@pytest.mark.parametrize("kind", PARAMETERS)
def test_both_readers_need_only_numpy_and_give_the_bits_of_compiled_code(
    kind,
    module,
    folder,
    chain,
):
    file = folder / f"{kind}.json"
    write_model(file, kind, chain)
    done = alone(module, file)
    assert done.returncode == 0, done.stderr
    got = json.loads(done.stdout)
    model = load(file)
    assert got["took"] < 1.0

    q = np.array([0.3, 1.5, -0.4]) + 0.1 * np.arange(5)[:, None]
    v = np.array([0.001, -0.001, 0.01])
    assert_array_equal(got["mean"], model.mean(q, task_step=v))
    assert "\n" not in got["repr"] and got["repr"] == repr(model)
    assert_array_equal(got["covariance"], model.covariance(q, task_step=v))
    assert np.isfinite(got["density"]).all()


def test_equal_names_in_two_modules_of_the_reader_stay_apart(folder, monkeypatch):
    reader = copied_reader(folder, monkeypatch)
    for name in ("pipeline.models.joint_error.drive", "pipeline.arm.rows"):
        module = import_module(name)
        copied = reader._module(name)
        assert copied.TURN == module.TURN
    assert (
        import_module(name).TURN
        != reader._MADE["pipeline.models.joint_error.drive"].TURN
    )


def test_a_wrong_shape_and_a_singular_pose_are_named(folder, chain):
    model = load(write_model(folder / "wishart.json", "wishart", chain))
    straight = np.array([0.3, chain.straight, -0.4])

    with pytest.raises(SingularJacobianError, match="singular at 1 pose"):
        model.covariance(straight, task_step=np.zeros(3))
    with pytest.raises(ModelDomainError, match=r"q must have 3 .*\(2,\)"):
        model.mean(np.zeros(2), task_step=np.zeros(3))
    with pytest.raises(ModelDomainError, match=r"v must have 3 .*\(6,\)"):
        model.mean(np.zeros(3), task_step=np.zeros(6))


@pytest.fixture(scope="module")
def errors(folder) -> Path:
    """The exported joint error law that was fitted to runs of a known one."""
    runs = runs_of_law(known_law(), default_rng(1), motions=3)
    options = config.model_options(["joint_error_normal"])["joint_error_normal"]
    record = error_record("joint_error_normal", options, runs, "bench")
    write_export(record, folder / "errors.json")
    return folder / "errors.json"


# samples
KNOWN = 154
AHEAD = 6
COMMANDED = sweep(1)[: KNOWN + AHEAD]


@pytest.fixture(scope="module")
def off(errors) -> np.ndarray:
    """(400, KNOWN + AHEAD + 1, 2) errors in rad of drawn arms about COMMANDED."""
    model = load(errors, period=0.01)
    steps = np.diff(COMMANDED, axis=0)
    rng = default_rng(2)
    start = COMMANDED[0]
    poses = model.sample(start, start, joint_steps=steps, size=400, rng=rng)
    return poses - COMMANDED


def test_an_exported_error_law_predicts_what_its_draws_do(errors, off):
    model = load(errors)
    ahead = [model.predict(take[:KNOWN], COMMANDED, AHEAD)[0] for take in off]
    left = off[:, -1] - np.stack(ahead)
    mean, covariance = model.predict(off[0, :KNOWN], COMMANDED, AHEAD)
    std = np.sqrt(np.diag(covariance))

    assert_allclose(left.std(axis=0), std, rtol=0.15)
    # control: without the past the errors spread more
    assert np.all(off[:, -1].std(axis=0) > 1.2 * left.std(axis=0))

    density = model.log_density(off[0, :KNOWN], COMMANDED, mean)
    assert density == pytest.approx(-0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1])


def test_without_known_errors_the_law_starts_at_rest(errors):
    model = load(errors)
    resting = model.predict(np.empty((0, 2)), COMMANDED, 40)
    rest_error = model.law.mean_gain[None, :, 0]
    waiting = np.concatenate([COMMANDED[:1], COMMANDED])
    expected = model.predict(rest_error, waiting, 40)

    for of_rest, of_waiting in zip(resting, expected, strict=True):
        assert_array_equal(of_rest, of_waiting)
    assert np.all(np.diag(resting[1]) > 0)


def test_the_copied_reader_predicts_the_projects_numbers(errors, off, monkeypatch):
    reader = copied_reader(errors.parent, monkeypatch)
    # the warning's class is of the copied module, which pytest-xdist cannot import
    with pytest.warns(reader.UnconfirmedBands, match="spread of the lag"):
        copied = reader.load(errors)

    arguments = off[0, :KNOWN], COMMANDED, AHEAD
    predictions = copied.predict(*arguments), load(errors).predict(*arguments)
    for of_copy, of_project in zip(*predictions, strict=True):
        assert_array_equal(of_copy, of_project)


def test_what_the_fit_did_not_see_is_warned_of(errors, off):
    model = load(errors)
    poses = off[0, :KNOWN] + COMMANDED[:KNOWN]
    with pytest.warns(OutsideRanges, match="error of a: .* is outside the range"):
        model.predict(poses + 1.0, COMMANDED, AHEAD)

    words = r"0\.6 s ahead is beyond 0\.5 s, the longest"
    with pytest.warns(OutsideRanges, match=words):
        model.predict(off[0, :100], COMMANDED, 60)
    assert SCORED == max(HORIZONS)


def test_a_law_whose_bands_the_recordings_do_not_confirm_is_warned_of(tmp_path):
    options = config.model_options(["joint_step"])["joint_step"]
    runs = runs_of_law(known_law(), default_rng(2))
    white = tmp_path / "white.json"
    write_export(error_record("joint_step", options, runs, "bench"), white)
    words = r"σ of [ab] at 0\.5 s is .* such in record"

    with pytest.warns(UnconfirmedBands, match=words):
        load(white)


def test_histories_of_other_shapes_and_gaps_are_refused(errors, off):
    model = load(errors)
    past = off[0, :KNOWN]
    gap = past.copy()
    gap[7, 1] = np.nan

    for arguments, words in (
        ((past, COMMANDED, AHEAD + 1), "a row for each of the 154 errors"),
        ((gap, COMMANDED, AHEAD), "errors must be finite, got .* in row 7"),
        ((past, gap, AHEAD), "errors and commands must be"),
        ((past[0], COMMANDED, AHEAD), "errors and commands must be"),
    ):
        with pytest.raises(ModelDomainError, match=words):
            model.predict(*arguments)
    with pytest.raises(ModelDomainError, match="have 2 numbers"):
        rng = default_rng(1)
        model.step(off[:, 0], off, joint_step=np.zeros(6), rng=rng)


@cases("edits")
def test_an_edited_model_is_refused_with_key_and_value(
    errors,
    tmp_path,
    chain,
    law,
    old,
    new,
    words,
):
    file = write_model(tmp_path / "model.json", "gaussian", chain)
    exported = errors if law == "errors" else file
    text = json.dumps(json.loads(exported.read_text()))
    assert old in text and load(file)

    file.write_text(text.replace(old, new))
    with pytest.raises(ContractError, match=words) as caught:
        load(file)
    assert caught.value.evidence["file"] == file


def test_a_dispersion_without_a_step_is_refused(tmp_path, chain):
    file = write_model(tmp_path / "model.json", "wishart", chain)
    file.write_text(file.read_text().replace('"sigma_b": 0.25', '"sigma_b": 1e-320'))
    with pytest.raises(ContractError, match="sigma_B must be at least 1e-15"):
        load(file)


def test_another_period_and_joint_steps_for_task_steps_are_errors(tmp_path, chain):
    file = write_model(tmp_path / "model.json", "gaussian", chain)
    model = load(file, period=0.01)

    with pytest.raises(ModelDomainError, match=r"steps of 0\.01 s, not 0\.008"):
        load(file, period=0.008)
    with pytest.raises(TypeError):  # a step is named: of the task or of the joints
        model.mean(np.zeros(3), np.zeros(3))


def test_a_wishart_model_whose_step_has_no_covariance_is_not_exported(chain):
    recorded = SimpleNamespace(chain=chain)
    parameters = PARAMETERS["wishart"] | {"kind": "wishart"}

    require_covariance("wishart", parameters | {"sigma_b": 0.81}, recorded)
    with pytest.raises(ModelDomainError, match=r"0\.82 is not below 0\.816"):  # √(4/6)
        require_covariance("wishart", parameters | {"sigma_b": 0.82}, recorded)


@pytest.mark.parametrize("is_known", [True, False])
def test_the_covariance_of_a_measured_pose_is_half_of_a_steps(
    is_known,
    chain,
    monkeypatch,
):
    rng = default_rng(3)
    takes = 6
    steps = 20
    q = np.array([0.3, 1.5, -0.4]) + 0.1 * rng.standard_normal((takes, steps, 3))
    v = np.tile([1e-3, -1e-3, 1e-2], (steps, 1))
    pose = np.diag([1e-6, 4e-6, 9e-6])  # rad², of one pose; a step has two
    noise = 5e-3 * rng.standard_normal(q.shape)
    stated = 2 * pose if is_known else None
    recorded = Recorded(chain, q, v, noise, ("a", "b", "c"), stated)
    monkeypatch.setattr(command, "training_steps", lambda *_: recorded)
    monkeypatch.setattr(command, "SOURCES", [])
    motion = SimpleNamespace(rate=100.0, pose_noise=None)
    robot = SimpleNamespace(joints=["a", "b", "c"])
    dataset = SimpleNamespace(name="lab", robot=robot, motion=motion, joint_log=None)
    scale = SimpleNamespace(name="paper")
    settings = SimpleNamespace(dataset=dataset, models={}, seed=1, scale=scale)

    record = command.exported_record("additive", settings)

    if is_known:
        assert_allclose(record["pose_covariance_rad2"], pose)
    else:
        assert record["pose_covariance_rad2"] is None


PAGE = (ROOT / "pipeline/tools/export/README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def copied_reader(folder: Path, monkeypatch) -> types.ModuleType:
    """The reader in a colleague's ``folder``, as a module."""
    module = types.ModuleType("read_motion_model")
    monkeypatch.setitem(sys.modules, "read_motion_model", module)
    source = (folder / READER_NAME).read_text()
    exec(compile(source, READER_NAME, "exec"), module.__dict__)
    return module


def run_blocks(blocks: list[str], folder: Path, monkeypatch) -> dict:
    """Return the names after the README's ``blocks`` as printed, run in a colleague's folder."""
    pytest.importorskip("filterpy", reason="filterpy is missing; `make` has it")
    monkeypatch.chdir(folder)
    copied_reader(folder, monkeypatch)
    names: dict = {}
    for block in blocks:
        exec(block, names)
    return names


def error(names: dict, name: str) -> float:
    return float(np.sqrt(np.mean(np.subtract(names[name], names["path"]) ** 2)))


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("package", ["filterpy", "particles"])
def test_the_readmes_filters_of_joint_errors_are_nearer_than_measured(
    package,
    errors,
    tmp_path,
    monkeypatch,
):
    pytest.importorskip(package, reason=f"{package} is missing here")
    shutil.copy(errors, tmp_path / "model.json")
    shutil.copy(errors.parent / READER_NAME, tmp_path)
    block = BLOCKS[1 if package == "filterpy" else 2]
    names = run_blocks([BLOCKS[0], block], tmp_path, monkeypatch)
    if package == "particles":
        assert error(names, "by_particles") < 0.5 * error(names, "measured")
        return
    true = names["path"][names["known"] + names["lost"] - 1]
    camera = np.abs(names["camera"] - true).max()

    assert np.abs(names["by_kalman"] - true).max() < camera
    assert np.abs(names["predicted"] - true).max() < camera


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_readmes_filters_are_nearer_than_measured_and_its_planner_swings_out(
    folder,
    chain,
    monkeypatch,
):
    write_model(folder / "model.json", "wishart", chain, speed=0.1)
    names = run_blocks(BLOCKS[3:], folder, monkeypatch)
    assert len(BLOCKS) == 7 and len(names["by_ukf"]) == 60

    measured = error(names, "measured")
    assert 0.004 < measured < 0.006
    assert max(error(names, "by_ukf"), error(names, "by_particles")) < 0.7 * measured
    # the swing is less uncertain than the straight way and than one to the other side
    best = names["best"]
    cost = names["variance"]
    assert abs(best) > 0.002 and cost(best) < min(cost(0.0), cost(-best))
