"""Cases of parametrised tests, in tables of the YAML file beside the tests."""

from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.core.typed_yaml import read_yaml


def cases_beside(module: str) -> Callable[..., pytest.MarkDecorator]:
    """Return a function of a table's name that parametrises a test by the table's rows.

    The tables are in the file of the ``module``'s name with the ending .yaml. The first row of a
    table names the arguments of the test. Further rows are added to those of the table.
    """
    tables = read_yaml(Path(module).with_suffix(".yaml"))

    def cases(table: str, *further: list) -> pytest.MarkDecorator:
        arguments, *rows = tables[table]
        return pytest.mark.parametrize(arguments, [*rows, *further])

    return cases
