"""The library pfilter, with systematic resampling; it computes mean and covariance itself."""

import cloud
import numpy as np
from pfilter import ParticleFilter
from worker import serve

given = cloud.load()
rng = np.random.default_rng(0)


def slip(x, **_):
    """Return moved particles (P, n)."""
    return x @ given.F.T + given.B + rng.standard_normal((len(x), given.root_Q.shape[1])) @ given.root_Q.T


def act(_):  # noqa: D103
    seen = iter(given.seen[1:])
    now = [None]

    def weigh(hypotheses, observed, **_):
        W, _ = cloud.whitening(now[0][2])
        exponent = -0.5 * np.sum(((observed - hypotheses) @ W.T) ** 2, axis=1)
        return np.exp(exponent - exponent.max())

    filter_ = ParticleFilter(
        prior_fn=lambda P: given.m0 + rng.standard_normal((P, given.root_P0.shape[1])) @ given.root_P0.T,
        dynamics_fn=slip,
        observe_fn=lambda x, **_: x @ now[0][1].T,
        weight_fn=weigh,
        resample_fn=lambda w: cloud.systematic(w, rng),
        n_particles=given.P,
        n_eff_threshold=0.5,
    )
    found = [(given.m0, given.P0)]  # it has no moments before the first update
    for now[0] in seen:
        with np.errstate(divide="ignore", invalid="ignore"):  # its entropy takes the logarithm of weights that are 0
            filter_.update(now[0][0] if len(now[0][0]) else None)
        found.append((filter_.mean_state, filter_.cov_state))
    return cloud.stacked(found)


serve(lambda: None, act, given.answer)
