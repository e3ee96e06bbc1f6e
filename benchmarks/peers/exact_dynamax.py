"""dynamax' lgssm_filter, compiled, in double precision."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from dense import instants, load
from worker import serve

jax.config.update("jax_enable_x64", True)
from dynamax.linear_gaussian_ssm import LinearGaussianSSM  # noqa: E402
from dynamax.linear_gaussian_ssm.inference import lgssm_filter  # noqa: E402

data, answer = sys.argv[1:]
given = load(data)
n = len(given.mean)
seen = list(instants(given))
p = len(seen[0][0])
model = LinearGaussianSSM(state_dim=n, emission_dim=p)
params, _ = model.initialize(
    jax.random.PRNGKey(0),
    initial_mean=jnp.asarray(given.F @ given.mean + given.B),
    initial_covariance=jnp.asarray(given.F @ given.cov @ given.F.T + given.Q),
    dynamics_weights=jnp.asarray(given.F),
    dynamics_bias=jnp.asarray(given.B),
    dynamics_covariance=jnp.asarray(given.Q),
    emission_weights=jnp.asarray(np.array([H for _, H, _ in seen])),
    emission_covariance=jnp.asarray(np.array([R for _, _, R in seen])),
)
z = jnp.asarray(np.array([z for z, _, _ in seen]))
compiled = jax.jit(lgssm_filter)


def act(_):  # noqa: D103
    posterior = jax.block_until_ready(compiled(params, z))
    variances = np.diag(np.asarray(posterior.filtered_covariances[-1]))
    return {"mean": np.asarray(posterior.filtered_means[-1]), "variances": variances}


serve(lambda: None, act, answer)
