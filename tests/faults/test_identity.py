"""Recordings that are not what their name says are refused, named or left out; sound ones pass."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_array_equal

from pipeline.arm.model import arm_of
from pipeline.core.columns import spread
from pipeline.core.errors import RecordingError
from pipeline.core.options.dataset import Arrangement, Force, Limits
from pipeline.formats.force.record import ForceRecord, sound_samples
from pipeline.formats.motion.motive import read_motive, write_motive
from pipeline.recordings.depth_takes import OTHERS, bias_warning, camera_residuals
from pipeline.recordings.ingest import read_part
from pipeline.recordings.quality import (
    WITHIN,
    compare_takes,
    disturbances,
    lags_beside_others,
    likeness,
    require_distinct,
    residual_share,
)
from pipeline.wrench.measured_force import require_own_configuration

TRAIN = "train_001"
TEST = "test_001"
LIMITS = Limits()


@pytest.fixture
def folder(benches, dataset, tmp_path):
    """A training and a test take, different in noise, and their dataset."""
    (tmp_path / "optitrack").mkdir()
    source = tmp_path / "source.csv"
    source.write_bytes(benches["take"].files["optitrack/test_001.csv"])

    rng = default_rng(4)
    sound = read_motive(source)
    for name in (TRAIN, TEST):
        markers = {}
        for marker, xyz in sound.markers.items():
            markers[marker] = xyz + rng.normal(0, 5e-5, xyz.shape)
        take = replace(sound, name=name, markers=markers)
        file = tmp_path / f"optitrack/{name}.csv"
        write_motive(file, take, start="2017-05-02 10.00.00.000 AM")

    mocap = replace(dataset.mocap, training="optitrack/train*", test="optitrack/test*")
    sections = {"trajectory": None, "depth": None, "force": None, "mocap": mocap}
    return replace(dataset, recordings=str(tmp_path), **sections)


def ingest(dataset, tmp_path) -> dict[str, dict[str, float]]:
    """Take → counts of the part motion."""
    (tmp_path / "out").mkdir()
    quality = read_part("motion", dataset, SimpleNamespace(), tmp_path / "out")

    counts: dict[str, dict[str, float]] = {}
    for row in quality:
        of_take = counts.setdefault(row["take"], {})
        of_take[row["quantity"]] = row["value"]
    return counts


def exported_again(content: bytes) -> bytes:
    return content.replace(b"\r\n", b"\n").replace(b"Version,1.23", b"Version,1.24")


@pytest.mark.parametrize("change", [bytes, exported_again])
@pytest.mark.parametrize("copy", [TEST, "train_002"])
def test_a_copy_of_a_take_is_refused_with_both_names(folder, tmp_path, change, copy):
    content = (tmp_path / f"optitrack/{TRAIN}.csv").read_bytes()
    renamed = change(content).replace(TRAIN.encode(), copy.encode())
    (tmp_path / f"optitrack/{copy}.csv").write_bytes(renamed)
    words = "have equal samples: one is a copy"

    with pytest.raises(RecordingError, match=words) as refused:
        ingest(folder, tmp_path)
    assert TRAIN in refused.value.message and copy in refused.value.message


def test_rounded_samples_are_equal_and_noise_is_not():
    first, second = default_rng(1).normal(size=(2, 50, 3))
    first[3] = np.nan
    distinct = {"a": first, "b": first + 1e-4, "c": second, "d": first[:40]}

    require_distinct("takes", distinct)
    with pytest.raises(RecordingError, match="a and b have equal samples"):
        require_distinct("takes", distinct | {"b": first.round(6)})


def test_a_header_that_names_another_take_is_counted_or_refused(
    folder,
    tmp_path,
    capsys,
):
    file = tmp_path / f"optitrack/{TRAIN}.csv"
    content = file.read_bytes()
    file.write_bytes(content.replace(TRAIN.encode(), b"Take 2017-05-02"))
    counts = ingest(folder, tmp_path)
    assert counts[TRAIN]["named_otherwise"] == 1
    assert "named_otherwise" not in counts[TEST]
    assert "the take is 'Take 2017-05-02' by its header" in capsys.readouterr().out

    file.write_bytes(content.replace(TRAIN.encode(), TEST.encode()))
    (tmp_path / "out").rename(tmp_path / "before")
    with pytest.raises(RecordingError, match="another file has this name") as refused:
        ingest(folder, tmp_path)
    assert refused.value.evidence["file"] == file


def test_a_late_take_has_a_lag_beyond_the_limit_and_others_have_not(motion):
    rng = default_rng(2)
    time = np.arange(160) / 100
    starts = rng.normal(0, 0.0015, 8)
    takes = np.array([motion(time + start) for start in starts])
    takes += rng.normal(0, 1e-3, takes.shape)
    lags = lags_beside_others(takes, 100.0)
    assert np.abs(lags).max() < LIMITS.lag_beside_others / 2

    takes[-1] = motion(time - 0.08)
    takes[0, 40:60] = np.nan  # lost
    lags = lags_beside_others(takes, 100.0)

    assert lags[-1] == pytest.approx(0.08, abs=0.005)
    assert np.abs(lags[:-1]).max() < LIMITS.lag_beside_others < lags[-1]


def drifted(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    drift = np.linspace(0.01, 0.02, len(q))
    return 1.01 * q + drift[:, None]


def with_noise_of_a_quantum(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return q + rng.uniform(-2e-4, 2e-4, q.shape)


def between_rows(q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    middles = (q[1:] + q[:-1]) / 2
    return np.concatenate([middles, q[-1:]])


DISGUISES = {
    "drift": [drifted],
    "quantum": [with_noise_of_a_quantum],
    "rows": [between_rows],
    "one joint": [],
    "all": [drifted, with_noise_of_a_quantum, between_rows],
}


def swaying_takes(takes: int, motion, rng: np.random.Generator) -> np.ndarray:
    """Angles (takes, 320, 4) in rad: each take sways in its own way, with jitter and noise; a joint
    at rest has two values.
    """
    time = np.arange(320) / 100
    changes = rng.random((takes, 320, 4)) < 0.003
    q = 1e-4 * (changes.cumsum(axis=1) % 2)
    for take in q:
        frequencies = rng.uniform(2, 10, 6)[:, None]
        phases = rng.uniform(0, 6, (3, 6, 1))
        late = time + rng.normal(0, 1e-3, 320)
        waves = np.sin(frequencies * time + phases)
        sway = 0.002 * waves.sum(axis=1).T
        noise = rng.normal(0, 1e-4, (320, 3))
        take[:, :3] = motion(late) + sway + noise
    return q


@pytest.mark.parametrize("disguise", DISGUISES)
@pytest.mark.parametrize("takes", [4, 40])
def test_a_copied_take_is_beyond_the_limit_also_disguised_and_sound_takes_are_not(
    motion,
    takes,
    disguise,
):
    rng = default_rng(takes)
    q = swaying_takes(takes, motion, rng)
    assert likeness(q).ratio.max() < LIMITS.likeness / 1.5

    joints = slice(1, 2) if disguise == "one joint" else slice(4)
    copy = q[0, :, joints]
    for change in DISGUISES[disguise]:
        copy = change(copy, rng)
    q[2, :, joints] = copy
    alike = likeness(q)

    assert np.flatnonzero(alike.ratio > LIMITS.likeness).tolist() == [0, 2]
    assert alike.size[[0, 2]].tolist() == [2, 2]
    # the control: two takes without the copy
    assert likeness(q[:2]).size[0] == 1


@pytest.mark.parametrize("noise", [2e-4, 1e-3])  # rad
@pytest.mark.parametrize(
    ("takes", "groups"),
    [(12, [6]), (12, [8]), (60, [11, 11]), (60, [40])],
)
def test_groups_of_noisy_copies_are_found_whatever_their_number(
    motion,
    takes,
    groups,
    noise,
):
    rng = default_rng(takes)
    q = swaying_takes(takes, motion, rng)
    sizes = np.ones(takes)
    first = 0
    for size in groups:
        group = slice(first, first + size)
        q[group] = q[first] + rng.normal(0, noise, q[group].shape)
        sizes[group] = size
        first = first + size

    alike = likeness(q)

    assert_array_equal(alike.size, sizes)
    assert_array_equal(alike.ratio > LIMITS.likeness, sizes > 1)

    # the copies count once where a take is held against the usual one: no sound take is disturbed
    measures = compare_takes(q, q, 100.0, LIMITS.likeness)
    assert measures["disturbance"][0][sizes == 1].max() < LIMITS.disturbance


@pytest.mark.parametrize("pushed", [0, 1, 2])
def test_an_arm_that_repeats_within_its_noise_has_disturbed_takes_and_no_copies(
    motion,
    pushed,
):
    """All takes are equal within the noise: the likeness cannot be seen, and is not beyond."""
    rng = default_rng(pushed)
    time = np.arange(320) / 100
    q = motion(time) + rng.normal(0, 1e-4, (10, 320, 3))
    push = 3e-3 * np.sin(np.linspace(0, np.pi, 30))
    for take in range(pushed):
        first = 60 + 90 * take
        q[take, first : first + 30, 1] += push
    measures = compare_takes(q, q, 100.0, LIMITS.likeness)
    assert measures["likeness"][0].max() < LIMITS.likeness

    beyond = measures["disturbance"][0] > LIMITS.disturbance
    assert np.flatnonzero(beyond).tolist() == [*range(pushed)]
    assert (measures["nearest_take"][0][pushed:] < WITHIN).all()


@pytest.mark.parametrize("takes", [15, 60])
def test_a_take_of_three_times_the_deviation_is_disturbed_and_sound_ones_are_not(
    motion,
    takes,
):
    """A take that hardly deviates is not found, as three times its deviation is a usual one."""
    rng = default_rng(takes)
    times_found = 0
    for _ in range(10):
        q = swaying_takes(takes, motion, rng)
        sound = disturbances(q, 100.0)
        assert sound.max() < LIMITS.disturbance

        q[4] += 2 * (q[4] - q.mean(axis=0))
        scores = disturbances(q, 100.0)
        beyond = np.flatnonzero(scores > LIMITS.disturbance).tolist()
        assert beyond in ([], [4])
        times_found += len(beyond)
    assert times_found >= 9


@pytest.mark.parametrize(
    ("factor", "warned"),
    [(1.0, False), (1.05, True), (0.95, True)],
)
def test_a_wrong_focal_length_gives_a_warning_with_its_mean_error(
    benches,
    dataset,
    motion,
    factor,
    warned,
):
    bench = benches["depth"]
    name = "kinect/intrinsics.yaml"
    sound = bench.files[name]
    focal = re.search(rb"data: \[ *([0-9.]+)", sound)[1]
    longer = str(float(focal) * factor).encode()

    _, recovered = bench.outcome({**bench.files, name: sound.replace(focal, longer, 1)})

    error = recovered.q - motion(recovered.time)
    errors = pd.DataFrame(spread("e", dataset.robot.joints, error))
    warning = bias_warning(errors)
    assert bool(warning) == warned == ("rad off the motion capture" in warning)
    with pytest.raises(RecordingError, match="mirrored"):
        # rad, the least of the joints' for such images
        bias_warning(errors - 0.45)


SEEN_AT = np.arange(5, 175, 3) / 100  # s


@pytest.fixture(scope="module")
def swaying_joints(motion, dataset) -> list[pd.DataFrame]:
    """Joint angles of takes that sway each in its own way, by some tenths of a degree."""
    rng = default_rng(3)
    time = np.arange(181) / 100
    joints = []
    for number in range(OTHERS + 2):
        frequencies = rng.uniform(4, 20, 8)[:, None]
        phases = rng.uniform(0, 6, (3, 8, 1))
        waves = np.sin(frequencies * time + phases)
        q = motion(time) + 0.003 * waves.sum(axis=1).T

        rows = pd.DataFrame({"take": number, "t": time, "residual": 0.0})
        joints.append(rows.assign(**spread("q", dataset.robot.joints, q)))
    return joints


def test_images_of_another_take_have_a_share_beyond_the_limit(swaying_joints, dataset):
    arm = arm_of(dataset.robot)
    rng = default_rng(4)

    def share(images: int, name: int, noise: float) -> float:
        """The share of a take ``name`` whose images are of the take ``images``."""
        filmed = swaying_joints[images]
        nodes = arm.chain.points(filmed.filter(like="q").to_numpy())
        middle = nodes[:, 1:].mean(axis=1)
        seen = rng.normal(0, noise, (len(SEEN_AT), 2))
        for axis in (0, 1):
            seen[:, axis] += np.interp(SEEN_AT, filmed["t"], middle[:, axis])

        order = swaying_joints.copy()
        order.insert(0, order.pop(name))
        residuals = camera_residuals((SEEN_AT, seen), order, arm, (-0.2, 0.2))
        return residual_share(seen, residuals[0], residuals[1:])

    limit = LIMITS.camera_residual_share
    right = [share(n, n, 3e-4) for n in range(6)]
    foreign = np.array([share(n, n + 1, 3e-4) for n in range(6)])

    assert max(right) < limit
    # 24 of 24 in the laboratory
    assert foreign.min() > 0.65 and np.mean(foreign > limit) > 0.8
    # takes that differ by less than the noise cannot be told apart, and are kept
    assert share(0, 1, 0.02) < limit


def cut(values: np.ndarray, at: float) -> ForceRecord:
    force = values.copy()
    force[:, 0] = np.minimum(force[:, 0], at)
    time = np.arange(len(force)) / 500
    return ForceRecord(time, force, np.full_like(force, np.nan), 500.0, "", "", {})


def test_a_plateau_of_equal_greatest_forces_is_saturation_wherever_it_lies():
    values = default_rng(5).normal([20, 1, 2], [5, 0.1, 0.1], (2000, 3))
    scale = np.array([32.0, 32.0, 100.0])
    rules = {"longest": 0.5, "share": 0.5, "file": "log.csv"}
    below = values[:, 0] < 26

    sound, counts = sound_samples(cut(values, 26.0), scale, **rules)

    assert counts == {"saturated_samples": (~below).sum()}
    assert_array_equal(sound, below)
    with pytest.raises(RecordingError, match="are saturated"):
        sound_samples(cut(values, 26.0), None, 0.5, 0.01, file="log.csv")
    # neither noise nor a coarse resolution is one
    for sound in (values, values.round(0), np.clip(values.round(1), -np.inf, 33)):
        assert sound_samples(cut(sound, 31.9), None, **rules)[1] == {}


ANYWHERE = (0.0, 6.3)  # rad
ARRANGED = {
    "C1": Arrangement("C1.csv", [0.15, 3.7, 1.6], [9.19, 6.92, 7.3], ANYWHERE),
    "C2": Arrangement("C2.csv", [1.1, 5.8, 2.5], [4.65, 7.75, 7.45], ANYWHERE),
    "C3": Arrangement("C3.csv", [0.15, 1.6], [9.0, 7.0], ANYWHERE),
}
FORCE = Force(
    tare=5.0,
    tension_std=[0.48, 1.2, 2.27],
    kappa_bounds=(169.35, 2416.0),
    tension_std_bounds=(0.48, 2.27),
    tension_bounds=(1.82, 13.89),
    configurations=ARRANGED,
)


@pytest.fixture
def forces() -> dict[str, np.ndarray]:
    """Configuration → recorded forces (3000, 2) in N."""
    rng = default_rng(6)
    records = {}
    for name, arranged in FORCE.configurations.items():
        robots = len(arranged.direction)
        size = 3000, robots
        turns = rng.normal(arranged.direction, 600**-0.5, size)
        pulls = rng.normal(arranged.tension, FORCE.tension_std[:robots], size)

        x = np.vecdot(pulls, np.cos(turns))
        y = np.vecdot(pulls, np.sin(turns))
        records[name] = np.stack([x, y], axis=1)
    return records


def check_forces(records: dict[str, np.ndarray]) -> None:
    tables = []
    for name, record in records.items():
        table = pd.DataFrame(record, columns=["fx", "fy"])
        tables.append(table.assign(configuration=name))
    require_own_configuration(pd.concat(tables), FORCE)


@pytest.mark.parametrize("pair", [("C1", "C2"), ("C2", "C3")])  # C1 and C2: equal means
def test_a_record_of_another_configuration_is_refused_by_its_name(forces, pair):
    check_forces(forces)
    first, second = pair
    words = f"nats from {first} .* from {second}.*exchanged"

    with pytest.raises(RecordingError, match=words):
        check_forces({**forces, first: forces[second]})


MEAN = np.array([3.0, 5.0])  # N, desired force of C1
CONTRADICTIONS = {
    "lbf under N": lambda record: record / 4.448,
    "N under lbf": lambda record: record * 4.448,
    "a flipped axis": lambda record: record * [1, -1],
    "exchanged axes": lambda record: record[:, ::-1],
    "a tare under half of the load": lambda record: record - MEAN / 2,
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_a_record_off_the_desired_force_is_refused_with_both(forces, name):
    only = {"C1": forces["C1"]}
    check_forces(only)
    check_forces({"C1": forces["C1"] - 0.1 * MEAN})  # robots that pull a tenth less
    words = r"mean force of C1 is .* desired \[3.0"

    with pytest.raises(RecordingError, match=words) as refused:
        check_forces({"C1": CONTRADICTIONS[name](forces["C1"])})
    assert refused.value.evidence["file"] == "C1.csv"
