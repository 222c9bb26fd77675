"""Readings of "LU or QR" (Eq. LUDecom): one case for each decomposition of the Wishart model."""

from collections.abc import Sequence

from pipeline.core.columns import PLANE
from pipeline.evidence.case import Choices
from pipeline.models.wishart.decomposition import COMPUTED, decomposition_of

WISHART = "wishart"
NAMES = {"pivoted_lu": "pivoted LU", "qr": "QR of J", "qr_transposed": "QR of Jᵀ (control)"}


def readings(
    base: Choices, task: Sequence[str] = PLANE, joints: Sequence[str] = PLANE
) -> dict[str, Choices]:
    """Return ``base`` and the cases of other decompositions by name; {} without a Wishart model."""
    wishart = base.models.get(WISHART)
    if wishart is None:
        return {}
    own = decomposition_of(wishart.decomposition, wishart.left, task, joints).name
    cases = {NAMES.get(own, own): base}
    for name in COMPUTED:
        cases.setdefault(NAMES[name], base.with_wishart(decomposition=name, left=None))
    return cases
