"""Printed results that a claim and a study share."""

from pathlib import Path

import pytest

from pipeline.core.errors import ConfigError
from pipeline.core.typed_yaml import read_yaml
from pipeline.verdicts.claims import CLAIMS, parse_claims, read_claims
from pipeline.verdicts.published import PUBLISHED, published_results

STUDIES = Path("pipeline/studies")


def test_claims_have_the_printed_results_of_the_file_in_the_order_of_their_cases():
    claims = {claim.id: claim for claim in read_claims()}
    for name, result in published_results().items():
        claim = claims[name]
        if isinstance(result, dict):
            assert [*result] == claim.each["entry"]
            assert claim.published == [*result.values()]
        else:
            assert claim.published == result


def test_a_claim_without_an_entry_in_the_file_is_rejected_by_its_name():
    entry = next(c for c in read_yaml(CLAIMS)["claims"] if c["id"] == "sigma-b")
    assert entry["published"] == PUBLISHED.name
    with pytest.raises(ConfigError, match="no entry 'another'") as error:
        parse_claims([entry | {"id": "another"}])
    assert error.value.evidence["key"] == "published"


def test_an_edit_of_a_claim_runs_only_the_study_that_decides_the_claims():
    dependent = []
    for file in sorted(STUDIES.glob("*/dvc.yaml")):
        for stage in read_yaml(file)["stages"].values():
            if CLAIMS.as_posix() in stage["deps"]:
                dependent.append(file.parent.name)
    assert dependent == ["robustness"]
