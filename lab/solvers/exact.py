"""The exact filter: FilterPy's predict and update over the rows that were seen.

Question answered: what is p(x_k given z_1..z_k), exactly?  The H_k being given, the model is linear and Gaussian, so
the Kalman filter is the Bayes solution, and what every particle filter is compared with.  When nothing is seen the
update is skipped: a NaN would poison the state for ever.  Source: questions 1c and 1d of the handout.
"""

import numpy as np
from filterpy.kalman import KalmanFilter

from lab import gaussian
from lab.problem import Problem
from lab.result import Filtered
from lab.validation import InputError


def kalman(problem: Problem) -> Filtered:
    """Run the exact Kalman filter.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    Filtered
        `ess` and `survivors` are None.

    Raises
    ------
    InputError
        The innovation covariance S = H P H' + R is singular at some instant.
    """
    model = problem.model
    n = len(model.m0)
    # dim_z only sizes FilterPy's defaults, which the H, R and z given at each update replace
    engine = KalmanFilter(dim_x=n, dim_z=2, dim_u=n)
    engine.x, engine.P = model.m0.copy(), model.P0.copy()
    engine.F, engine.Q, engine.B = model.F, model.noise_cov, np.eye(n)
    means, covs, log_evidence = [engine.x], [engine.P], [0.0]
    for k in range(1, problem.n_instants):
        engine.predict(u=model.B)
        z, H, R = problem.seen(k)
        increment = 0.0
        if len(z):
            try:
                engine.update(z, R=R, H=H)
                # FilterPy's own log_likelihood drops small eigenvalues of S, and with them part of the constant
                increment = float(gaussian.log_density(engine.y, engine.S))
            except np.linalg.LinAlgError:
                raise InputError(f"The innovation covariance H P H' + R is singular at k = {k}.") from None
        engine.P = (engine.P + engine.P.T) / 2
        means.append(engine.x)
        covs.append(engine.P)
        log_evidence.append(log_evidence[-1] + increment)
    return Filtered(np.array(means), np.array(covs), np.array(log_evidence))
