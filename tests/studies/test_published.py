"""The published values are those of reports/claims.yaml."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.cases.verdict import read_claims
from pipeline.core.errors import ConfigError
from pipeline.studies.published import published


def test_the_values_and_every_entry_of_the_covariance_stand_in_the_claims():
    stated = published(read_claims())
    assert (stated.sigma_b, stated.alpha, stated.u) == (0.25, 0.1, 18)
    printed = [[0.0330, -0.0406, 0.0592], [-0.0406, 0.0547, -0.0839], [0.0592, -0.0839, 0.2457]]
    np.testing.assert_allclose(stated.covariance, np.array(printed) * 1e-3)
    np.testing.assert_allclose(stated.spread, [0.00574, 0.00740, 0.01567], atol=5e-6)


def test_a_value_that_is_not_stated_is_refused():
    claims = [claim for claim in read_claims() if claim.id != "alpha"]
    with pytest.raises(ConfigError, match="no claim"):
        published(claims)
