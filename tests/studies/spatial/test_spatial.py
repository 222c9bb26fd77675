"""On spatial arms one reading alone is free of units and of the order of the rows, and its noise is
the same share of the step at every pose; the page and the figure say what the tables do.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import wishart

from pipeline.arm.model import chain_of
from pipeline.core import config, contracts
from pipeline.core.errors import ConfigError
from pipeline.core.options.dataset import Robot
from pipeline.models.wishart.decomposition import COMPUTED, Decomposition
from pipeline.studies.spatial import stage
from pipeline.studies.spatial.figures import spatial as figure
from pipeline.studies.spatial.spreads import (
    Parameters,
    course,
    covariance,
    orders,
    spread,
    straight,
)
from pipeline.studies.spatial.words import answer, joints_tables

ROOT = Path(__file__).parents[3]
PARAMETERS = Parameters(sigma_b=0.25, level=1.0, bound=1.1)
ARMS = {
    "ur5": ([-4.4, -0.2, 1.0, -2.6, -2.1, -3.1], [-4.1, -1.5, 1.6, -1.2, -0.5, -4.8]),
    "lwr4": ([0.2, 0.5, 0.3, 1.0, -0.4, 0.9, 0.2], [0.9, 0.9, -0.3, 1.7, 0.3, 1.4, -0.5]),
}


def motion_of(arm: str, length: float = 1.0, task: list[str] | None = None, places: int = 9):
    joints = [f"joint_{number + 1}" for number in range(len(ARMS[arm][0]))]
    robot = Robot(f"pipeline/arm/{arm}.urdf", joints, "flange", task=task, length=length)
    return straight(chain_of(robot), *ARMS[arm], places)


@pytest.fixture(scope="module")
def tables():
    """The study's tables of the seven-joint arm, on few poses and lengths."""
    start, end = ARMS["lwr4"]
    ways = {"lwr4": stage.Way(start, end)}
    options = stage.Options(places=5, lengths=[0.25, 1.0, 4.0], bound=1.1, ways=ways)
    return stage.tables_of("lwr4", options, 0.25, config.CONF)


@pytest.mark.parametrize("arm", ARMS)
def test_one_reading_alone_is_free_of_units_and_the_same_at_every_pose(arm):
    short, long = (motion_of(arm, length) for length in (0.2, 3.0))
    np.testing.assert_allclose(short.nominal, long.nominal, rtol=1e-9)
    for reading in (*COMPUTED[1:], "gaussian"):
        one, other = (covariance(motion, reading, PARAMETERS) for motion in (short, long))
        free = reading == "qr_transposed"
        assert np.allclose(one, other, rtol=1e-9, atol=1e-18) == free, reading
        assert (course(one, short.nominal) < 1 + 1e-9) == free, reading


@pytest.mark.parametrize("reading", COMPUTED)
def test_the_order_of_the_rows_matters_to_lu_without_pivoting_alone(reading):
    rows = ["y", "x", "z", "rz", "ry", "rx"]
    here, there = motion_of("lwr4"), motion_of("lwr4", task=rows)
    if reading == "lu":
        # in an order that meets no small pivot, and in one that does
        back = [rows.index(name) for name in here.chain.task]
        usable = [lu for lu in orders(6) if regular(here, lu)]
        assert 0 < len(usable) < 720
        same = Decomposition("lu", rows=[back[row] for row in usable[0].rows])
        np.testing.assert_allclose(
            covariance(here, usable[0], PARAMETERS), covariance(there, same, PARAMETERS), rtol=1e-6
        )
        spreads = [spread(covariance(here, lu, PARAMETERS), here.nominal) for lu in usable]
        assert max(spreads) > 2 * min(spreads)
    else:
        np.testing.assert_allclose(
            *(covariance(motion, reading, PARAMETERS) for motion in (here, there)),
            rtol=1e-6,
            atol=1e-14,
        )


def regular(motion, lu) -> bool:
    return bool(np.isfinite(covariance(motion, lu, PARAMETERS)).all())


def test_whether_a_pivot_is_small_hangs_on_no_length():
    some = orders(6)[::7]
    short, long = (motion_of("ur5", length, places=5) for length in (0.1, 10.0))
    whether = [regular(short, lu) for lu in some]
    assert whether == [regular(long, lu) for lu in some] and 0 < sum(whether) < len(some)


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_twice_the_poses_of_the_study_meet_no_other_small_pivots(arm):
    options = stage.Options(**config.read_yaml(stage.HERE / "params.yaml")["paper"])
    way, places = options.ways[arm], options.places

    def usable(count: int) -> list[bool]:
        motion = straight(motion_of(arm).chain, way["start"], way["end"], count)
        return [regular(motion, lu) for lu in orders(6)]

    assert usable(places) == usable(2 * places)
    # the control: a few poses miss some
    assert usable(places) != usable(5)


