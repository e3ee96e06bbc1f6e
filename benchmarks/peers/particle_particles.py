"""The library `particles` 0.4: Bootstrap with distributions made for this model, or with its own MvNormal."""

import cloud
import numpy as np
import particles
from particles import collectors, distributions
from particles import state_space_models as ssms
from worker import serve

given = cloud.load()
TINY = 1e-12 * np.eye(given.n)  # its MvNormal takes no singular covariance


class Move(distributions.ProbDist):
    """N(mean, L L'), sampled by the columns of L alone."""

    dim = given.n

    def __init__(self, mean, L):
        self.mean, self.L = mean, L

    def rvs(self, size=None):  # noqa: D102
        return self.mean + np.random.standard_normal((size, self.L.shape[1])) @ self.L.T  # noqa: NPY002


class See(distributions.ProbDist):
    """What is seen of the particles; p may be 0."""

    def __init__(self, mean, W, constant):
        self.mean, self.W, self.constant = mean, W, constant

    def logpdf(self, z):  # noqa: D102
        e = (z - self.mean) @ self.W.T
        return self.constant - 0.5 * np.sum(e**2, axis=1)


class Nothing(distributions.ProbDist):
    """An instant without measurement."""

    def __init__(self, count):
        self.count = count

    def logpdf(self, z):  # noqa: D102
        return np.zeros(self.count)


class Tailored(ssms.StateSpaceModel):
    """The model by Move and See."""

    def PX0(self):  # noqa: D102
        return Move(given.m0, given.root_P0)

    def PX(self, t, xp):  # noqa: D102
        return Move(xp @ given.F.T + given.B, given.root_Q)

    def PY(self, t, xp, x):  # noqa: D102
        z, H, R = given.seen[t]
        return See(x @ H.T, *cloud.whitening(R)) if len(z) else Nothing(len(x))


class Idiomatic(ssms.StateSpaceModel):
    """The model as its documentation writes one."""

    def PX0(self):  # noqa: D102
        return distributions.MvNormal(loc=given.m0, cov=given.P0 + TINY)

    def PX(self, t, xp):  # noqa: D102
        return distributions.MvNormal(loc=xp @ given.F.T + given.B, cov=given.Q + TINY)

    def PY(self, t, xp, x):  # noqa: D102
        z, H, R = given.seen[t]
        return distributions.MvNormal(loc=x @ H.T, cov=R) if len(z) else Nothing(len(x))


model = {"tailored": Tailored, "mvnormal": Idiomatic}[given.rest[0]]()


def act(_):  # noqa: D103
    bootstrap = ssms.Bootstrap(ssm=model, data=[z for z, _, _ in given.seen])
    keep = collectors.Moments(mom_func=lambda W, x: cloud.moments(x, W))
    run = particles.SMC(fk=bootstrap, N=given.P, resampling="systematic", ESSrmin=0.5, collect=[keep])
    run.run()
    return cloud.stacked(run.summaries.moments)


np.random.seed(0)  # noqa: NPY002 (it knows no other generator)
serve(lambda: None, act, given.answer)
