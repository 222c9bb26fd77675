"""configure: params.yaml and pipeline/conf → data/config.yaml, validated."""

from __future__ import annotations

from pathlib import Path

from pipeline.core import config


def run() -> None:
    """Compose, check and write the configuration that every other stage reads its sections from."""
    config.write_config(Path("params.yaml"))
