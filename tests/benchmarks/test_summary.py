"""The report says of each contest who is how much faster an item, and shows what is missed as
missed.
"""

from __future__ import annotations

import json

import imports_section
import pytest
import whole_section
from contests import lines
from contests_section import stated
from growth_section import limited
from parts_section import parts
from repeats import together
from writing import duration


def measured(
    name: str, *seconds: float, items: int = 1, param: str | None = None, **extra: object
) -> dict:
    """As repeats.py has it, of one run for each of the ``seconds``."""
    return {
        "group": "A contest",
        "name": name,
        "param": param,
        "extra_info": {"items": items} | extra,
        "least": [*seconds],
    }


OURS = measured("test_ours", 2.0, items=1000, role="ours")


def only_line(*others: dict, ours: dict = OURS) -> list[str]:
    (line,) = lines([*others, ours])
    return line.cells()


@pytest.mark.parametrize(("target", "verdict"), [(7, "met"), (7.6, "**missed**"), (None, "–")])
def test_a_peer_is_compared_by_its_time_an_item(target, verdict):
    extra = {} if target is None else {"target": target}
    cells = only_line(measured("test_some_library", 1.5, items=100, role="peer", **extra))
    ratio = "7.5 (7.5 to 7.5) times as fast, 2 ms against 15 ms"
    assert cells[:3] == ["A contest", "some library", ratio]
    assert cells[4] == verdict


@pytest.mark.parametrize(("target", "verdict"), [(1.6, "met"), (1.4, "**missed**")])
def test_a_floor_is_what_ours_is_measured_in(target, verdict):
    cells = only_line(measured("test_floor", 1.333, items=1000, role="floor", target=target))
    ratio = "1.50 (1.50 to 1.50) times as long, 2 ms against 1.33 ms"
    assert cells[2:5] == [ratio, f"≤ {target}", verdict]


@pytest.mark.parametrize(
    ("target", "verdict"),
    [(3, "met"), (4, "**met in 2 of 3 runs**"), (6, "**met in 1 of 3 runs**"), (9, "**missed**")],
)
def test_of_several_runs_the_ratios_have_a_range_and_met_is_what_all_of_them_meet(target, verdict):
    ours = measured("test_ours", 1.0, 2.0, 1.0, role="ours")
    # ratios of the same run, 8 and 5 and 3: those of other runs would reach to 10
    cells = only_line(measured("test_peer", 8.0, 10.0, 3.0, role="peer", target=target), ours=ours)
    assert cells[2] == "5 (3 to 8) times as fast, 1 s against 8 s"
    assert cells[4] == verdict


@pytest.mark.parametrize(("error", "verdict"), [(1.0, "met"), (1.005, "met"), (1.1, "**missed**")])
def test_speed_at_the_cost_of_quality_meets_nothing(error, verdict):
    ours = measured("test_ours", 1.0, role="ours", error=error)
    cells = only_line(
        measured("test_peer", 9.0, param="a library", role="peer", target=2, error=1.0), ours=ours
    )
    assert (cells[1], cells[4]) == ("a library", verdict)
    assert cells[5] == f"error {error:.4g} against 1"


@pytest.mark.parametrize(("limit", "verdict"), [(2.1e-3, "met"), (1.9e-3, "**missed**")])
def test_a_limit_is_one_of_time_an_item(limit, verdict):
    cells = only_line(ours=measured("test_ours", 2.0, items=1000, role="ours", limit=limit))
    assert cells[2:5] == ["2 ms an item (2 ms to 2 ms)", f"≤ {duration(limit)}", verdict]


def test_a_contest_without_ours_or_with_two_is_refused():
    for benchmarks in ([measured("test_peer", 1.0, role="peer")], [OURS, OURS]):
        with pytest.raises(ValueError, match="unpack"):
            list(lines(benchmarks))


def test_opponents_stand_from_the_fastest_to_the_slowest():
    slow, fast = measured("test_slow", 3.0, role="peer"), measured("test_fast", 2.0, role="peer")
    assert [line.against for line in lines([slow, OURS, fast])] == ["fast", "slow"]


def test_the_parts_of_a_step_stand_in_no_contest_and_add_up():
    times = {"numbers": 2, "moves": 5, "weights and moments": 1, "resampling": 0.5}
    measured_parts = [
        measured("test_part", seconds * 1e-6, items=1000, role="part", arm="An arm", part=part)
        for part, seconds in (times | {"filter": 7, "circular functions": 0.8}).items()
    ]
    assert [line.against for line in lines([OURS, *measured_parts])] == []
    expected = "| An arm | 2 ns | 3 ns | 1 ns | 0.5 ns | 6.5 ns | 7 ns | 0.8 ns | 3.5 |"
    assert parts([OURS, *measured_parts]).splitlines()[-1] == expected