@pytest.mark.parametrize("reading", ["qr", "qr_transposed"])
def test_the_spread_is_that_of_drawn_matrices(reading):
    motion = motion_of("lwr4", places=2)
    jacobian, v = motion.chain.jacobian(motion.q)[0], motion.v[0]
    q, r = np.linalg.qr(jacobian.T)
    left, right = (np.eye(6), jacobian) if reading == "qr" else (r.T, q.T)
    d = 7 / PARAMETERS.sigma_b**2
    drawn = wishart(d, np.eye(6) / d, seed=3).rvs(4000)
    steps = np.array([np.linalg.pinv(left @ b @ right) @ v for b in drawn])
    expected = covariance(motion, reading, PARAMETERS)[0]
    # over 4000 draws a variance has a relative standard error of about 0.03
    np.testing.assert_allclose(steps.var(axis=0), np.diag(expected), rtol=0.15)


def test_the_gaussian_model_is_scaled_to_the_reading_without_units():
    motion = motion_of("ur5")
    level = PARAMETERS.calibrated(motion)
    sizes = [
        spread(covariance(motion, reading, level), motion.nominal)
        for reading in ("gaussian", "qr_transposed")
    ]
    assert sizes[0] == pytest.approx(sizes[1], rel=1e-12)
    other = replace(level, level=2 * level.level)
    assert spread(covariance(motion, "gaussian", other), motion.nominal) == pytest.approx(
        2 * sizes[0]
    )


def test_the_page_says_what_the_tables_do_and_names_the_arms_own_joints(tables):
    rows, joints = tables["spatial"], tables["spatial_joints"]
    text = answer(rows)
    free = rows[rows["reading"] == "qr_transposed"]["spread"]
    assert f"**QR of Jᵀ**: {free.iloc[0]:.3g} of the step at any (lwr4)" in text
    own = rows[rows["reading"] == "qr"]["spread"]
    assert f"up to {own.max() / own.min():.3g} times as much (lwr4)" in text
    lu = rows[rows["reading"] == "lu"].iloc[0]
    assert f"{lu['small_pivot']} of 720 (lwr4)" in text and 0 < lu["small_pivot"] < 720
    # an answer follows its table
    units = rows.assign(spread=rows["spread"] * rows["length"])
    assert "**QR of Jᵀ**: least at 0.25 m" in answer(units)
    (table,) = joints_tables(rows, joints)
    header, _, *lines = table.splitlines()
    assert header == "| lwr4 | " + " | ".join(f"joint_{n + 1}" for n in range(7)) + (
        " | greatest over least |"
    )
    assert len(lines) == 5 and lines[0].count("–") == 8  # the natural order of LU fails


def test_the_figure_draws_a_line_a_reading_and_the_orders_of_lu_as_a_band(tables):
    (axes,) = figure.draw(tables["spatial"]).axes
    assert axes.get_title() == "lwr4: LU fails in {} of 720 orders".format(
        tables["spatial"].query("reading == 'lu'")["small_pivot"].iloc[0]
    )
    lines = dict(zip(figure.LINES, axes.lines, strict=True))
    assert np.ptp(lines["qr_transposed"].get_ydata()) < 1e-9
    for reading, line in lines.items():
        rows = tables["spatial"].query(f"reading == '{reading}'")
        np.testing.assert_array_equal(line.get_xydata(), rows[["length", "spread"]])
    assert len(axes.collections) == 1


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"lengths": [0.1, 10.0]}, "lengths"),
        ({"lengths": [10.0, 1.0]}, "lengths"),
        ({"bound": 1.0}, "bound"),
        ({"ways": {"lwr4": stage.Way([0.0] * 6, [0.1] * 7)}}, "ways.lwr4.start"),
    ],
)
def test_what_is_no_study_is_refused_by_its_key(changes, key):
    start, end = ARMS["lwr4"]
    known = {"places": 3, "lengths": [1.0, 2.0], "bound": 1.1}
    known |= {"ways": {"lwr4": stage.Way(start, end)}} | changes
    with pytest.raises(ConfigError) as refused:
        stage.tables_of("lwr4", stage.Options(**known), 0.25, config.CONF)
    assert refused.value.evidence["key"] == key


@pytest.mark.slow
def test_the_stage_writes_its_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("pipeline", "dvc.yaml", "data/raw", "reports/claims.yaml"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).symlink_to(ROOT / name)
    params = (ROOT / "params.yaml").read_text().replace("scale: paper", "scale: smoke")
    Path("params.yaml").write_text(params.replace("compute: local", "compute: serial"))
    config.write_config(Path("params.yaml"))
    stage.run()
    rows = contracts.read("spatial", stage.OUT, stage.HERE / "tables.yaml")
    page = Path("reports/studies/spatial.md").read_text()
    assert answer(rows) in page and "(spatial/figures/spatial.png)" in page
