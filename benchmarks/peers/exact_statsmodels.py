"""statsmodels' compiled Kalman filter (conventional, univariate switched off), storing as little as it can."""

import sys

import numpy as np
from dense import instants, load
from statsmodels.tsa.statespace import kalman_filter
from worker import serve

data, answer = sys.argv[1:]
given = load(data)
n = len(given.mean)
seen = list(instants(given))
p = len(seen[0][0])


def prepare():  # noqa: D103
    engine = kalman_filter.KalmanFilter(k_endog=p, k_states=n)
    # it starts from the prediction for its first instant
    engine.initialize_known(given.F @ given.mean + given.B, given.F @ given.cov @ given.F.T + given.Q)
    engine.bind(np.array([z for z, _, _ in seen]))
    engine["design"] = np.moveaxis(np.array([H for _, H, _ in seen]), 0, -1)
    engine["obs_cov"] = np.moveaxis(np.array([R for _, _, R in seen]), 0, -1)
    engine["transition"], engine["state_intercept"] = given.F, given.B[:, None]
    engine["selection"], engine["state_cov"] = np.eye(n), given.Q
    engine.tolerance = 0
    engine.memory_no_gain = engine.memory_no_smoothing = engine.memory_no_predicted = True
    return engine


def act(engine):  # noqa: D103
    result = engine.filter()
    return {"mean": result.filtered_state[:, -1], "variances": np.diag(result.filtered_state_cov[..., -1])}


serve(prepare, act, answer)
