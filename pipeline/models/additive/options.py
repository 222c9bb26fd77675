"""Options of the additive model."""

from __future__ import annotations

from typing import Literal

from pipeline.core import validation
from pipeline.models import options


@validation.options(kw_only=True)
class Options(options.Options):
    estimator: Literal["paper", "shrinkage"]
