"""The configuration that params.yaml asks for."""

from __future__ import annotations

import pytest
from params_file import parameters

from pipeline.core import config


@pytest.fixture
def compose(tmp_path, monkeypatch):
    """Composes params.yaml with some of its lines changed."""
    monkeypatch.chdir(tmp_path)

    def composed(**choices: str | None) -> config.Config:
        return config.compose_config(parameters(tmp_path, **choices))

    return composed
