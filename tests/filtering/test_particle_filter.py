"""The compiled particle filter: equal to its plain NumPy form on the same stream for every kind of
model and scheme; its limits and refusals; counts of resampling with their exact moments.
"""

from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
import pytest
from compiled_calls import chosen_by, from_python
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal
from numpy_filter import plain_filter
from numpy_laws import plain_steps
from printed_algorithms import READINGS
from sample_options import filter_options
from sliding_arm import sliding_arm

from pipeline.arm.chain import PlanarChain
from pipeline.arm.rows import WIDTH
from pipeline.core.errors import DegenerateFilterError, ModelDomainError
from pipeline.core.options.analysis import Filter
from pipeline.filtering.measurement import Measurements
from pipeline.filtering.particle_filter import Posterior, Start, particle_filter
from pipeline.filtering.sampling import SCHEMES, keep_inside
from pipeline.models.additive.law import AdditiveModel
from pipeline.models.draws import draw_steps
from pipeline.models.gaussian.law import GaussianModel
from pipeline.models.model import Commands, Traits, open_loop
from pipeline.models.wishart.law import WishartModel

DT = 0.01
COVARIANCE = 1e-5 * np.array([[3.0, -2.0, 1.0], [-2.0, 4.0, -1.5], [1.0, -1.5, 9.0]])
WISHART = {f"wishart {name}": WishartModel(0.25, READINGS[name]) for name in READINGS}
MODELS = {
    "additive": AdditiveModel(COVARIANCE),
    **WISHART,
    "wishart pivoted_lu, wide": WishartModel(1.2, READINGS["pivoted_lu"]),
    "gaussian": GaussianModel(0.05, 15.5),
}
PATH_START = np.array([1.1, -1.6, 1.8])
PARTICLES = 3 * WIDTH + 77
# links askew and senses mixed, the limits so near that some particles leave them
ARM = PlanarChain(
    np.array([0.05, -0.1]),
    np.array([[0.01, 0.155], [-0.02, 0.135], [0.03, 0.17]]),
    np.array([1.0, -1.0, 1.0]),
    PATH_START - np.array([0.2, 0.35, 0.3]),
    PATH_START + np.array([0.27, 0.3, 0.4]),
    np.ones(3),
)


def scene_path(steps: int = 60) -> np.ndarray:
    """(steps + 1, 3) rad, at rest in the first and the last five steps."""
    progress = np.clip((np.arange(steps + 1) - 5) / (steps - 10), 0, 1)
    return PATH_START + np.outer(np.sin(np.pi * progress) ** 2, [0.25, -0.2, 0.15])


def scene(arm: PlanarChain, steps: int = 60) -> tuple[np.ndarray, Start, Measurements]:
    """Commands that rest, move and rest; a start and measurements about the path, of which some lie
    within steps and some outside.
    """
    rng = default_rng(3)
    path = scene_path(steps)
    v = np.matvec(arm.jacobian(path[:-1]), np.diff(path, axis=0))
    of_start = np.array([[20.0, 3.0, 0.0], [3.0, 30.0, -5.0], [0.0, -5.0, 20.0]])
    start = Start(PATH_START, 1e-4 * of_start)

    t = np.arange(-0.02, DT * steps + 0.04, 1 / 30)
    spread = rng.standard_normal((len(t), 3, 3))
    root = 0.02 * (np.eye(3) + 0.3 * spread)
    bias = 0.01 * rng.standard_normal((len(t), 3))
    noise = np.matvec(root, rng.standard_normal((len(t), 3)))
    y = interpolated(t, path) + bias + noise
    covariance = root @ np.swapaxes(root, 1, 2)
    return v, start, Measurements("test01", t, y, bias, covariance)


def interpolated(t: np.ndarray, path: np.ndarray) -> np.ndarray:
    """(F, 3) poses at the times ``t`` of a ``path`` (M+1, 3) rad with steps of DT."""
    grid = DT * np.arange(len(path))
    return np.stack([np.interp(t, grid, angle) for angle in path.T], axis=1)


def greatest_difference(posterior: Posterior, reference: Posterior) -> float:
    """Over all fields, of logarithms and counts as a share; infinite where a decision differs."""
    differences = [0.0]
    for field in fields(Posterior):
        values = np.asarray(getattr(posterior, field.name))
        expected = np.asarray(getattr(reference, field.name))
        if values.dtype.kind == "f":
            is_moment = field.name in ("mean", "covariance")
            scale = 1.0 if is_moment else np.abs(expected) + 1.0
            differences.append(np.max(np.abs(values - expected) / scale))
        elif not np.array_equal(values, expected):
            differences.append(np.inf)
    return max(differences)


