"""From the raw logs of a real arm of seven joints to the tables: its traps are found, refused where
they are not settled, and what is left is the arm's.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_logs import ROOT, ingested, quality
from omegaconf import OmegaConf

from pipeline.core import contracts, datasheet
from pipeline.core.columns import members, values
from pipeline.core.errors import RecordingError
from pipeline.stages import ingest, track
from pipeline.tools.inspect.command import inspect

TAKES = [f"measurements_{file}_{number}" for file in (1, 2) for number in (1, 2)]


@pytest.fixture(scope="session")
def lwr4() -> Path:
    folder = ROOT / OmegaConf.load(datasheet.path_of("lwr4")).recordings
    if not folder.is_dir():
        pytest.skip(f"the LWR4+'s recordings are not at {folder}")
    return folder.resolve()


@pytest.mark.parametrize("number", [1, 2])
def test_inspect_finds_what_the_datasheet_settles(lwr4, number):
    name = f"measurements_{number}"
    (finding,) = inspect(lwr4 / f"{name}.npz")
    stated = OmegaConf.load(datasheet.path_of("lwr4")).joint_log
    settings = finding.facts["settings"]
    assert settings.pop("rest") == "0" and settings.pop("clock") == stated.clock
    assert {key: float(settings[key]) for key in ("target_factor", "target_delay")} == {
        "target_factor": stated.target_factor,
        "target_delay": stated.target_delay[name],
    }
    assert not finding.stops and finding.facts["joints"] == len(stated.joints)


@pytest.mark.parametrize(
    ("unsettled", "words"),
    [
        ({"clock": None}, "rows are uneven"),
        ({"target_factor": 1.0}, "no pair.*target_factor: 57.29577951308232"),
        ({"target_delay": 0.0}, "no pair.*target_delay: 1.405"),
    ],
)
def test_each_trap_is_refused_where_no_option_settles_it(lwr4, log_project, unsettled, words):
    log_project("lwr4", lwr4, joint_log=unsettled)
    with pytest.raises(RecordingError, match=words):
        ingest.run("motion")
    assert not list(Path("data/ingest").iterdir())


def test_a_delay_that_is_off_by_rows_is_reported_as_the_arm_s_lag(lwr4, log_project):
    log_project("lwr4", lwr4, joint_log={"target_delay": 1.4})
    ingest.run("motion")
    lags = [1e3 * quality("lag_behind_command", take) for take in TAKES]
    np.testing.assert_allclose(lags, [5.4, 5.4, 12.1, 12.1], atol=0.3)


def test_the_real_logs_go_from_raw_files_to_process_noise(lwr4, log_project):
    log_project("lwr4", lwr4)
    ingest.run("motion")
    names, q = ingested()
    assert names == TAKES and q.shape == (4, 1101, 7)
    # the second repetition starts between two rows, and its command is the same to a nanoradian
    assert all(quality("command_deviation", take) < 1e-9 for take in names)
    # what is left of the delays is the arm's: as was found on these recordings, 0.4 and 2.1 ms
    lags = [1e3 * quality("lag_behind_command", take) for take in names]
    np.testing.assert_allclose(lags, [0.4, 0.4, 2.1, 2.1], atol=0.15)
    assert quality("uneven_rows", "measurements") == 19
    trajectory = contracts.read("trajectory", Path("data/ingest/motion"))
    speeds = values(trajectory, "u")[:-1]
    np.testing.assert_allclose(speeds, np.diff(q.mean(axis=0), axis=0) * 200, atol=0.02)
    assert len(members(trajectory, "v")) == 6
    resampled = [quality("resampled_rows", take) for take in names]
    assert resampled == [0, 1101, 0, 1101]
    track.run()
    _, w = contracts.stacked(contracts.read("process_noise", Path("data/track")), "w")
    varying = (w - w.mean(axis=0)) * np.sqrt(4 / 3)
    spread = np.sqrt(np.mean(varying**2, axis=(0, 1)))
    assert np.all(spread > 3e-6) and np.all(spread < 15e-6)
