"""The particle filter of `cuthbert` on the take."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from cuthbert.smc import particle_filter
from cuthbertlib.resampling import ess_decorator, systematic
from laws_in_jax import law_of

CONFIGURATION = (
    "compiled by JAX in float64, the whole filter one `lax.scan` with its moments inside, so that "
    "no history is kept; the law of a step vectorised by `vmap`; systematic resampling below half "
    "of the effective sample size; free to use every core"
)


def setup(count, law, steps, start_mean, start_covariance, seen, y, covariance, **told):
    move = law_of(**told)
    mean, factor = np.array(start_mean), np.linalg.cholesky(start_covariance)
    precision = np.linalg.inv(covariance)
    measured, weight = np.zeros((len(steps) + 1, len(mean))), np.zeros(len(steps) + 1)
    measured[seen], weight[seen] = y, 1.0

    def start(key):
        return mean + factor @ jax.random.normal(key, mean.shape)

    def propagate(key, q, inputs):
        return move(key, q, inputs[0])

    def log_potential(before, q, inputs):
        _, frame, weight = inputs
        error = frame - q
        return -0.5 * weight * (error @ precision @ error)

    resampling = ess_decorator(systematic.resampling, 0.5)
    filtered = particle_filter.build_filter(start, propagate, log_potential, count, resampling)
    inputs = (jnp.array(steps), jnp.array(measured[1:]), jnp.array(weight[1:]))
    first = jax.tree.map(lambda rows: rows[0], inputs)

    def moments(state):
        weights = jax.nn.softmax(state.log_weights)
        mean = weights @ state.particles
        centred = state.particles - mean
        return mean, (weights[:, None] * centred).T @ centred

    def body(state, step):
        inputs, key = step
        state = filtered.filter_combine(state, filtered.filter_prepare(inputs, key=key))
        return state, moments(state)

    @jax.jit
    def run(key):
        one, others = jax.random.split(key)
        state = filtered.init_prepare(key=one)._replace(model_inputs=first)
        keys = jax.random.split(others, len(steps))
        _, (means, covariances) = jax.lax.scan(body, state, (inputs, keys))
        return jnp.vstack([moments(state)[0], means]), covariances

    def call() -> list:
        means, covariances = run(jax.random.key(1))
        covariances.block_until_ready()
        return np.asarray(means).tolist()

    return call
