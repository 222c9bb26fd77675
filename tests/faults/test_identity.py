"""Recordings that are not what their name says are refused, named or left out; sound ones pass."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
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

TRAIN, TEST, LIMITS = "train_001", "test_001", Limits()


@pytest.fixture
def folder(benches, dataset, tmp_path):
    """A training and a test take, different in noise, and their dataset."""
    (tmp_path / "optitrack").mkdir()
    source = tmp_path / "source.csv"
    source.write_bytes(benches["take"].files["optitrack/test_001.csv"])
    rng, sound = np.random.default_rng(4), read_motive(source)
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
    counts: dict[str, dict[str, float]] = {}
    for row in read_part("motion", dataset, SimpleNamespace(), tmp_path / "out"):
        counts.setdefault(row["take"], {})[row["quantity"]] = row["value"]
    return counts


def exported_again(content: bytes) -> bytes:
    return content.replace(b"\r\n", b"\n").replace(b"Version,1.23", b"Version,1.24")


@pytest.mark.parametrize("change", [bytes, exported_again])
@pytest.mark.parametrize("copy", [TEST, "train_002"])
def test_a_copy_of_a_take_is_refused_with_both_names(folder, tmp_path, change, copy):
    content = (tmp_path / f"optitrack/{TRAIN}.csv").read_bytes()
    renamed = change(content).replace(TRAIN.encode(), copy.encode())
    (tmp_path / f"optitrack/{copy}.csv").write_bytes(renamed)
    with pytest.raises(
        RecordingError,
        match="have equal samples: one is a copy",
    ) as refused:
        ingest(folder, tmp_path)
    assert TRAIN in refused.value.message and copy in refused.value.message


def test_rounded_samples_are_equal_and_noise_is_not():
    a, c = np.random.default_rng(1).normal(size=(2, 50, 3))
    a[3] = np.nan
    require_distinct("takes", {"a": a, "b": a + 1e-4, "c": c, "d": a[:40]})
    with pytest.raises(RecordingError, match="a and b have equal samples"):
        require_distinct("takes", {"a": a, "c": c, "b": a.round(6)})


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
    rng, time = np.random.default_rng(2), np.arange(160) / 100
    starts = rng.normal(0, 0.0015, 8)
    takes = np.array([motion(time + start) for start in starts])
    takes += rng.normal(0, 1e-3, takes.shape)
    lags = lags_beside_others(takes, 100.0)
    assert np.abs(lags).max() < LIMITS.lag_beside_others / 2
    takes[-1] = motion(time - 0.08)
    takes[0, 40:60] = np.nan  # lost
    lags = lags_beside_others(takes, 100.0)
    assert lags[-1] == pytest.approx(0.08, abs=0.005)
    beyond = np.abs(lags) > LIMITS.lag_beside_others
    assert np.flatnonzero(beyond).tolist() == [7]


SHIFTS = {
    "scale and drift": lambda q, rng: (
        1.01 * q + np.linspace(0.01, 0.02, len(q))[:, None]
    ),
    "one joint": lambda q, rng: q,
    "noise of a quantum": lambda q, rng: q + rng.uniform(-2e-4, 2e-4, q.shape),
    "between rows": lambda q, rng: np.concatenate([(q[1:] + q[:-1]) / 2, q[-1:]]),
}


def swaying_takes(takes: int, motion, rng: np.random.Generator) -> np.ndarray:
    """Angles (takes, 320, 4) in rad: each take sways in its own way, with jitter and noise; a joint
    at rest has two values.
    """
    time = np.arange(320) / 100
    changes = rng.random((takes, 320, 4)) < 0.003
    q = changes.cumsum(axis=1) % 2 * 1e-4
    for take in q:
        frequencies = rng.uniform(2, 10, 6)[:, None]
        phases = rng.uniform(0, 6, (3, 6, 1))
        late = time + rng.normal(0, 1e-3, 320)
        waves = np.sin(frequencies * time + phases).sum(axis=1)
        take[:, :3] = motion(late) + 0.002 * waves.T
        take[:, :3] += rng.normal(0, 1e-4, (320, 3))
    return q


@pytest.mark.parametrize("disguise", [*SHIFTS, "all"])
@pytest.mark.parametrize("takes", [4, 40])
def test_a_copied_take_is_beyond_the_limit_also_disguised_and_sound_takes_are_not(
    motion,
    takes,
    disguise,
):
    rng = np.random.default_rng(takes)
    q = swaying_takes(takes, motion, rng)
    assert likeness(q).ratio.max() < LIMITS.likeness / 1.5
    copied = q.copy()
    joints = slice(1, 2) if disguise == "one joint" else slice(4)
    copied[2, :, joints] = q[0, :, joints]
    for name in SHIFTS if disguise == "all" else [disguise]:
        copied[2, :, joints] = SHIFTS[name](copied[2, :, joints], rng)
    alike = likeness(copied)
    assert np.flatnonzero(alike.ratio > LIMITS.likeness).tolist() == [0, 2]
    assert alike.size[[0, 2]].tolist() == [2, 2] and likeness(copied[:2]).size[0] == 1


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
    rng = np.random.default_rng(takes)
    q = swaying_takes(takes, motion, rng)
    sizes, first = np.ones(takes), 0
    for size in groups:
        group = slice(first, first + size)
        q[group] = q[first] + rng.normal(0, noise, q[group].shape)
        sizes[group], first = size, first + size
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
    rng, time = np.random.default_rng(pushed), np.arange(320) / 100
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
    rng, times_found = np.random.default_rng(takes), 0
    for _ in range(10):
        q = swaying_takes(takes, motion, rng)
        disturbed = q.copy()
        disturbed[4] += 2 * (q[4] - q.mean(axis=0))
        scores = disturbances(q, 100.0)
        assert scores.max() < LIMITS.disturbance
        beyond = np.flatnonzero(disturbances(disturbed, 100.0) > LIMITS.disturbance)
        assert {*beyond.tolist()} <= {4}
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
    bench, name = benches["depth"], "kinect/intrinsics.yaml"
    focal = re.search(rb"data: \[ *([0-9.]+)", bench.files[name])[1]
    changed = bench.files[name].replace(focal, str(float(focal) * factor).encode(), 1)
    _, recovered = bench.outcome({**bench.files, name: changed})
    error = recovered.q - motion(recovered.time)
    errors = spread("e", dataset.robot.joints, error)
    warning = bias_warning(pd.DataFrame(errors))
    assert bool(warning) == warned == ("rad off the motion capture" in warning)
    with pytest.raises(RecordingError, match="mirrored"):
        # rad, the least of the joints' for such images
        bias_warning(pd.DataFrame(errors) - 0.45)


def test_images_of_another_take_have_a_share_beyond_the_limit(motion, dataset):
    """Each take sways in its own way, by some tenths of a degree; the camera adds noise."""
    robot, rng, time = dataset.robot, np.random.default_rng(3), np.arange(181) / 100
    arm, joints = arm_of(robot), []
    for number in range(OTHERS + 2):
        waves = rng.uniform(4, 20, 8)[:, None] * time + rng.uniform(0, 6, (3, 8, 1))
        sway = 0.003 * np.sin(waves).sum(axis=1).T
        rows = pd.DataFrame({"take": number, "t": time, "residual": 0.0})
        joints.append(rows.assign(**spread("q", robot.joints, motion(time) + sway)))
    seen_at = np.arange(5, 175, 3) / 100

    def share(images: int, name: int, noise: float) -> float:
        """The share of a take ``name`` whose images are of the take ``images``."""
        angles = joints[images].filter(like="q").to_numpy()
        nodes = arm.chain.points(angles)[:, 1:].mean(axis=1)
        centroids = [np.interp(seen_at, time, x) for x in nodes.T]
        exact = np.stack(centroids, axis=1)
        drawn = rng.normal(0, noise, exact.shape)
        seen = np.ascontiguousarray(exact + drawn)
        order = [joints[name], *joints[:name], *joints[name + 1 :]]
        window = (-0.2, 0.2)
        residual, *beside = camera_residuals((seen_at, seen), order, arm, window)
        return residual_share(seen, residual, beside)

    limit = LIMITS.camera_residual_share
    assert max(share(n, n, 3e-4) for n in range(6)) < limit
    foreign = np.array([share(n, n + 1, 3e-4) for n in range(6)])
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
    values = np.random.default_rng(5).normal([20, 1, 2], [5, 0.1, 0.1], (2000, 3))
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


ARRANGED = {
    name: Arrangement(f"{name}.csv", direction, tension, (0.0, 6.3))
    for name, direction, tension in (
        ("C1", [0.15, 3.7, 1.6], [9.19, 6.92, 7.3]),
        ("C2", [1.1, 5.8, 2.5], [4.65, 7.75, 7.45]),
        ("C3", [0.15, 1.6], [9.0, 7.0]),
    )
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
    rng, records = np.random.default_rng(6), {}
    for name, arranged in FORCE.configurations.items():
        robots = len(arranged.direction)
        turns = arranged.direction + rng.normal(0, 600**-0.5, (3000, robots))
        deviations = rng.normal(size=(3000, robots)) * FORCE.tension_std[:robots]
        pulls = np.array(arranged.tension) + deviations
        x = (pulls * np.cos(turns)).sum(axis=1)
        y = (pulls * np.sin(turns)).sum(axis=1)
        records[name] = np.stack([x, y], axis=1)
    return records


def check_forces(records: dict[str, np.ndarray]) -> None:
    tables = [
        pd.DataFrame(record, columns=["fx", "fy"]).assign(configuration=name)
        for name, record in records.items()
    ]
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
    with pytest.raises(
        RecordingError,
        match=r"mean force of C1 is .* desired \[3.0",
    ) as e:
        check_forces({"C1": CONTRADICTIONS[name](forces["C1"])})
    assert e.value.evidence["file"] == "C1.csv"
