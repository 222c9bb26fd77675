"""The environment on which bytes depend: assigned whatever a user has set, by the command alone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.core.compute.cluster import fingerprint
from pipeline.core.environment import BOUNDS

ROOT = Path(__file__).parents[2]


def elsewhere(code: str, **variables: str) -> str:
    """Output of ``code`` in another process of the project's root."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": "."} | variables,
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip()


def test_a_users_own_setting_is_overwritten_by_the_command():
    code = "import pipeline.__main__, os; print(*map(os.environ.get, %r), sep=chr(10))" % [*BOUNDS]
    found = elsewhere(code, OMP_NUM_THREADS="4", OPENBLAS_CORETYPE="Prescott")
    assert found.splitlines() == [*BOUNDS.values()]


def test_loading_an_exported_model_leaves_a_colleagues_environment(tmp_path):
    code = (
        "import os; before = dict(os.environ); import pipeline.models, pipeline.models.exported; "
        "print(before == dict(os.environ))"
    )
    assert elsewhere(code, OMP_NUM_THREADS="4") == "True"


@pytest.mark.parametrize("changed", [{}, {"OPENBLAS_CORETYPE": "Prescott"}])
def test_the_fingerprint_tells_arithmetic_apart_and_nothing_else(changed):
    code = (
        "import json; from pipeline.core.compute.cluster import fingerprint; "
        "print(json.dumps(fingerprint()))"
    )
    if changed:  # before numpy, and not assigned again
        code = (
            "import os, sys, types; m = types.ModuleType('pipeline.core.environment'); "
            f"m.BOUNDS = {dict(BOUNDS)!r}; sys.modules[m.__name__] = m; " + code
        )
    there = json.loads(elsewhere(code, **changed))
    names = {name for name, state in fingerprint().items() if there[name] != state}
    assert names == ({"OPENBLAS_CORETYPE", "numpy's arithmetic"} if changed else set())
