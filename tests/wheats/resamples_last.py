"""A filter that resamples at the end of its step, after the moments; multinomial; a threshold of two thirds."""

import numpy as np

from lab.result import Filtered


class Sir:
    """An object that can be called."""

    def __init__(self, threshold):
        self.threshold = threshold

    def __call__(self, problem, rng, *, n_particles):
        model = problem.model
        x = model.m0[:, None] + np.sqrt(np.diag(model.P0))[:, None] * 0
        x = x + np.vstack(
            [
                np.zeros((2, n_particles)),
                np.linalg.cholesky(model.P0[2:, 2:]) @ rng.normal(size=(len(model.m0) - 2, n_particles)),
            ]
        )
        w = np.ones(n_particles) / n_particles
        out = [(x @ w, np.cov(x, ddof=0), 0.0, 1 / np.sum(w**2))]
        for k in range(1, problem.n_instants):
            x = model.F @ x + model.B[:, None]
            x[:2] += np.linalg.cholesky(model.Q[:2, :2]) @ rng.normal(size=(2, n_particles))
            z, H, R = problem.seen(k)
            logs = np.zeros(n_particles)
            if z.size:
                d = z[:, None] - H @ x
                logs = -0.5 * (np.sum(d * np.linalg.solve(R, d), axis=0) + np.linalg.slogdet(2 * np.pi * R)[1])
            top = logs.max()
            w = w * np.exp(logs - top)
            evidence = out[-1][2] + top + np.log(w.sum())
            w /= w.sum()
            out.append((x @ w, np.cov(x, aweights=w, ddof=0), evidence, 1 / np.sum(w**2)))
            if 1 / np.sum(w**2) < self.threshold * n_particles:
                x = x[:, rng.choice(n_particles, n_particles, p=w)]
                w = np.ones(n_particles) / n_particles
        return Filtered(*map(np.array, zip(*out, strict=True)))


sir = Sir(2 / 3)
