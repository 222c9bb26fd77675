"""The motion models, a folder each. ``load`` takes one up from the file that the tool export wrote;
nothing else is imported with the package.
"""

from importlib import import_module
from pathlib import Path


def load(file: str | Path):
    """The :class:`pipeline.models.exported.ExportedModel` in ``file``; it needs NumPy alone.

    Raises ContractError for a file that holds none.
    """
    exported = "pipeline.models.exported"  # no dep of the stages, which fit what it takes up
    return import_module(exported).read_exported(Path(file))
