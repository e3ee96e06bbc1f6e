"""A plain vectorised solution in numpy, and the same with FilterPy's systematic_resample."""

import cloud
import numpy as np
from worker import serve

given = cloud.load()


def resample_filterpy(w, rng):
    """Return those of FilterPy, which draws from numpy's global generator."""
    w = w.copy()
    w[-1] = max(0.0, 1 - w[:-1].sum()) + 1e-12  # its index runs over the end when the sum is 1 - eps
    return systematic_resample(w)


if given.rest == ["filterpy"]:
    from filterpy.monte_carlo import systematic_resample

    resample = resample_filterpy
else:
    resample = cloud.systematic


def act(rng):  # noqa: D103
    P, F, B = given.P, given.F, given.B
    x = given.m0 + rng.standard_normal((P, given.root_P0.shape[1])) @ given.root_P0.T
    w = np.full(P, 1 / P)
    log_w = np.log(w)
    found = [cloud.moments(x, w)]
    for z, H, R in given.seen[1:]:
        if 1 / np.sum(w**2) <= P / 2:
            x = x[resample(w, rng)]
            log_w = np.full(P, -np.log(P))
        x = x @ F.T + B + rng.standard_normal((P, given.root_Q.shape[1])) @ given.root_Q.T
        if len(z):
            W, constant = cloud.whitening(R)
            e = (z - x @ H.T) @ W.T
            log_w = log_w + constant - 0.5 * np.sum(e**2, axis=1)
        w = np.exp(log_w - log_w.max())
        w /= w.sum()
        log_w = np.log(np.maximum(w, 1e-300))
        found.append(cloud.moments(x, w))
    return cloud.stacked(found)


generator = np.random.default_rng(0)
serve(lambda: generator, act, given.answer)