def on_the_scene(run, model, arm, options: Filter, share: float, stream) -> Posterior:
    """Posterior by the filter ``run`` in a loop that corrects towards the commanded path."""
    v, start, observed = scene(arm)
    commands = Commands(v, arm.pose(scene_path()[:-1]), share)
    return run(model, arm, commands, DT, start, observed, options, stream)


def both(
    model,
    arm,
    options: Filter,
    share: float = 0.0,
) -> tuple[Posterior, Posterior]:
    """Compiled and plain posterior, from streams that end alike."""
    case = model, arm, options, share
    rng = default_rng(5)
    plain_rng = default_rng(5)
    compiled = on_the_scene(particle_filter, *case, rng)
    plain = on_the_scene(plain_filter, *case, plain_rng)
    assert rng.bit_generator.state == plain_rng.bit_generator.state
    return compiled, plain


@pytest.mark.parametrize(
    "share, band",
    [(0.0, 1e-12), (0.4, 1e-11)],
    ids=["open", "closed"],
)
@pytest.mark.parametrize("kind", MODELS)
def test_the_compiled_filter_is_the_plain_one_for_every_model(kind, share, band):
    """The poses' own rounding enters the commands of a closed loop."""
    compiled, plain = both(MODELS[kind], ARM, filter_options(PARTICLES), share)
    assert greatest_difference(compiled, plain) < band
    # the scene has everything in it
    assert plain.resampled.any() and plain.measured.sum() > 15 and plain.left_out == 2
    assert plain.outside.any() or share > 0
    assert plain.clipped.any() == kind.startswith("gaussian")


@dataclass(frozen=True)
class Sampled:
    """A law without compiled code, whose draws in NumPy are those of the compiled ``law``."""

    law: AdditiveModel | GaussianModel | WishartModel
    traits: ClassVar = Traits(noisy_at_rest=False, needs_jacobian=True, compiled=False)

    def sample(self, chain, q, v, rng) -> np.ndarray:
        return plain_steps(self.law, chain, q, v, rng)[0]


ROOMY = replace(ARM, lower=ARM.lower - 2.0, upper=ARM.upper + 2.0)
FILLINGS = [1, 2, WIDTH - 1, WIDTH, WIDTH + 1]  # particles, of blocks of WIDTH


@pytest.mark.parametrize("particles", FILLINGS)
def test_blocks_of_any_filling_are_filtered(particles):
    options = filter_options(particles)
    compiled, plain = both(MODELS["wishart pivoted_lu"], ROOMY, options)
    assert greatest_difference(compiled, plain) < 1e-12


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("threshold", [0.0, 0.3, 0.9])
def test_the_compiled_filter_is_the_plain_one_for_every_scheme(scheme, threshold):
    options = filter_options(PARTICLES, scheme, threshold)
    compiled, plain = both(MODELS["wishart pivoted_lu"], ARM, options)
    resamples = scheme != "none"
    due = (plain.ess < threshold * PARTICLES) & resamples

    assert greatest_difference(compiled, plain) < 1e-12
    assert_array_equal(plain.resampled, due)
    assert due.any() == (resamples and threshold > 0)


@pytest.mark.parametrize("share", [0.0, 0.4], ids=["open", "closed"])
@pytest.mark.parametrize("kind", ["additive", "wishart qr"])
def test_a_law_without_compiled_code_is_filtered_by_its_samples(kind, share):
    compiled = MODELS[kind]
    laws = compiled, Sampled(compiled)
    options = filter_options(PARTICLES)
    q = np.tile(PATH_START, (4, 1))
    v = np.full(3, 1e-3)

    posteriors = []
    steps = []
    for law in laws:
        case = law, ARM, options, share, default_rng(5)
        posteriors.append(on_the_scene(particle_filter, *case))
        steps.append(draw_steps(law, ARM, q, v, default_rng(3))[0])

    assert greatest_difference(*posteriors) < 1e-11
    assert posteriors[0].resampled.any()
    assert_allclose(*steps, atol=1e-12)


