"""Raw files by part, recordings by name, takes beside their limits: each is read, kept, left out or
accounted for.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from case_tables import cases_beside
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from planar_poses import load_arm
from sample_options import parameters

from pipeline.configuration import config
from pipeline.core.columns import spread, values
from pipeline.core.errors import ConfigError, RecordingError
from pipeline.core.options.dataset import Dataset, Limits
from pipeline.recordings import inventory
from pipeline.recordings.paths import MOST_ROWS, take_paths
from pipeline.recordings.quality import (
    account,
    beside_limits,
    beside_others,
    disturbances,
    quality_row,
    reasons,
    require_enough,
)

cases = cases_beside(__file__)


def measured(
    quantity: str,
    values: dict[str, float],
    part: str = "training",
    unit: str = "m",
):
    """A value of the ``quantity`` of each take."""
    rows = []
    for take, value in values.items():
        rows.append(quality_row(take, part, "joint log", quantity, value, unit))
    return pd.DataFrame(rows)


def test_a_take_beyond_a_limit_is_left_out_whole_and_one_at_the_limit_or_without_stays():
    residual = measured("residual_rms", {"a": 1e-3, "b": 1.001e-3, "c": 2e-4})
    takes = beside_limits(residual, {"residual_rms": 1e-3})

    assert takes["take"].tolist() == ["a", "b", "c"]
    assert takes["left_out"].tolist() == [False, True, False]
    assert reasons(takes) == ["b (residual_rms 0.001 beyond 0.001)"]
    for limits in ({}, vars(Limits())):
        assert not beside_limits(residual, limits)["left_out"].any()


def test_copies_are_left_out_with_their_number():
    ratio = measured("likeness", {"a": 9.0, "b": 9.0, "c": 1.0}, unit="1")
    size = measured("alike_takes", {"a": 2.0, "b": 2.0, "c": 1.0}, unit="takes")
    takes = beside_limits(pd.concat([ratio, size]), {"likeness": 3.5})
    words = "likeness 9 beyond 3.5, 2 takes are copies of one"

    assert reasons(takes) == [f"a ({words})", f"b ({words})"]


def test_a_clock_may_drift_to_neither_side_and_a_less_disturbed_take_stays():
    drift = measured("clock_drift", {"a": -0.05, "b": 0.01}, unit="s/s")
    disturbance = measured("disturbance", {"a": -7.0, "b": 5.0})
    no_measure = measured("cut_rows", {"a": 9.0})
    limits = {"clock_drift": 0.02, "disturbance": 6.0}
    takes = beside_limits(pd.concat([drift, disturbance, no_measure]), limits)
    rows = takes[["take", "measure", "beyond", "left_out"]].to_numpy().tolist()

    assert rows == [
        ["a", "clock_drift", True, True],
        ["a", "disturbance", False, True],
        ["b", "clock_drift", False, False],
        ["b", "disturbance", False, False],
    ]


def test_fewer_than_two_takes_of_a_part_are_refused_by_the_limits_name():
    parts = {"training": {"a": 1e-4, "b": 1e-4}, "test": {"c": 5e-3, "d": 1e-4}}
    by_part = [measured("residual_rms", takes, part) for part, takes in parts.items()]
    rows = pd.concat(by_part)
    words = r"1 test take\(s\), 2 are.* c \(residual_rms 0.005.*dataset\.limits\.residual_rms"
    with pytest.raises(RecordingError, match=words):
        require_enough(beside_limits(rows, {"residual_rms": 1e-3}))
    require_enough(beside_limits(rows, {"residual_rms": 1e-2}))

    # a single take that no limit leaves out is for others to judge
    single = measured("residual_rms", {"a": 1e-4})
    require_enough(beside_limits(single, {"residual_rms": 1e-3}))


FRAME = "kinect/test_001/depth/0.png"
FILES = {
    "motion": ["trajectory.csv", "optitrack/train_001.csv", "optitrack/test_001.csv"],
    "depth": ["kinect/intrinsics.yaml", "kinect/test_001/depth.txt", FRAME],
    "force": ["force/C1.csv", "force/C2.csv", "force/C3.csv"],
}
UNCLAIMED = "notes/setup.txt"


@pytest.fixture
def recordings(tmp_path, monkeypatch, dataset) -> Path:
    """The raw files of a youBot session, and a note that no pattern of its datasheet names."""
    monkeypatch.chdir(tmp_path)
    folder = Path(dataset.recordings)
    for name in sum(FILES.values(), [UNCLAIMED]):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    return folder


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return config.compose_config(parameters(tmp_path)).dataset


def test_each_part_has_the_files_that_its_patterns_name_and_what_none_names(
    recordings,
    dataset,
):
    parts = inventory.by_part(inventory.listing(recordings), dataset)
    assert [*parts] == [*inventory.KEYS]
    for part, named in FILES.items():
        assert set(parts[part]["file"]) == {*named, UNCLAIMED}

    dataset.depth.takes = "/absolute/*"
    with pytest.raises(ConfigError) as refused:
        inventory.by_part(inventory.listing(recordings), dataset)
    assert refused.value.evidence["key"] == "dataset.depth.takes"


def test_a_listing_tells_a_change_that_keeps_the_size_and_needs_a_file(
    recordings,
    tmp_path,
):
    before = inventory.listing(recordings).set_index("file")
    (recordings / UNCLAIMED).write_text(UNCLAIMED[::-1])

    after = inventory.listing(recordings).set_index("file")

    assert list(before.index[(before != after).any(axis=1)]) == [UNCLAIMED]
    assert (before["bytes"] == after["bytes"]).all()
    with pytest.raises(RecordingError, match="no recordings") as refused:
        inventory.listing(tmp_path / "nowhere")
    assert refused.value.evidence["file"] == tmp_path / "nowhere"


def test_evidence_of_other_files_is_named_by_their_place(recordings, tmp_path):
    table = tmp_path / "inventory.csv"
    evidence = inventory.by_place(inventory.listing(recordings))
    places = ["force", "kinect", "notes", "optitrack", "trajectory.csv"]

    assert evidence["place"].tolist() == places
    assert inventory.other_files(evidence, table) == ""

    inventory.listing(recordings).to_csv(table, index=False)
    assert inventory.other_files(evidence, table) == ""
    assert "does not name its raw files" in inventory.other_files(None, table)

    (recordings / "kinect/test_001/depth/0.png").write_text("another image")
    (recordings / "more.csv").write_text("")
    inventory.listing(recordings).to_csv(table, index=False)
    assert inventory.other_files(evidence, table).endswith("lists: kinect, more.csv")


@pytest.mark.parametrize("name", ["run_\x1b[31m.csv", "run_\n.csv", "run_\udcff.csv"])
def test_a_name_that_cannot_be_printed_is_refused_without_its_signs(tmp_path, name):
    (tmp_path / name).write_text("")
    with pytest.raises(RecordingError, match="control character") as refused:
        inventory.named_takes(tmp_path, "run_*.csv", key="KEY")
    assert str(refused.value.evidence["file"]).isascii()
    assert str(refused.value).isprintable()


@cases("names")
def test_a_name_is_the_part_of_the_path_that_the_pattern_leaves_open(
    pattern,
    path,
    name,
):
    assert inventory.take_name(Path("raw", path), Path("raw"), pattern) == name


NAMES = ["a/1.csv", "a/2.csv", "LICENSE", "old/3.csv", "old/4.csv"]
FOUND = [
    pd.DataFrame({"file": files}) for files in (NAMES, [*NAMES[2:], "depth/0.png"])
]


def test_each_step_says_what_it_found_kept_and_left_out():
    movements = {
        "repetitions": {"a": 2, "b": 0},
        "excursions_cut_off": {"a": 1, "b": 1},
        "excursions_other_motion": {"a": 3, "b": 0},
    }
    quality = [measured(name, n, unit="count") for name, n in movements.items()]
    quality.append(measured("disturbance", {"a_1": 7.0, "a_2": 0.5}))
    quality = pd.concat(quality, ignore_index=True)

    table = account(FOUND, quality, beside_limits(quality, {"disturbance": 6.0}))

    assert table.to_numpy().tolist() == [
        ["files", "all", 6, 3, "LICENSE, old (2)"],
        ["motions", "a", 6, 2, "cut off 1, other motion 3"],
        ["motions", "b", 1, 0, "cut off 1"],
        ["takes", "training", 2, 1, "a_1 (disturbance 7 beyond 6)"],
    ]


# 1/s; robust standard deviations
LOGGED = 125.0
LIMIT = 6.0
PUSH = np.sin(np.pi * (np.arange(31) + 0.5) / 31)  # a quarter of a second


def residuals(takes: int, rng: np.random.Generator) -> np.ndarray:
    """A lag that all takes share, and noise of heavy tails of 50 µrad, as it was found on real
    arms.
    """
    common = 6e-4 * np.sin(np.linspace(0, np.pi, 300))[:, None] * [1.0, -0.5, 0.3]
    return common + rng.standard_t(4, (takes, 300, 3)) * 50e-6 / np.sqrt(2)


def pushed(
    rows: np.ndarray,
    height: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, int]:
    """``rows`` with a push in one place of one joint of one take, and that take."""
    takes, length, joints = rows.shape
    take = int(rng.integers(takes))
    start = int(rng.integers(length - len(PUSH)))
    joint = int(rng.integers(joints))

    signed = height * rng.choice([-1, 1])
    rows[take, start : start + len(PUSH), joint] += signed * PUSH
    return rows, take


def scores(rows: np.ndarray) -> np.ndarray:
    return disturbances(rows, LOGGED)


@pytest.mark.parametrize("takes", [3, 4, 7, 20])
def test_a_push_at_one_repetition_stands_out_and_none_does_without(takes):
    rng = default_rng(takes)
    greatest = [scores(residuals(takes, rng)).max() for _ in range(100)]
    false_alarms = [score for score in greatest if score > LIMIT]
    assert len(false_alarms) <= 1

    every_take = np.full(takes, True)
    for _ in range(30):
        rows, take = pushed(residuals(takes, rng), 2e-3, rng)
        disturbed = np.flatnonzero(scores(rows) > LIMIT)
        assert disturbed.tolist() == [take]
        assert beside_others(rows, every_take)[take] > 1e-4


def test_what_all_repetitions_share_is_no_disturbance():
    apart = residuals(6, default_rng(3))
    course = 5e-3 * np.linspace(-1, 1, 300)
    assert_allclose(scores(apart + course[:, None]), scores(apart), rtol=1e-7)


def test_of_two_repetitions_and_of_repetitions_at_rest_none_is_disturbed():
    pair = residuals(2, default_rng(4))
    pair[0, 100:150] += 0.01

    assert_allclose(scores(pair), 0, atol=1e-9)
    assert scores(np.zeros((3, 10, 3))).tolist() == [0, 0, 0]


def test_the_paths_of_takes_have_the_tips_course_and_why_a_take_is_left_out():
    joints = ["joint_2", "joint_3", "joint_4"]
    chain = load_arm("pipeline/arm/ur5.urdf", joints, "wrist_centre", {}).chain
    steps = np.arange(MOST_ROWS + 1)
    end = np.array([-2.1, -1.9, 0]) + MOST_ROWS * np.array([-1e-3, 1e-3, 0])
    angles = np.linspace([-2.1, -1.9, 0], end, MOST_ROWS + 1)

    rows = pd.DataFrame({"part": "training", "k": steps, "t": steps / 100})
    rows = rows.assign(**spread("q", joints, angles), residual=np.nan)
    logs = pd.concat([rows.assign(take="pushed"), rows.assign(take="sound")])
    measures = measured("disturbance", {"pushed": 9.0, "sound": 0.5})

    paths = take_paths(logs, beside_limits(measures, {"disturbance": 6.0}), chain)

    by_take = dict(list(paths.groupby("take")))
    pushed = by_take["pushed"]
    sound = by_take["sound"]
    assert len(pushed) == len(sound) == 101
    assert set(pushed["reason"]) == {"disturbance 9 beyond 6"}
    assert set(sound["reason"]) == {""}
    assert pushed["left_out"].all() and not sound["left_out"].any()
    assert_array_equal(values(sound, "x"), chain.coordinates(angles[::2]))
