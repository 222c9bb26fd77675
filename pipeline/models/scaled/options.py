"""Options of the model whose noise grows with the joint speed."""

from __future__ import annotations

from typing import Literal

from pipeline.core import validation
from pipeline.models import options

Structure = Literal["diagonal", "full"]


@validation.options(kw_only=True)
class Options(options.Options):
    structure: Structure  # of the covariances
