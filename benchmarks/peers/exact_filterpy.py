"""FilterPy's KalmanFilter as a person writes it: whole matrices, the rows seen."""

import sys

import numpy as np
from dense import instants, load
from filterpy.kalman import KalmanFilter
from worker import serve

data, answer = sys.argv[1:]
given = load(data)
n = len(given.mean)


def prepare():  # noqa: D103
    engine = KalmanFilter(dim_x=n, dim_z=2, dim_u=n)
    engine.x, engine.P = given.mean.copy(), given.cov.copy()
    engine.F, engine.Q, engine.B = given.F, given.Q, np.eye(n)
    return engine


def act(engine):  # noqa: D103
    for z, H, R in instants(given):
        engine.predict(u=given.B)
        engine.update(z, R=R, H=H)
    return {"mean": engine.x, "variances": np.diag(engine.P)}


serve(prepare, act, answer)
