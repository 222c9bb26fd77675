"""Decompositions J = J₁J₂ of the mean Jacobian (Eq. LUDecom), for whole batches.

The models need three things of one: the commanded step seen by the perturbation matrix, a = J₁⁻¹v,
the way back to the joints, J₂⁺ = J₂ᵀ(J₂J₂ᵀ)⁻¹, and the volume of J₂. J has m task rows and n ≥ m
joints, J₁ is (m, m) and J₂ (m, n). The paper names LU and QR and says no more; each reading is
another model:

- ``lu``: without pivoting, J₁ = PᵀL and J₂ = U for a fixed order P of the task rows and an order in
  which the joints are eliminated. It depends on both orders and on the units of the rows.
- ``pivoted_lu``: with partial pivoting, as numerical libraries do (J₁ and J₂ of MATLAB's
  two-output form). It depends on the units of the rows and on the order of the joints; the order of
  the rows changes nothing.
- ``qr``: of J. J₁ is orthonormal, and as the law of the perturbation matrix is invariant under
  rotations, J₁ = I and J₂ = J is the same model, and that is what is computed. It depends on the
  units alone.
- ``qr_transposed``: of Jᵀ, J₁ = Rᵀ and J₂ = Qᵀ. It depends on none of these: ‖a‖ = ‖J⁺v‖.
- ``given``: J₁ is a constant. As diag(ℓ, ℓ, 1) it turns metres into angles of lever arm ℓ, so that
  the three task rows have one unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.core.errors import ConfigError, ModelDomainError

if TYPE_CHECKING:
    from pipeline.models.wishart.options import Options

PARTS = ("left", "rows", "order")  # of a decomposition, beside its name
COMPUTED = ("lu", "pivoted_lu", "qr", "qr_transposed")
# least singular value of a given J₁ as a share of its greatest: below it the units of the task rows
# are hardly what was meant
LEAST_CONDITION = 1e-9


@dataclass(frozen=True)
class Decomposition:
    """How J is decomposed; raises ModelDomainError for what is no decomposition.

    Args:
        name: of :data:`COMPUTED`, or ``given``.
        left: (m, m) J₁, row by row, of ``given`` alone.
        rows: numbers of the task rows in the order of elimination, of ``lu`` alone; as they are
            where it is None.
        order: numbers of the joints likewise, base to tip where it is None.
    """

    name: str
    left: Sequence[Sequence[float]] | np.ndarray | None = None
    rows: Sequence[int] | None = None
    order: Sequence[int] | None = None

    def __post_init__(self) -> None:
        if self.name not in (*COMPUTED, "given"):
            raise ModelDomainError(
                f"the decomposition must be one of {(*COMPUTED, 'given')}", decomposition=self.name
            )
        if (self.name == "given") != (self.left is not None):
            raise ModelDomainError(
                "the decomposition given, and no other, needs the first factor of the Jacobian",
                decomposition=self.name,
            )
        if self.left is not None:
            object.__setattr__(self, "left", _regular(self.left))
        for what in ("rows", "order"):
            numbers = getattr(self, what)
            if numbers is None:
                continue
            if self.name != "lu" or sorted(numbers) != list(range(len(numbers))):
                raise ModelDomainError(
                    f"{what} of a decomposition must be numbers from 0, each once, and only lu "
                    "takes them",
                    decomposition=self.name,
                    **{what: list(numbers)},
                )
            object.__setattr__(self, what, tuple(numbers))

    def require_size(self, m: int, n: int) -> None:
        """Raise ModelDomainError where it is none of a Jacobian of ``m`` rows and ``n`` columns."""
        for what, size in (("left", m), ("rows", m), ("order", n)):
            part = getattr(self, what)
            if part is not None and len(part) != size:
                raise ModelDomainError(
                    f"{what} of the decomposition has another size than the Jacobian",
                    jacobian=(m, n),
                    **{what: part},
                )


LU = Decomposition("lu")  # the reading of the paper that its numbers leave possible


def chosen(options: Options, task: Sequence[str], joints: Sequence[str]) -> Decomposition:
    """The decomposition that ``options`` name, for the rows of the ``task`` and the ``joints``,
    base to tip, by their names; raises ConfigError for a name of one that there is not.
    """
    return Decomposition(
        options.decomposition,
        options.left,
        _numbers("rows", options.rows, task),
        _numbers("order", options.order, joints),
    )


def _numbers(key: str, names: Sequence[str] | None, known: Sequence[str]) -> list[int] | None:
    if names is None:
        return None
    if sorted(names) != sorted(known):
        raise ConfigError(
            f"{key} must name each of {', '.join(known)} once, in the order of elimination",
            key=f"models.*.{key}",
            **{key: list(names)},
        )
    return [list(known).index(name) for name in names]


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
