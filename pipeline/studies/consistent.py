"""The estimator of each of the paper's models that returns known parameters, where the paper's own
does not.
"""

from __future__ import annotations

from dataclasses import replace

from pipeline.models.options import Options

CONSISTENT = {"additive": "shrinkage", "wishart": "likelihood", "gaussian": "likelihood"}


def consistent(options: Options) -> Options:
    """The options of the same model with its consistent estimator; of a baseline, which has no
    other, the same.
    """
    if options.kind not in CONSISTENT:
        return options
    return replace(options, estimator=CONSISTENT[options.kind])
