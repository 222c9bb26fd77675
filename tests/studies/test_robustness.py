"""Conditions with a known outcome, decisions that change one option, and the page's counts."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from recordings_of_law import ROOT
from sample_options import filter_options
from study_runs import options_of

from pipeline.core.columns import spread
from pipeline.core.options.analysis import Wrench
from pipeline.core.typed_yaml import read_yaml
from pipeline.evidence.case import KINDS, Choices
from pipeline.models.kinds import options_type
from pipeline.studies.robustness import grid, stage
from pipeline.studies.robustness.stage import changes
from pipeline.studies.simulated import SIZES, perform, steps
from pipeline.verdicts.claims import parse_claims
from pipeline.verdicts.decision import SPEED_LAW

FILES = (
    "pipeline/verdicts/claims.yaml",
    "pipeline/studies/robustness/conclusions.yaml",
)


def all_claims() -> tuple:
    """Claims of the paper and conclusions of the study."""
    claims = []
    for file in FILES:
        claims += parse_claims(read_yaml(ROOT / file)["claims"])
    return tuple(claims)


CLAIMS = all_claims()
FURTHER = {
    "wishart": {"decomposition": "pivoted_lu", "floor": 0.2},
    "gaussian": {"beta": 0.5},
}
MODELS = {
    kind: options_type(kind)(kind, estimator="paper", **FURTHER.get(kind, {}))
    for kind in KINDS
}
CASE = Choices(MODELS, filter_options(60, "systematic", 0.5), "one_step", closed=True)
# sway of one size at any speed, and no other disturbance: the additive model is true
ADDITIVE = tuple((name, 0.0) for name in SIZES if name != "sway_std")
STILL = tuple((name, 0.0) for name in SIZES)


@pytest.fixture(scope="module")
def common(laboratory) -> dict:
    straight = {"folded": [1.8, -2.6, 2.0], "extended": [1.8, -2.5, 2.0]}
    sizes = {"training_takes": 40, "test_takes": 4, "realizations": 12}
    trajectories = {"straight": straight}
    options = options_of("robustness", **sizes, trajectories=trajectories)
    parts = {"laboratory": laboratory, "case": CASE, "claims": CLAIMS}
    return parts | {"options": options, "wrench": None}


@pytest.mark.slow
def test_verdicts_are_those_of_the_law_that_is_true(common):
    laboratory = common["laboratory"]
    constant = replace(laboratory.dynamics, speed_exponent=0.0)
    of_constant_sway = common | {"laboratory": replace(laboratory, dynamics=constant)}

    def verdicts(levels: tuple, parts: dict) -> pd.Series:
        rows = grid.verdicts(grid.Condition("motion", 3, levels), **parts)
        return rows.groupby("claim")["verdict"].first()

    base = verdicts((), common)
    additive = verdicts(ADDITIVE, of_constant_sway)
    still = verdicts(STILL, common)

    # the noise grows with the speed, which both matrix models and the speed law follow
    assert base["gaussian-outperforms-additive"] == SPEED_LAW
    assert base["noise-is-dynamic"] == "holds"
    for claim in (
        "gaussian-outperforms-additive",
        "noise-is-dynamic",
        "wishart-outperforms-additive",
    ):
        assert additive[claim] == "fails"
    # a model without noise stays within the limit of the mean error too: the rule has no power
    assert still["noise-is-dynamic"] == "fails"
    assert still["mean-error"] == "no evidence"


def test_the_wrench_has_evidence_that_depends_on_the_seed():
    study = Wrench(
        agents=[3, 20],
        kappa=[100.0, 800.0],
        tension_std=[0.5, 1.0],
        tension=[3.0, 5.0],
        direction=[0.8, 3.1],
        systems=40,
        test_systems=80,
        repeats=2,
        grid=2,
    )
    first = grid.wrench_evidence(grid.Condition("wrench", 1), study)
    second = grid.wrench_evidence(grid.Condition("wrench", 2), study)

    assert {*first["configuration"]} == {"3", "20"}
    assert not first.equals(second)


STRAIGHT = grid.Condition("motion", 3, (("trajectory", "straight"),))


def evidence_of_motion(condition: grid.Condition, common: dict) -> pd.DataFrame:
    parts = {name: common[name] for name in ("laboratory", "case", "options")}
    return grid.motion_evidence(condition, **parts)


@pytest.mark.slow
def test_a_motion_through_a_singular_pose_is_no_evidence(common):
    assert evidence_of_motion(STRAIGHT, common).empty
    assert {*grid.verdicts(STRAIGHT, **common)["verdict"]} == {"no evidence"}


@pytest.mark.slow
def test_loops_stand_beside_the_training_mean(common):
    evidence = evidence_of_motion(grid.Condition("motion", 3), common)
    compared = evidence.query("quantity == 'filter_log_score'")["model"]
    loops = {*KINDS, *(f"{kind}_closed" for kind in KINDS)}
    assert {*compared} == {"none", "memory", "speed"} | loops


def factors_of(conditions: list[grid.Condition]) -> list[tuple[str, str]]:
    """Factor and level of each condition of the first seed."""
    return [(c.factor, c.level) for c in conditions if c.seed == 1]


def test_the_grid_has_each_level_alone_and_the_combinations_that_are_named():
    factors = {"sway_std": [0.0, 2.0], "clearance": [2.0], "particles": [0.1]}
    small = grid.conditions(factors, [1, 2], "motion")
    large = grid.conditions(factors, [1], "motion", ["sway_std", "clearance"])

    alone = [
        ("", ""),
        ("sway_std", "0"),
        ("sway_std", "2"),
        ("clearance", "2"),
        ("particles", "0.1"),
    ]
    assert factors_of(small) == alone
    assert [condition.seed for condition in small] == [1, 2] * 5
    assert factors_of(large) == [
        *alone,
        ("sway_std, clearance", "0, 2"),
        ("sway_std, clearance", "2, 2"),
    ]


def test_each_cause_of_the_noise_is_a_condition_at_its_sizes(common):
    causes = grid.cause_conditions({"sway": [1.0, 2.0], "poses": [1.0]}, [1, 2])
    assert factors_of(causes) == [
        ("cause", "sway × 1"),
        ("cause", "sway × 2"),
        ("cause", "poses × 1"),
    ]
    assert [condition.seed for condition in causes] == [1, 2] * 3

    deviations = []
    for condition in [grid.Condition("motion", 1), *causes[::2]]:
        laboratory = grid.laboratory_under(condition, common["laboratory"], {})
        poses, _ = perform(laboratory, {}, 1, "train", 8)
        deviations.append(steps(laboratory, poses).noise.std())
    base, sway, double, slow = deviations
    assert sway == base
    assert double > 1.5 * sway
    assert slow < 0.8 * sway


SPEED = np.array([0.5, -1.0, 2.0])  # rad/s
OFFSETS = pd.Series(
    0.1 + 0.02 * default_rng(3).standard_normal(8),
    [f"test_{n}" for n in range(8)],
)


@pytest.fixture
def camera_noise() -> dict[str, pd.DataFrame]:
    """Noise of the camera from all takes by the treatment of its clock, which is off by OFFSETS."""

    def moved(t: np.ndarray, noise: float) -> pd.DataFrame:
        """Takes of a motion at constant speed, their angles at the times ``t``."""
        rng = default_rng(3)
        tables = []
        for take in OFFSETS.index:
            q = np.outer(t, SPEED) + noise * rng.standard_normal((len(t), 3))
            place = {"take": take, "frame": np.arange(len(t)), "t": t}
            tables.append(pd.DataFrame(place | spread("q", "abc", q)))
        return pd.concat(tables, ignore_index=True)

    angles = moved(0.3 + 0.03 * np.arange(15), 1e-3)
    joints = moved(0.01 * np.arange(101), 0.0)
    noise = {}
    for clock, camera in grid.cameras(angles, joints, OFFSETS, (0.03, 0.01), 1).items():
        noise[clock] = camera.noise[camera.noise["take"] == "none"]
    return noise


def test_a_clock_that_is_off_alike_goes_into_the_bias(camera_noise):
    mean = ["b:a", "b:b", "b:c"]
    late = camera_noise["a frame late"][mean] - camera_noise["aligned"][mean]
    assert_allclose(late, np.tile(-SPEED * 0.03, (15, 1)), atol=1e-12)


def test_a_clock_that_is_not_off_alike_widens_the_noise(camera_noise):
    variance = ["r:a:a", "r:b:b", "r:c:c"]
    not_aligned = camera_noise["not aligned"]
    aligned = camera_noise["aligned"]
    widened = not_aligned[variance] - aligned[variance]
    assert_allclose(widened.mean(), SPEED**2 * OFFSETS.var(), rtol=0.1)


def test_every_decision_changes_the_case_and_names_what_it_changes(laboratory):
    base = replace(CASE, models={kind: MODELS[kind] for kind in KINDS}, closed=False)
    cases = grid.decision_cases(base, laboratory.chain.task, ("a", "b", "c"), 2)
    assert cases[0] == ("", "", base)

    by_place = {(factor, level): case for factor, level, case in cases[1:]}
    assert base not in by_place.values()

    control = by_place["decomposition", "QR of Jᵀ (control)"].models["wishart"]
    assert control.decomposition == "qr_transposed"
    assert by_place["particles", "6"].filter.particles == 6

    free = by_place["realisations", "free running"]
    assert free == replace(base, mode="free_running")
    assert grid.without_camera(free, base)
    for clock in {*grid.CLOCKS} - {"aligned"}:
        assert not grid.without_camera(by_place["clock", clock], base)


def robustness_table(*rows: tuple) -> pd.DataFrame:
    """The table of cases of one or two seeds: grid, factor, claim, number that holds and fails."""
    columns = ["grid", "factor", "claim", "holds", "fails"]
    table = pd.DataFrame(rows, columns=columns).assign(about="method", level="")
    return table.assign(cases=table["holds"] + table["fails"])


def test_changes_tell_decisions_from_chance_and_count_other_seeds_as_chance():
    table = robustness_table(
        ("decisions", "", "turns", 1, 0),
        ("decisions", "floor", "turns", 0, 1),
        ("decisions", grid.CHANCE, "turns", 1, 0),
        ("decisions", "", "lucky", 1, 0),
        ("decisions", "floor", "lucky", 1, 0),
        ("decisions", grid.CHANCE, "lucky", 0, 1),
        ("decisions", "", "steady", 0, 1),
        ("decisions", "floor", "steady", 0, 1),
        ("decisions", grid.CHANCE, "steady", 0, 1),
        ("motion", "", "steady", 1, 1),
    )
    rows = changes(table)
    changed = rows.loc[rows["changed"], ["grid", "factor", "claim"]]

    assert [*changed.itertuples(index=False, name=None)] == [
        ("decisions", "floor", "turns"),
        ("decisions", grid.CHANCE, "lucky"),
        ("motion", grid.CHANCE, "steady"),
    ]

    facts = stage.facts({"robustness": table}, options_of("robustness"))
    assert (facts["decisions"], facts["lucky"], facts["names"]) == (1, 2, "none")


@pytest.mark.parametrize(
    ("holds", "fails", "verdict", "changed"),
    [
        (2, 0, stage.HOLDS, False),
        (0, 2, stage.FAILS, False),
        (0, 0, stage.UNKNOWN, False),
        (1, 1, stage.BOTH, True),
        # no evidence with one of two seeds
        (1, 0, stage.BOTH, True),
        (0, 1, stage.BOTH, True),
    ],
)
def test_a_seed_without_evidence_changes_a_verdict_by_chance(
    holds,
    fails,
    verdict,
    changed,
):
    table = robustness_table(("motion", "", "a", holds, fails)).assign(cases=2)
    (row,) = changes(table).itertuples()
    assert (row.base, row.changed) == (verdict, changed)
