"""CITATION.cff agrees with the package, the change log and the README."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
REQUIRED = {"authors", "cff-version", "message", "title"}  # by the Citation File Format 1.2.0


def test_the_citation_agrees_with_the_package_the_change_log_and_the_readme():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0" and citation.keys() >= REQUIRED
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    heading = re.search(r"^## (.*)$", changelog, re.MULTILINE)[1]
    assert heading == f"{citation['version']} ({citation['date-released']})"
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"# {citation['title']}" == readme.splitlines()[0]
    (paper,) = citation["references"]
    names = [f"{one['given-names'][0]}. {one['family-names']}" for one in paper["authors"]]
    assert paper["title"] in " ".join(readme.split()) and ", ".join(names) in readme
