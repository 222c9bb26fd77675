"""Motion models, one a folder; importing the package imports no model."""

from importlib import import_module
from pathlib import Path


def load(file: str | Path):
    """Read the :class:`pipeline.models.exported.ExportedModel` of the tool export from ``file``,
    with NumPy alone. Raises ContractError for any other file.
    """
    exported = "pipeline.models.exported"  # not a dependency of the stages, which fit the models
    return import_module(exported).read_exported(Path(file))
