"""The perturbations held back by positive definiteness: (BsampOpt) under B⁻¹ ⪰ εI as a convex
problem in m variables, in bulk.

With the notation of :mod:`.perturbation` write S in a frame whose first axis is e and in units of
δ = 1 − ε: x − 1 in its corner, d/√2 beside it and a block C across e, so that y = (x − 1, d).
B⁻¹ ⪰ εI means C ⪰ ddᵀ/2x − I (Schur). Of that matrix one eigenvalue alone can be positive: so the C
of least norm, its positive part, is c·ddᵀ/‖d‖², c = max(0, ‖d‖²/2x − 1), whatever m. No cone is
left, and what is left is convex, as c is:

    minimise F = ‖ω − Ay‖ + λ‖z‖,   z = (y, c),   over x > 0 and d, or x = 0, d = 0.

F has a gradient but at three points: y = 0, the exact fit y = A⁺ω where there is one, as with as
many joints as task rows, and the apex x = 0, d = 0. The first is never the minimum here: F is less
where the way to the free optimum meets the bound. From the other two a step leads down unless they
are. Newton's method starts from the lowest place so found and only descends, so that it meets none
of the three; elsewhere F is convex and has a gradient, and Newton's steps, shortened as needed,
lead to its minimum. A conic solver takes hundreds of times as long.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.errors import SolverError
from pipeline.models.wishart.bounded_objective import Problems, moved, norm, norm_slopes
from pipeline.models.wishart.density import frames

STEPS = 100  # of Newton's method at most; ten are usual
SHORTENINGS = 30  # of a step that does not descend, each to a quarter
DESCENT = 1e-4  # share of its gain to first order that a step has to bring (Armijo)
SETTLED = 1e-13  # share of F that the last step promises: the next would promise less than rounding
RIDGE = 1e-12  # in shares of the diagonal
# share of F by which a place has to be lower than a point without a gradient, near which slopes
# drown in rounding
GRADED = 1e-10
# shares of the longest step that are tried from a point without a gradient
WAYS = 0.1 ** np.arange(15)
BENT = 2  # from which of them on, near the apex, the paraboloid is too bent for Newton's steps
GOLDEN, SECTIONS = (np.sqrt(5) - 1) / 2, 20


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(norm(vectors), np.finfo(float).tiny)[:, None]


def _starts(problems: Problems, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, m) the lowest of the places tried, and whether it is a point without a gradient (N,);
    ``free`` (N, m), y of the free optimum.

    No place but the exact fit is tried where it is the minimum: where no step r of Ay lowers λ‖z‖
    by more than the ‖r‖ that it adds.
    """
    zero, square = problems.zero, problems.matrix.shape[1] == problems.matrix.shape[2]
    # the exact fit, or halfway to the apex where none is feasible; the slope of ‖z‖ over ω there
    left, triangle = np.linalg.qr(problems.matrix)
    fit = np.linalg.solve(triangle, np.vecmat(problems.noise, left)[..., None])[..., 0]
    within = zero[0] + fit[:, 0] > 0
    exact = np.where(within[:, None], zero + fit, zero / 2)
    rest, z = problems.terms(exact)
    explained = within & (square | (norm(rest) < GRADED * norm(problems.noise)))
    z_slopes = problems.along(exact)[1]
    over_noise = np.linalg.solve(triangle @ z_slopes[:, :-1], np.swapaxes(left, 1, 2))
    slope = np.vecmat(norm_slopes(z, z_slopes)[0], over_noise)
    settled = explained & (problems.ratio * norm(slope) <= 1)
    other = np.flatnonzero(~settled)
    if other.size:
        down = np.matvec(over_noise, slope) * (norm(problems.noise) / norm(slope))[:, None]
        # what is left of ω is rounding where all of it is explained
        value = np.where(within & square, problems.ratio * norm(z), problems(exact))
        places = exact[other], value[other], down[other]
        start, apex = _lowest(problems.subset(other), free[other], *places)
        exact[other] = start
        settled[other] = apex | explained[other] & np.all(start == places[0], axis=1)
    return exact, settled


