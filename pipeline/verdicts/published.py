"""Printed results of the parameter estimations, which a claim and a study both read."""

from pathlib import Path

from pipeline.core.typed_yaml import read_yaml

PUBLISHED = Path(__file__).with_name("published.yaml")


def published_results() -> dict[str, float | dict[str, float]]:
    """Return the printed results by id of the claim; a matrix has values by entry, as ``12``."""
    return read_yaml(PUBLISHED)
