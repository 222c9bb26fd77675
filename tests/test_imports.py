"""Imports run one way and heavy libraries have one wrapper each, as pipeline/IMPORTS.yaml says."""

from __future__ import annotations

import pytest
import yaml
from source_code import MODULES, ROOT, imports, package, pipeline_imports

TABLE = yaml.safe_load((ROOT / "pipeline/IMPORTS.yaml").read_text(encoding="utf-8"))
PACKAGES, EXCEPTIONS, WRAPPERS = TABLE["packages"], TABLE["exceptions"], TABLE["wrappers"]
UPPER = {"stages", "studies", "tools", "__main__"}  # what the paper's packages never import


def roots(module: str, top: bool = False) -> set[str]:
    """The libraries and packages that ``module`` imports."""
    return {name.split(".")[0] for name in imports(module, top)}


def within(module: str, entries: list[str]) -> bool:
    """True where a module of the pipeline is, or lies in, one of ``entries`` of the table."""
    return any(f"{module}.".startswith(f"pipeline.{entry}.") for entry in entries)


def allowed(module: str) -> list[str]:
    """The entries that ``module`` may import."""
    own = package(module)
    entries = [own, "core", *PACKAGES[own]["imports"]]
    if "packages" in entries:
        entries += [name for name in PACKAGES if name not in UPPER]
    return entries + EXCEPTIONS.get(module.removeprefix("pipeline."), [])


@pytest.mark.parametrize("part", sorted(PACKAGES))
def test_imports_run_one_way(part):
    for module in (name for name in MODULES if package(name) == part):
        names = pipeline_imports(module)
        assert names <= MODULES.keys(), module
        assert {name for name in names if not within(name, allowed(module))} == set(), module


def test_the_table_has_every_package_and_no_other_and_no_circle():
    assert {package(module) for module in MODULES} == {*PACKAGES, "__init__"}
    below: set[str] = set()
    for name, entry in PACKAGES.items():  # the order of the table is the order of the layers
        assert set(entry["imports"]) - {"packages"} <= below, name
        below.add(name)
    assert not any(UPPER & set(PACKAGES[name]["imports"]) for name in set(PACKAGES) - UPPER)
    # the control: an import against the order is none that the table allows
    assert not within("pipeline.studies.filters.stage", allowed("pipeline.arm.chain"))


def test_stages_import_neither_each_other_nor_the_laboratory_but_for_record():
    for module in (name for name in MODULES if package(name) == "stages"):
        others = {package(name) for name in pipeline_imports(module)}
        assert "stages" not in others, module
        assert "laboratory" not in others or module == "pipeline.stages.record", module
    # a recorded dataset needs nothing of the laboratory to be configured
    assert not any("laboratory" in name for name in imports("pipeline.core.config", top=True))


@pytest.mark.parametrize("library", WRAPPERS)
def test_a_library_enters_through_its_wrapper(library):
    users = [module for module in MODULES if library in roots(module)]
    assert users, f"nothing imports {library}: take it out of the table"
    assert [module for module in users if not within(module, WRAPPERS[library])] == []


@pytest.mark.parametrize("library", TABLE["late"])
def test_what_takes_long_to_import_is_imported_by_the_function_that_needs_it(library):
    packages = [module for module in MODULES if package(module) not in {"studies", "tools"}]
    assert [module for module in packages if library in imports(module, top=True)] == []
    assert any(library in imports(module) for module in packages), "nothing does: take it out"
