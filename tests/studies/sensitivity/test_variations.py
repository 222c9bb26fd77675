"""One decision at a time: what each variation changes, and what it leaves as it is."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest

from pipeline.cases.case import paper_models
from pipeline.models.kinds import options_type
from pipeline.studies.sensitivity.variations import variations

LEVER = 0.15


def differences(case, base) -> set[str]:
    return {
        field.name
        for field in fields(base)
        if getattr(case, field.name) != getattr(base, field.name)
    }


def test_the_base_case_comes_first_and_every_variation_changes_one_decision(base):
    first, *others = variations(base, LEVER)
    assert first == ("", "", base)
    for variation in others:
        changed = differences(variation.case, base)
        assert len(changed) == 1
        if changed == {"models"} and variation.setting != "estimator":
            assert {
                kind for kind in base.models if variation.case.models[kind] != base.models[kind]
            } == {"wishart"}
    assert len({(setting, value) for setting, value, _ in others}) == len(others)


def test_every_question_that_the_paper_leaves_open_is_varied(base):
    settings = {setting for setting, _, _ in variations(base, LEVER)[1:]}
    assert settings == {
        "estimator",
        "weights",
        "floor",
        "decomposition",
        "realisations",
        "noise in scores",
        "clock",
        "resampling",
        "threshold",
        "particles",
        "chance",
    }


def test_what_the_run_itself_chose_is_no_variation(base):
    def schemes(case):
        return {value for setting, value, _ in variations(case, LEVER) if setting == "resampling"}

    assert schemes(base) == {"stratified", "residual", "multinomial", "none"}
    other = replace(base, filter=replace(base.filter, resampling="none"))
    assert schemes(other) == {"systematic", "stratified", "residual", "multinomial"}


def test_the_factors_are_on_what_the_run_chose(base):
    chosen = base.with_wishart(ratio_factor=2.0)
    factors = [
        case.models["wishart"].ratio_factor
        for setting, _, case in variations(chosen, LEVER)
        if setting == "weights"
    ]
    assert factors == pytest.approx([0.2, 0.6, 6.0, 20.0])
    particles = [
        case.filter.particles
        for setting, _, case in variations(base, LEVER)
        if setting == "particles"
    ]
    assert particles == [6, 18, 180]


def test_a_decision_that_has_no_bearing_is_not_varied(base):
    by_likelihood = base.with_wishart(estimator="likelihood", floor=None)
    assert not {"weights", "floor"} & {
        setting for setting, _, _ in variations(by_likelihood, LEVER)
    }
    without = replace(base, models={"additive": base.models["additive"]})
    assert not {"weights", "floor", "decomposition"} & {
        setting for setting, _, _ in variations(without, LEVER)
    }


def test_of_the_models_of_a_run_the_papers_own_are_taken_the_first_of_each_kind():
    scaled = options_type("scaled")("scaled", structure="full")
    ml = options_type("wishart")("wishart", estimator="likelihood", decomposition="qr")
    options = {
        "wishart_ml": ml,
        "scaled": scaled,
        "additive": options_type("additive")("additive", estimator="paper"),
    }
    options["wishart"] = options_type("wishart")(
        "wishart", estimator="paper", decomposition="pivoted_lu", floor=0.2
    )
    assert list(paper_models(options).items()) == [
        ("additive", options["additive"]),
        ("wishart", ml),
    ]


def test_batches_of_test_takes_do_not_share_a_take_and_there_is_none_without_enough(base):
    names = [f"test_{n}" for n in range(5)]
    other = replace(base, batch=1)
    assert base.batch_of(names, 2) == ["test_0", "test_1"] and other.batch_of(names, 2) == [
        "test_2",
        "test_3",
    ]
    assert base.batch_of(names, 3) == names[:3] and other.batch_of(names, 3) == []