@pytest.mark.parametrize(
    ("limit", "text"), [(3.0, " (≤ 3: met)"), (2.0, " (≤ 2: **missed**)"), (float("nan"), "")]
)
def test_a_slope_is_held_to_its_limit(limit, text):
    assert limited(2.5, limit) == text


def test_what_a_test_is_against_is_its_name_in_the_report():
    cells = only_line(measured("test_x", 1.0, param="a-b", role="peer", against="a library"))
    assert cells[1] == "a library"


def test_who_states_a_configuration_is_listed_with_it_once():
    peers = [
        measured("test_a", 1.0, role="peer", configuration="its fastest"),
        measured("test_a", 2.0, role="peer", configuration="its fastest"),
        measured("test_b", 1.0, role="peer"),
        measured("test_floor", 1.0, role="floor", configuration="the least"),
    ]
    assert stated(peers, "peer", "Peers") == "Peers:\n\n- a: its fastest"


def test_runs_are_put_together_benchmark_by_benchmark_and_refused_where_they_differ():
    def run(*named: tuple[str, float]) -> list[dict]:
        return [
            measured(name, role="ours") | {"fullname": name, "stats": {"min": least}}
            for name, least in named
        ]

    one, other = together([run(("a", 1.0), ("b", 2.0)), run(("a", 3.0), ("b", 4.0))])
    assert (one["name"], one["least"], other["least"]) == ("a", [1.0, 3.0], [2.0, 4.0])
    assert "fullname" not in one and "stats" not in one
    with pytest.raises(ValueError, match="runs differ"):
        together([run(("a", 1.0)), run(("b", 1.0))])
    with pytest.raises(ValueError, match="argument 2"):
        together([run(("a", 1.0)), run(("a", 1.0), ("b", 1.0))])


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (95.0, "95 s"),
        (0.0123, "12.3 ms"),
        (1.5e-6, "1.5 µs"),
        (3.3e-8, "33 ns"),
        (2e-11, "0.02 ns"),
    ],
)
def test_durations_have_the_unit_that_suits(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize(("cpu", "verdict"), [(4.0, "met"), (6.5, "**missed**")])
def test_the_stages_are_measured_in_the_work_of_all_of_them(tmp_path, cpu, verdict):
    stages = [
        {"stage": "fit additive", "cpu": cpu, "elapsed": 3.5, "memory": 2.5e8},
        {"stage": "score", "cpu": 2.0, "elapsed": 2.0, "memory": 1.6e9},
    ]
    work = {"fit additive": {"motion": 2.5, "arm": 0.5}, "score": {"motion": 1.0}}
    measured = {
        "machine": "M",
        "scale": "paper",
        "ratio_limit": 1.5,
        "memory_limit": 1.5e9,
        "elapsed": 5.5,
        "work": work,
        "stages": stages,
        "serial": {"fit additive": 2.5, "score": 2.0},
    }
    (tmp_path / "experiment.json").write_text(json.dumps(measured))
    text = whole_section.section(tmp_path)
    assert (
        f"{(cpu + 2) / 4:.2f} times the processor time of the work itself (≤ 1.5: {verdict})"
        in text
    )
    assert "motion 3.5 s, arm 0.5 s" in text and "1.60 GB (< 1.5 GB: **missed**)" in text
    assert "1.12 times the processor time of the work itself (≤ 1.5: met), 4 s against 4 s" in text
    assert f"| fit additive | 3.5 s | {cpu:.1f} s | 2.5 s | 3.0 s | 0.25 GB |" in text


@pytest.mark.parametrize(("slowest", "verdict"), [(1.4, "met"), (1.6, "**missed**")])
def test_half_of_the_stages_and_the_slowest_are_held_to_what_they_may_take_to_import(
    tmp_path, slowest, verdict
):
    measured = {
        "limits": {"median": 1.0, "slowest": 1.5},
        "rounds": 5,
        "median": 0.9,
        "slowest": slowest,
        "stages": {"fit additive": 0.9, "track": slowest},
        "libraries": {"cvxpy": 0.8},
    }
    (tmp_path / "imports.json").write_text(json.dumps(measured))
    text = imports_section.section(tmp_path)
    assert "at most 0.90 s (≤ 1.0 s: met)" in text
    assert f"the slowest in {slowest:.2f} s (≤ 1.5 s: {verdict})" in text
    assert f"| track | {slowest:.2f} s |" in text and "| cvxpy | 0.80 s |" in text