CHANGES = {  # model, options and share of the loop that differ, and the least difference
    "a covariance off by a billionth": (
        1 + 1e-9,
        filter_options(PARTICLES),
        0.0,
        1e-12,
    ),
    "more resampling": (1.0, filter_options(PARTICLES, threshold=0.6), 0.0, 1e-3),
    "a closed loop": (1.0, filter_options(PARTICLES), 0.4, 1e-3),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_deviation_of_a_billionth_and_another_resampling_and_loop_are_noticed(change):
    factor, options, share, least = CHANGES[change]
    case = MODELS["additive"], ARM, filter_options(PARTICLES), 0.0
    plain = on_the_scene(plain_filter, *case, default_rng(5))

    changed_case = AdditiveModel(factor * COVARIANCE), ARM, options, share
    changed = on_the_scene(particle_filter, *changed_case, default_rng(5))

    assert greatest_difference(changed, plain) > least


# an arm whose joints are its task, J = I, its limits out of the way
FREE = sliding_arm(np.eye(3), np.full(3, -50.0), np.full(3, 50.0))
# its elbow is at a right angle where the joints are at zero
BENT = np.array([[0.0, 0.155], [0.135, 0.0], [0.0, 0.17]])
ELBOW = PlanarChain(
    np.zeros(2),
    BENT,
    np.ones(3),
    np.full(3, -50.0),
    np.full(3, 50.0),
    np.ones(3),
)
STILL = Start(np.array([0.3, -0.2, 0.5]), np.zeros((3, 3)))
START = replace(
    STILL,
    covariance=1e-4 * np.array([[4.0, 1, 0], [1, 3, -1], [0, -1, 2]]),
)
DIFFUSING = AdditiveModel(0.005**2 * np.eye(3))
EXACT = AdditiveModel(np.zeros((3, 3)))
STEPS = np.tile([0.01, -0.005, 0.0], (320, 1))


def seen(t, y, std: float = 0.02) -> Measurements:
    covariance = np.tile(std**2 * np.eye(3), (len(t), 1, 1))
    return Measurements("test01", np.array(t), y, np.zeros((len(t), 3)), covariance)


UNSEEN = seen([], np.empty((0, 3)))


def filtered(model, chain, steps, start, measurements=UNSEEN, **options) -> Posterior:
    problem = model, chain, open_loop(steps), DT, start, measurements
    return particle_filter(*problem, filter_options(**options), default_rng(1))


def along(t: np.ndarray, steps: np.ndarray) -> np.ndarray:
    path = STILL.mean + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return interpolated(t, path)


def test_without_resampling_the_weights_degenerate_and_with_it_they_do_not():
    t = np.arange(0.0, 3.2, 1 / 30)
    y = along(t, STEPS) + 0.02 * default_rng(11).standard_normal((len(t), 3))

    ess = {}
    for scheme in ("none", "systematic"):
        posterior = filtered(DIFFUSING, FREE, STEPS, START, seen(t, y), scheme=scheme)
        ess[scheme] = posterior.ess[160:][posterior.measured[160:]]

    assert np.max(ess["none"]) < 10
    assert np.median(ess["systematic"]) > 200


def stretching(share: float) -> np.ndarray:
    """Steps (4, 3) of which the third brings ELBOW by ``share`` to its stretched pose, q2 = −π/2,
    and the fourth starts there.
    """
    way = share * (-np.pi / 2 - STILL.mean[1])
    path = STILL.mean + np.outer(np.arange(4), [0.0, way / 3, 0.0])
    v = np.matvec(ELBOW.jacobian(path[:-1]), np.diff(path, axis=0))
    return np.vstack([v, v[-1:]])


NARROW = replace(FREE, upper=np.array([0.335, 50.0, 50.0]))


@pytest.mark.parametrize(
    ("arm", "steps", "last"),
    [
        pytest.param(NARROW, STEPS[:9], 4, id="limit"),
        pytest.param(FREE, np.full((3, 3), np.nan), 1, id="not a number"),
        pytest.param(ELBOW, stretching(1.0), 4, id="singular"),
    ],
)
def test_particles_that_leave_the_domain_or_are_no_numbers_end_the_filter_by_name(
    arm,
    steps,
    last,
):
    with pytest.raises(
        DegenerateFilterError,
        match="every particle has left",
    ) as caught:
        filtered(EXACT, arm, steps, STILL, particles=20)
    place = {"take": "test01", "step": last, "time": DT * last}
    assert caught.value.evidence == place


def test_particles_that_nearly_reach_a_singular_pose_stay():
    nearly = filtered(EXACT, ELBOW, stretching(0.9), STILL, particles=5)
    assert nearly.outside.sum() == 0


def test_a_particle_outside_the_domain_loses_its_weight_and_is_moved_back():
    """An arm at a singular pose would otherwise continue from NaN."""
    before = np.array([[0.1, 0.2, 0.3, 0.4], [1.0, 1.1, 1.2, 1.3]])
    q = before + 0.05
    q[0, 1] = 9.0
    q[1, 2] = np.nan
    q[:, 3] = -9.0
    log_weights = np.log([0.4, 0.3, 0.3, 1.0])
    log_weights[3] = -np.inf
    limits = np.full(2, -2.0), np.full(2, 2.0)

    moved = q.copy()
    lost = from_python(keep_inside)(limits, before, moved, log_weights, np.empty(4))

    assert lost == 2  # the fourth had no weight
    assert_array_equal(moved[:, 0], q[:, 0])
    assert_array_equal(moved[:, 1:], before[:, 1:])
    assert_array_equal(log_weights, [np.log(0.4), -np.inf, -np.inf, -np.inf])


@pytest.mark.parametrize(
    "start, error, words",
    [
        (
            replace(STILL, covariance=np.full((3, 3), np.nan)),
            ModelDomainError,
            "is not finite",
        ),
        (
            replace(STILL, mean=np.full(3, 60.0)),
            DegenerateFilterError,
            "start poses lies within",
        ),
    ],
)
def test_a_start_that_no_normal_law_has_or_beyond_the_limits_is_refused(
    start,
    error,
    words,
):
    with pytest.raises(error, match=words):
        filtered(EXACT, FREE, STEPS, start, particles=5)


DRAWING = SCHEMES[:-1]
REPEATS = 6000
BAND = 4.5  # standard errors; twelve weights of two schemes stay inside with probability 0.9997


@pytest.fixture(scope="module")
def weights() -> np.ndarray:
    drawn = default_rng(7).dirichlet(np.full(12, 0.7))
    drawn[3] = 0.0
    return drawn / drawn.sum()


def exact_variance(name: str, weights: np.ndarray) -> np.ndarray:
    """Var(count_i) in closed form."""
    count = len(weights)
    expected = count * weights
    left = expected % 1
    if name == "multinomial":
        return expected * (1 - weights)
    return left * (1 - left)


def off(values: np.ndarray, mean: np.ndarray) -> float:
    """Greatest deviation from ``mean`` of the average of ``values``, in standard errors."""
    error = values.std(axis=0) / np.sqrt(len(values))
    fixed = error < 1e-12
    assert_allclose(values[:, fixed].mean(axis=0), mean[fixed], atol=1e-9)
    return np.max(np.abs(values.mean(axis=0) - mean)[~fixed] / error[~fixed])


@pytest.mark.parametrize("name", DRAWING)
def test_counts_have_the_mean_and_the_variance_of_their_scheme_and_of_no_other(
    name,
    weights,
):
    rng = default_rng(1)
    count = len(weights)
    drawn = [chosen_by(name, weights, rng) for _ in range(REPEATS)]
    counts = np.array([np.bincount(chosen, minlength=count) for chosen in drawn])

    assert np.all(counts[:, weights == 0.0] == 0)
    assert off(counts, count * weights) < BAND
    squares = (counts - counts.mean(axis=0)) ** 2
    for rival in DRAWING:
        distance = off(squares, exact_variance(rival, weights))
        assert (distance < BAND) == (rival == name)


@pytest.mark.parametrize("scheme", DRAWING)
def test_weights_at_the_ends_of_their_range(scheme):
    for sole in (0, 4, 9):
        chosen = chosen_by(scheme, np.eye(10)[sole], default_rng(8))
        assert np.all(chosen == sole)

    # weights that went through an exponential, as in the filter, are right only up to rounding
    equal = np.full(1000, np.nextafter(1 / 1000, 0.0))
    chosen = np.sort(chosen_by(scheme, equal, default_rng(6)))
    assert np.array_equal(chosen, np.arange(1000)) == (scheme != "multinomial")

    # rounding may bring a point up to the end, where no particle has weight
    ends = np.concatenate([[0.0], np.full(1000, 1 / 1000), [0.0, 0.0]])
    for seed in range(20):
        chosen = chosen_by(scheme, ends, default_rng(seed))
        assert chosen.min() >= 1 and chosen.max() <= 1000
