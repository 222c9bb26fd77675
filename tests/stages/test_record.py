"""The synthetic arm in space, from nothing to measured joint angles, held against the truth."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from joint_logs import ROOT
from omegaconf import OmegaConf

from pipeline.configuration import config
from pipeline.core import contracts
from pipeline.core.columns import values
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.stages import ingest, record, track

cases = cases_beside(__file__)
RECORDINGS = Path("data/raw/lwr4_lab/recordings")


def choose(**overrides) -> None:
    params = OmegaConf.load(ROOT / "params.yaml")
    scale = {"training_takes": 3, "test_takes": 2}
    params.update({"dataset": "lwr4_lab", "scale": "smoke", "compute": "serial"})
    params.update({"overrides": {"scale": scale} | overrides})
    OmegaConf.save(params, "params.yaml")
    config.write_config(Path("params.yaml"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A project whose laboratory has recorded the arm; read only."""
    folder = tmp_path_factory.mktemp("recorded")
    for name in ("pipeline", "dvc.yaml"):
        (folder / name).symlink_to(ROOT / name)
    for name in ("lwr4_lab", "youbot"):
        (folder / "data/raw" / name).mkdir(parents=True)
        shutil.copy(ROOT / f"data/raw/{name}/dvc.yaml", folder / f"data/raw/{name}")

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        choose()
        record.run("lwr4_lab")
    return folder


@pytest.fixture(autouse=True)
def project(recorded, tmp_path, monkeypatch) -> None:
    """A copy of it as the current folder."""
    shutil.copytree(recorded, tmp_path / "project", symlinks=True)
    monkeypatch.chdir(tmp_path / "project")


def tracked() -> np.ndarray:
    """(takes, M+1, 7) rad: measured minus true angles."""
    ingest.run("motion")
    track.run()
    measured = contracts.read("joints", Path("data/track"))
    true = contracts.read("true_joints", RECORDINGS.parent / "truth")
    measured, true = (table.sort_values(["take", "k"]) for table in (measured, true))
    return (values(measured, "q") - values(true, "q")).reshape(-1, 321, 7)


def test_angles_are_measured_as_well_as_their_noise_lets_them():
    errors = tracked()
    assert errors.shape == (5, 321, 7)

    # the arm rests for 0.3 s at the start: what changes then is the noise of the bodies
    noise = errors[:, :28].std(axis=1)
    assert noise.max() < 1e-3
    # misplaced markers and misbuilt links are there, and the same in every take
    assert 1e-4 < np.abs(errors.mean(axis=(0, 1))).max() < 0.02
    assert np.abs(errors.mean(axis=1) - errors.mean(axis=(0, 1))).max() < 1e-3

    quality = contracts.read("quality", Path("data/track")).groupby("quantity")["value"]
    assert quality.mean()["residual_rms"] < 1e-3
    assert quality.sum()[["interpolated", "rejected"]].sum() == 0
    trajectory = contracts.read("trajectory", Path("data/ingest/motion"))
    assert values(trajectory, "v").shape == (321, 6) and values(
        trajectory,
        "u",
    ).shape == (321, 7)
    noise = values(contracts.read("process_noise", Path("data/track")), "w")
    assert noise.shape == (3 * 320, 7) and 1e-4 < noise.std() < 1e-2


@pytest.mark.slow
def test_takes_beyond_a_limit_are_left_out_and_named_and_the_others_stay(capsys):
    choose(dataset={"limits": {"longest_gap": 20}})
    tracked()
    takes, before = (contracts.read(name, track.OUT) for name in ("takes", "joints"))
    assert not takes["left_out"].any() and takes["limit"].notna().any()

    markers = contracts.read("markers", track.MOTION)
    # a gap of 41 frames would also be beyond missing_share, and the interpolated path disturbed
    gap = (markers["take"] == "train_001") & markers["k"].between(50, 74)
    markers.loc[gap, ["x", "y", "z"]] = np.nan
    contracts.write(markers, "markers", track.MOTION)
    track.run()
    printed = capsys.readouterr().out
    assert "1 of 5 takes left out: train_001 (longest_gap 25 beyond 20)\n" in printed
    assert {*contracts.read("takes", track.OUT).query("left_out")["take"]} == {
        "train_001",
    }
    stay = before[before["take"] != "train_001"].reset_index(drop=True)
    pd.testing.assert_frame_equal(contracts.read("joints", track.OUT), stay)


@pytest.mark.slow
def test_a_perfect_arm_is_measured_to_the_digits_of_its_files():
    names = {"dynamics": ["length_std", "encoder_offset_std", "jitter_std"]}
    names["mocap"] = ["noise_std", "placement_std"]
    perfect = {}
    for section, options in names.items():
        perfect[section] = dict.fromkeys(options, 0.0)
    choose(dataset={"laboratory": perfect})
    record.run("lwr4_lab")

    # Motive prints micrometres
    assert np.abs(tracked()).max() < 5e-5


@cases("refused")
def test_what_does_not_fit_the_arm_is_refused_with_one_message(mocap, words):
    choose(dataset={"mocap": mocap})
    with pytest.raises((ConfigError, RecordingError), match=words):
        if "markers" in mocap:
            record.run("lwr4_lab")
        else:
            tracked()


def test_recordings_of_a_dataset_that_is_not_analysed_stay_as_they_are(capsys):
    marker = Path("data/raw/youbot/recordings/kept")
    marker.parent.mkdir(parents=True)
    marker.touch()
    record.run("youbot")

    assert marker.exists() and "set dataset: youbot" in capsys.readouterr().out
