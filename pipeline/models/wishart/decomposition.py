"""Decompositions J = J₁J₂ of the mean Jacobian (Eq. LUDecom), in closed form for whole batches.

The models need two things of it: the commanded step seen by the perturbation matrix, a = J₁⁻¹v, and
the way back to the joints, J₂⁻¹. J₁ is the lower factor of LU, the orthonormal one of QR, or a
constant matrix that is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from pipeline.arm.chain import SINGULAR_SINE, PlanarChain
from pipeline.core.errors import ModelDomainError, SingularJacobianError

Computed = Literal["lu", "qr"]
Decomposition = Computed | np.ndarray  # the name of a computed one, or the given J₁ (3, 3) itself

# least singular value of a given J₁ as a share of its greatest: below it the units of the task rows
# are hardly what was meant
LEAST_CONDITION = 1e-9


def chosen(name: str, left: Sequence[Sequence[float]] | None = None) -> Decomposition:
    """The decomposition of an option: ``lu``, ``qr``, or ``given`` with the rows ``left`` of J₁;
    raises ModelDomainError for any other.
    """
    if name == "given":
        try:
            matrix = np.array(left, dtype=float)
        except (TypeError, ValueError):
            matrix = np.empty(0)
        require_decomposition(matrix)
        return matrix
    require_decomposition(name)
    return name


def require_decomposition(decomposition: Decomposition) -> None:
    """Raise ModelDomainError for what is neither the name of a computed decomposition nor a regular
    matrix (3, 3).
    """
    if not isinstance(decomposition, np.ndarray):
        if decomposition not in get_args(Computed):
            raise ModelDomainError(
                f"the decomposition must be one of {(*get_args(Computed), 'given')}",
                decomposition=decomposition,
            )
        return
    if decomposition.shape == (3, 3) and np.all(np.isfinite(decomposition)):
        singular = np.linalg.svd(decomposition, compute_uv=False)
        if singular[-1] > LEAST_CONDITION * singular[0]:
            return
    raise ModelDomainError(
        "the given first factor of the Jacobian must be a finite, regular 3 × 3 matrix",
        left=decomposition.tolist(),
    )


def eliminate(matrix: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """U (3, 3, ...) and L⁻¹P·right (3, ...) of PJ = LU with partial pivoting, J being ``matrix``
    (..., 3, 3) and ``right`` (..., 3).

    Gaussian elimination of the augmented matrix [J | right], with the batch last, so that each
    entry is contiguous over it. Where J is singular the last pivot is zero or not finite.
    """
    augmented = np.empty((3, 4, *matrix.shape[:-2]))
    augmented[:, :3] = np.moveaxis(matrix, (-2, -1), (0, 1))
    augmented[:, 3] = np.moveaxis(np.broadcast_to(right, matrix.shape[:-1]), -1, 0)
    pivot = np.abs(augmented[:, 0]).argmax(axis=0)
    first = np.where(pivot == 0, augmented[0], np.where(pivot == 1, augmented[1], augmented[2]))
    second = np.where(pivot == 1, augmented[0], augmented[1])
    third = np.where(pivot == 2, augmented[0], augmented[2])
    with np.errstate(divide="ignore", invalid="ignore"):
        second = second - second[0] / first[0] * first
        third = third - third[0] / first[0] * first
        exchanged = np.abs(third[1]) > np.abs(second[1])
        second, third = np.where(exchanged, third, second), np.where(exchanged, second, third)
        third = third - third[1] / second[1] * second
    upper = np.stack([first, second, third])
    # what elimination made zero up to rounding
    upper[1, 0] = upper[2, 0] = upper[2, 1] = 0.0
    return upper[:, :3], upper[:, 3]


def invert_upper(upper: np.ndarray) -> np.ndarray:
    """(..., 3, 3) inverse of the upper triangular matrices ``upper`` (3, 3, ...)."""
    (u11, u12, u13), (_, u22, u23), (_, _, u33) = upper
    inverse = np.zeros((*upper.shape[2:], 3, 3))
    inverse[..., 0, 0], inverse[..., 1, 1], inverse[..., 2, 2] = 1 / u11, 1 / u22, 1 / u33
    inverse[..., 0, 1] = -u12 / (u11 * u22)
    inverse[..., 1, 2] = -u23 / (u22 * u33)
    inverse[..., 0, 2] = (u12 * u23 - u13 * u22) / (u11 * u22 * u33)
    return inverse


def factors(
    chain: PlanarChain, q: np.ndarray, v: np.ndarray, decomposition: Decomposition
) -> tuple[np.ndarray, np.ndarray]:
    """a = J₁⁻¹v (..., 3) and J₂⁻¹ (..., 3, 3) at joint angles ``q`` (..., 3) in rad for the step
    ``v`` (3,) or (..., 3) in m, m, rad.

    J₁ and J₂ are the factors of Eq. (LUDecom). ``lu``: MATLAB's two-output form of the LU
    decomposition with partial pivoting, J₁ = PᵀL and J₂ = U, which depends on the order (x, z, φ)
    and the units of the task rows. ``qr``: J₁ = Q orthonormal; as the law of the perturbation
    matrix is invariant under rotations, J₁ = I and J₂ = J is the same model, and that is what is
    returned. A given J₁ is constant, J₂ = J₁⁻¹J: as diag(ℓ, ℓ, 1) it turns metres into angles of
    lever arm ℓ, so that the three task rows have one unit. Raises SingularJacobianError, and
    ModelDomainError for another decomposition.
    """
    require_decomposition(decomposition)
    if isinstance(decomposition, np.ndarray):
        return np.broadcast_to(
            np.matvec(np.linalg.inv(decomposition), v), q.shape
        ), chain.inverse_jacobian(q) @ decomposition
    if decomposition == "qr":
        return np.broadcast_to(v, q.shape), chain.inverse_jacobian(q)
    upper, a = eliminate(chain.jacobian(q), v)
    determinant = np.abs(upper[0, 0] * upper[1, 1] * upper[2, 2])
    bad = ~(determinant >= SINGULAR_SINE * chain.lengths[0] * chain.lengths[1])
    if np.any(bad):
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        raise SingularJacobianError(
            f"the Jacobian is singular at {int(bad.sum())} pose(s): it has no LU decomposition "
            "with an inverse (or a pose is not finite)",
            index=index,
            q=q[index].round(4).tolist(),
        )
    return np.moveaxis(a, 0, -1), invert_upper(upper)


def log_determinant(chain: PlanarChain, q: np.ndarray, decomposition: Decomposition) -> np.ndarray:
    """(...,) ln|det J₂| at ``q`` (..., 3): that of J less that of J₁, which for LU and QR is
    zero.
    """
    of_first = np.linalg.slogdet(decomposition)[1] if isinstance(decomposition, np.ndarray) else 0.0
    return np.log(np.abs(chain.determinant(q))) - of_first
