"""Decompositions J = J₁J₂ of the mean Jacobian (Eq. LUDecom).

J has m task rows and n ≥ m joints, J₁ is (m, m) and J₂ (m, n). The paper names "LU or QR
depending on the redundancy" and computes in MATLAB, whose ``lu`` pivots: :data:`BY_SHAPE` follows
these words. Each decomposition is another law:

- ``pivoted_lu``: with partial pivoting, J₁ = PᵀL and J₂ = U (MATLAB's two-output form). It depends
  on the units of the task rows, on the axes of the task and on the order of the joints; the order
  of the rows changes nothing. Here rows of position are in m, rows of rotation in rad, in the axes
  of the arm's base: an angle's row is the first pivot while every lever arm is below 1 m.
- ``qr``: of J. J₁ is orthonormal, and as the law of the perturbation matrix is invariant under
  rotations, J₁ = I and J₂ = J is the same model, and is what is computed. It depends on the units
  of the rows alone, as it compares metres with radians.
- ``qr_transposed``: of Jᵀ, J₁ = Rᵀ and J₂ = Qᵀ. It depends on no unit, axis or order: ‖a‖ = ‖J⁺v‖.
- ``given``: J₁ is a constant. As diag(ℓ, ℓ, 1) it turns metres into angles of lever arm ℓ, so that
  the three task rows have one unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.core.errors import ModelDomainError

if TYPE_CHECKING:
    from pipeline.models.wishart.options import Options

PARTS = ("left",)  # of a decomposition, beside its name
COMPUTED = ("pivoted_lu", "qr", "qr_transposed")
BY_SHAPE = "by_shape"  # option: pivoted LU of a square Jacobian, QR of one with more joints
# least singular value of a given J₁ as a share of its greatest: below it the units of the task rows
# are hardly what was meant
LEAST_CONDITION = 1e-9


@dataclass(frozen=True)
class Decomposition:
    """One decomposition; raises ModelDomainError for an unknown name or a J₁ that is not regular.

    Args:
        name: of :data:`COMPUTED`, or ``given``.
        left: (m, m) J₁, row by row, of ``given`` alone.
    """

    name: str
    left: Sequence[Sequence[float]] | np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.name not in (*COMPUTED, "given"):
            raise ModelDomainError(
                f"the decomposition must be one of {', '.join((*COMPUTED, 'given'))}",
                decomposition=self.name,
            )
        if (self.name == "given") != (self.left is not None):
            raise ModelDomainError(
                "the decomposition given, and no other, needs the first factor of the Jacobian",
                decomposition=self.name,
            )
        if self.left is not None:
            object.__setattr__(self, "left", _regular(self.left))

    def require_size(self, m: int) -> None:
        """Raise ModelDomainError where a given J₁ is not of ``m`` task rows."""
        if self.left is not None and len(self.left) != m:
            raise ModelDomainError(
                f"the given first factor must have as many rows as the task, {m}, "
                f"and has {len(self.left)}",
                left=self.left,
            )


PIVOTED_LU = Decomposition("pivoted_lu")
CONTROL = Decomposition("qr_transposed")  # beside every other, as it depends on no unit


def chosen(options: Options, task: Sequence[str], joints: Sequence[str]) -> Decomposition:
    """The decomposition that ``options`` name for a ``task`` of these rows and these ``joints``."""
    name = options.decomposition
    if name == BY_SHAPE:
        name = "pivoted_lu" if len(task) == len(joints) else "qr"
    return Decomposition(name, options.left)


def _regular(left: Sequence[Sequence[float]] | np.ndarray) -> tuple[tuple[float, ...], ...]:
    try:
        matrix = np.array(left, dtype=float)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.ndim == 2 and len(set(matrix.shape)) == 1 and np.all(np.isfinite(matrix)):
        singular = np.linalg.svd(matrix, compute_uv=False)
        if singular[-1] > LEAST_CONDITION * singular[0]:
            return tuple(map(tuple, matrix.tolist()))
    raise ModelDomainError(
        "the given first factor of the Jacobian must be a finite, regular, square matrix",
        left=np.shape(matrix) and matrix.tolist(),
    )
