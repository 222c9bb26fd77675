"""Causes of the arm's noise: every module of this package is one.

The arm, its instruments and the law of its motion (:mod:`pipeline.laboratory.dynamics`) are shared.
A cause is a type ``Options`` of the section ``laboratory.dynamics``, whose defaults say how large
and how long each disturbance is. ``laboratory.cause`` in a dataset's option file names the module.
"""

from importlib import import_module
from pathlib import Path

from pipeline.laboratory.options import DynamicsOptions


def cause_names() -> list[str]:
    """Names of all causes."""
    modules = Path(__file__).parent.glob("[!_]*.py")
    return sorted(module.stem for module in modules)


def dynamics_type(cause: object) -> type[DynamicsOptions]:
    """Return the type of ``laboratory.dynamics`` under a ``cause``; the type without a cause for a
    name that is not a cause's.
    """
    if cause not in cause_names():
        return DynamicsOptions
    return import_module(f"{__name__}.{cause}").Options
