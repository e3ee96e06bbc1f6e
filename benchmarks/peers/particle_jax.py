"""One compiled lax.scan in float32: with blackjax's resampling and ESS, or cuthbert's filter with its own."""

import cloud
import jax
import jax.numpy as jnp
import numpy as np
from worker import serve

given = cloud.load()
P, n = given.P, given.n
single = jnp.float32
F, B, m0 = (jnp.asarray(array, single) for array in (given.F, given.B, given.m0))
root_P0, root_Q = (jnp.asarray(root, single) for root in (given.root_P0, given.root_Q))
# all instants have the same shape in a scan: a row that was not seen is a row of zeros
rows = given.z.shape[1]
W, HW, zW, constants = (np.zeros((given.N, *shape)) for shape in ((rows, rows), (rows, n), (rows,), ()))
for k, (z, H, R) in enumerate(given.seen):
    if len(z):
        whiten, constants[k] = cloud.whitening(R)
        HW[k, : len(z)], zW[k, : len(z)] = whiten @ H, whiten @ z
inputs = tuple(jnp.asarray(array[1:], single) for array in (HW, zW, constants))


def moments(x, log_w):
    """Return mean and covariance of particles (P, n)."""
    w = jax.nn.softmax(log_w)
    mean = w @ x
    centred = x - mean
    return mean, (w[:, None] * centred).T @ centred


def moved(key, x):
    """Return x (n,) or (P, n) after a step."""
    return x @ F.T + B + jax.random.normal(key, (*x.shape[:-1], root_Q.shape[1]), single) @ root_Q.T


def log_density(x, seen):
    """Return log p(z given x)."""
    H, z, constant = seen
    return constant - 0.5 * jnp.sum((z - x @ H.T) ** 2, axis=-1)


def begin(key):
    """Draw one x_0."""
    return m0 + root_P0 @ jax.random.normal(key, (root_P0.shape[1],), single)


if given.rest == ["blackjax"]:
    from blackjax.smc.ess import ess
    from blackjax.smc.resampling import systematic

    def step(carry, given_now):
        """Take one step of the bootstrap filter."""
        x, log_w = carry
        key, seen = given_now
        first, second = jax.random.split(key)
        low = ess(log_w) <= P / 2
        ancestors = jax.lax.cond(
            low, lambda: systematic(first, jax.nn.softmax(log_w), P), lambda: jnp.arange(P, dtype=jnp.int32)
        )
        x = moved(second, x[ancestors])
        log_w = jax.nn.log_softmax(jnp.where(low, -jnp.log(P), log_w) + log_density(x, seen))
        return (x, log_w), moments(x, log_w)

    def run(key):
        """Return means and covariances."""
        first, second = jax.random.split(key)
        x = jax.vmap(begin)(jax.random.split(first, P))
        log_w = jnp.full(P, -jnp.log(P), single)
        _, found = jax.lax.scan(step, (x, log_w), (jax.random.split(second, given.N - 1), inputs))
        return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), moments(x, log_w), found)

else:
    from cuthbert.smc.particle_filter import build_filter
    from cuthbertlib.resampling import adaptive, systematic

    filter_ = build_filter(
        init_sample=begin,
        propagate_sample=lambda key, x, seen: moved(key, x),
        log_potential=lambda before, x, seen: log_density(x, seen),
        n_filter_particles=P,
        resampling_fn=adaptive.ess_decorator(systematic.resampling, 0.5),
    )

    def step(state, given_now):
        """Take one step with cuthbert's filter."""
        key, seen = given_now
        state = filter_.filter_combine(state, filter_.filter_prepare(seen, key=key))
        return state._replace(model_inputs=None), moments(state.particles, state.log_weights)

    def run(key):
        """Return means and covariances."""
        first, second = jax.random.split(key)
        state = filter_.init_prepare(key=first)
        before = moments(state.particles, state.log_weights)
        _, found = jax.lax.scan(step, state, (jax.random.split(second, given.N - 1), inputs))
        return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), before, found)


compiled = jax.jit(run)
keys = iter(jax.random.split(jax.random.PRNGKey(0), 1000))


def act(_):  # noqa: D103
    means, covs = jax.block_until_ready(compiled(next(keys)))
    return {"means": np.asarray(means), "covs": np.asarray(covs)}


serve(lambda: None, act, given.answer)
