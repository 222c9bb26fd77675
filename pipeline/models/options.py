"""Options of every motion model; a model adds its own in ``KIND/fit.py``."""

from pipeline.core import validation


@validation.options()
class Options:
    """Base of the options of a model; those of each kind are a subclass of the same name."""

    kind: str  # the model's folder in pipeline/models
    label: str = ""  # its name in legends and tables
    closed_loop: bool = True  # whether its closed-loop form is fitted and filtered too