def _lowest(
    problems: Problems, free: np.ndarray, exact: np.ndarray, value: np.ndarray, down: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(N, m) the lowest of the places tried, and whether it is the apex (N,).

    Args:
        problems: N of them.
        free: (N, m) y of the free optimum.
        exact: (N, m) the exact fit, or halfway to the apex.
        value: (N,) F there.
        down: (N, m) the longest step tried from there.
    """
    # from 0 towards the free optimum, as far as the least eigenvalue of S may go
    least = (free[:, 0] - np.sqrt(free[:, 0] ** 2 + 2 * np.vecdot(free[:, 1:], free[:, 1:]))) / 2
    towards_free = problems.zero - free / least[:, None]
    # from the apex along the paraboloid on which c begins
    apex = np.zeros_like(free)
    along = _unit(np.vecmat(problems.terms(apex)[0], problems.matrix)[:, 1:])
    from_apex = _on_paraboloid(along, WAYS[:, None])
    from_exact = moved(exact, -WAYS[:, None, None] * down)
    places = np.concatenate([apex[None], exact[None], towards_free[None], from_apex, from_exact])
    values = problems(places)
    values[1] = value
    values[2:] *= 1 + GRADED
    lowest = values.argmin(axis=0)
    start = places[lowest, np.arange(len(free))]
    curved = np.flatnonzero((lowest >= 3 + BENT) & (lowest < 3 + len(WAYS)))
    if curved.size:
        way = WAYS[lowest[curved] - 3]
        start[curved] = _lowest_on_paraboloid(problems.subset(curved), along[curved], way)
    return start, lowest == 0


def _on_paraboloid(along: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(..., N, m) the places d = ``way``·``along``, (..., N) and (N, m − 1), where ‖d‖²/2x = 1."""
    d = way[..., None] * along
    return np.concatenate([np.vecdot(d, d)[..., None] / 2, d], axis=-1)


def _lowest_on_paraboloid(problems: Problems, along: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(N, m) the lowest places near ``way`` (N,), by golden sections of its logarithm: Newton's
    steps along what is so bent are short.
    """
    low, high = 0.1 * way, 10 * way
    for _ in range(SECTIONS):
        width = GOLDEN * np.log(high / low)
        inner, outer = high * np.exp(-width), low * np.exp(width)
        rises = problems(_on_paraboloid(along, inner)) < problems(_on_paraboloid(along, outer))
        low, high = np.where(rises, low, inner), np.where(rises, outer, high)
    return _on_paraboloid(along, np.sqrt(low * high))


def _descend(problems: Problems, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where Newton's steps from ``u`` (N, m), shortened where they do not descend, lead (N, m), and
    whether they settled (N,).
    """
    gradient, hessian = problems.slopes(u)
    # both norms are straight along one line where A maps it on that of ω: a ridge keeps their
    # Hessian regular, and where rounding makes it indefinite all the same its diagonal takes its
    # place
    diagonal = np.diagonal(hessian, axis1=1, axis2=2).copy()
    hessian *= 1 + RIDGE * np.eye(u.shape[1])
    move = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
    uphill = np.vecdot(gradient, move) > 0
    move[uphill] = -gradient[uphill] / diagonal[uphill]
    gain, value = -np.vecdot(gradient, move), problems(u)
    settled = gain <= SETTLED * value
    # of the way to the apex, where τ = −1
    share = np.minimum(1.0, 0.9 / np.maximum(-move[:, 0], np.finfo(float).tiny))
    for _ in range(SHORTENINGS):
        there = moved(u, share[:, None] * move)
        reached = problems(there)
        high = ~settled & (reached > value - DESCENT * share * gain)
        if not np.any(high):
            break
        share[high] /= 4
    # the last step brings less than the rounding of F, and yet the place
    there = np.where((reached <= (1 + GRADED) * value)[:, None], there, u)
    # or what is left to gain is below the rounding of F
    return there, settled | (reached >= value) & (gain <= GRADED * value)


def _minima(problems: Problems, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, m) where F is least, and whether that was reached (N,)."""
    try:
        u, reached = _starts(problems, free)
        for _ in range(STEPS):
            left = np.flatnonzero(~reached)
            if not left.size:
                break
            u[left], reached[left] = _descend(problems.subset(left), u[left])
    except np.linalg.LinAlgError:
        return free, np.zeros(len(free), dtype=bool)
    return u, reached


def solve_bounded(
    noise: np.ndarray,
    a: np.ndarray,
    matrix: np.ndarray,
    free: np.ndarray,
    ratio: float,
    floor: float,
) -> np.ndarray:
    """(N, m, m) the optimal S of N problems whose free optimum breaks the bound; raises SolverError
    where a minimum was not reached.

    Args:
        noise: (N, n) ω.
        a: (N, m) along e.
        matrix: (N, n, m) A, of full column rank.
        free: (N, m) y of the free optimum.
        ratio: λ.
        floor: ε.
    """
    delta, frame = 1 - floor, frames(a)
    problems = Problems(noise, delta * matrix @ frame, delta * ratio)
    u, reached = _minima(problems, np.vecmat(free, frame) / delta)
    if not np.all(reached):
        raise SolverError(
            "the perturbation under its bound was not solved to optimality in "
            f"{np.count_nonzero(~reached)} problem(s)",
            noise=noise[reached.argmin()].tolist(),
            ratio=ratio,
            floor=floor,
        )
    (_, z), d = problems.terms(u), u[:, 1:]
    s = np.zeros(frame.shape)
    s[:, 0, 0] = u[:, 0] - 1
    s[:, 0, 1:] = s[:, 1:, 0] = d / np.sqrt(2)
    along = _unit(d)
    s[:, 1:, 1:] = z[:, -1, None, None] * along[:, :, None] * along[:, None, :]
    return delta * frame @ s @ np.swapaxes(frame, 1, 2)
