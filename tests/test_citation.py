"""CITATION.cff is one: what the Citation File Format 1.2.0 asks for, and what the project says of
itself elsewhere.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
# of the format's schema: what may stand at the top, in a reference that is a work by persons, and
# in an author of either kind
KEYS = {
    "abstract",
    "authors",
    "cff-version",
    "commit",
    "contact",
    "date-released",
    "doi",
    "identifiers",
    "keywords",
    "license",
    "license-url",
    "message",
    "preferred-citation",
    "references",
    "repository",
    "repository-artifact",
    "repository-code",
    "title",
    "type",
    "url",
    "version",
}
REQUIRED = {"authors", "cff-version", "message", "title"}
OF_A_PERSON = {
    "affiliation",
    "alias",
    "email",
    "family-names",
    "given-names",
    "name-particle",
    "name-suffix",
    "orcid",
    "website",
}
OF_AN_ENTITY = {"address", "city", "country", "email", "name", "orcid", "website"}


def faults(citation: dict) -> list[str]:
    """What breaks the format, of the keys that are used here."""
    broken = [f"unknown key {key}" for key in citation.keys() - KEYS] + [
        f"no {key}" for key in REQUIRED - citation.keys()
    ]
    references = citation.get("references", [])
    broken += ["another version"] if citation.get("cff-version") != "1.2.0" else []
    broken += (
        ["neither software nor dataset"]
        if citation.get("type", "software") not in ("software", "dataset")
        else []
    )
    broken += (
        ["no date"]
        if not re.fullmatch(r"\d{4}-\d\d-\d\d", str(citation.get("date-released", "2000-01-01")))
        else []
    )
    broken += [
        "a reference without its type, title or authors"
        for entry in references
        if not {"type", "title", "authors"} <= entry.keys()
    ]
    for entry in (citation, *references):
        broken += ["no author"] if not entry.get("authors") else []
        broken += [
            f"no author's key: {key}"
            for author in entry.get("authors", [])
            for key in author.keys() - _keys(author)
        ]
        broken += [
            f"no text: {key}"
            for key in ("title", "abstract", "message", "scope")
            if not isinstance(entry.get(key, ""), str)
        ]
    return broken


def _keys(author: dict) -> set[str]:
    return OF_AN_ENTITY if "name" in author else OF_A_PERSON


@pytest.fixture
def citation() -> dict:
    return yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_it_is_in_the_format(citation):
    assert faults(citation) == []


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"cff-version": "1.1.0"}, "another version"),
        ({"licence": "MIT"}, "unknown key licence"),
        ({"authors": []}, "no author"),
        ({"authors": [{"name": "a", "family-names": "b"}]}, "no author's key: family-names"),
        (
            {"references": [{"type": "article", "authors": [{"family-names": "b"}]}]},
            "a reference without its type, title or authors",
        ),
        ({"date-released": "soon"}, "no date"),
    ],
)
def test_what_is_not_in_the_format_is_found(citation, change, fault):
    assert faults(citation | change) == [fault]


def test_it_says_what_the_project_says_of_itself(citation):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"# {citation['title']}" == readme.splitlines()[0]
    (paper,) = citation["references"]
    assert paper["title"] in " ".join(readme.split())
    names = ", ".join(
        f"{author['given-names'][0]}. {author['family-names']}" for author in paper["authors"]
    )
    assert names in readme


def test_version_and_date_are_those_of_the_changelog_and_the_package(citation):
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    heading = re.search(r"^## (.*)$", changelog, re.MULTILINE)[1]
    assert heading == f"{citation['version']} ({citation['date-released']})"
    package = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert package["project"]["version"] == citation["version"]
